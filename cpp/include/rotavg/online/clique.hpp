#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The two right-hand sides whose y = L^-1 K is kept up.
enum RightHandSide {
  for_step,   ///< the gradient alone: where it is zero, nothing moves
  for_bound,  ///< and how far the dual is from the rotations
};

/// y of one right-hand side in the columns of a clique.
struct CliqueSolution {
  using Rows = Eigen::Matrix<double, 4, Eigen::Dynamic>;  ///< three columns as rows, and zeros

  Rows y;
  Rows left_over;       ///< what these columns take from the rows below
  double energy = 0.0;  ///< |y|_F^2 over the subtree: summed from the leaves up, it is known at the
                        ///< roots without a pass over all, and without the rounding of updates
  bool marked = false;  ///< to be computed anew
  Index waiting = 0;    ///< marked children that are not done
};

/// Variables that are eliminated together: some columns of L, of 3 x 3 blocks, with the same rows.
struct Clique {
  std::vector<Index> columns, below;  ///< variables; the rows of L are those of both
  std::vector<Index> in_parent;       ///< where `below` stands among the rows of the parent
  Index parent = -1;
  std::vector<Index> children;
  std::vector<double> panel;      ///< the columns of L, column-major
  std::vector<double> rest;       ///< the Schur complement, for the parent: a lower triangle
  CliqueSolution solution[2];     ///< of every RightHandSide
  double gradient = 0.0;          ///< the largest relative one in the subtree
  Matrix3 off = Matrix3::Zero();  ///< how far the dual is off, summed over the subtree
  /// Of the rows below, for the bound on rounding (linalg/cholesky_rounding.hpp): nonzeros of L in
  /// the columns of this subtree, and the sums of the terms of these columns.
  std::vector<double> nonzeros, terms;
  double rounding = 0.0;  ///< sum |dK_a|_F^2 / mu_a over the subtree, dK the rounding of K
  double gamma = 0.0;     ///< sum of gamma_k over its scalar rows, k their nonzeros in L

  Index num_columns() const { return static_cast<Index>(columns.size()); }
  Index num_rows() const { return static_cast<Index>(columns.size() + below.size()); }
  Index row(Index r) const { return r < num_columns() ? columns[r] : below[r - num_columns()]; }
};

/// x <- L^-1 x in the columns of a clique; its rows below lose what these take.
/// @param x room for its rows, perhaps more
inline void solve_lower(const Clique& clique, CliqueSolution::Rows& x) {
  const Index pivots = 3 * clique.num_columns(), rows = 3 * clique.num_rows();
  const double* l = clique.panel.data();
  using Row = Eigen::Vector4d;
  for (Index c = 0; c < pivots; c += 2, l += 2 * rows) {
    const Row x_c = x.col(c) /= l[c];
    if (c + 1 == pivots) {
      for (Index r = c + 1; r < rows; ++r) x.col(r) -= l[r] * x_c;
      break;
    }
    const double* const next = l + rows;
    const Row x_next = (x.col(c + 1) -= l[c + 1] * x_c) /= next[c + 1];
    for (Index r = c + 2; r < rows; ++r) x.col(r) -= l[r] * x_c + next[r] * x_next;
  }
}

/// x <- L^-T x in the columns of a clique, where the rows below are solved.
/// @param x room for its rows, perhaps more
inline void solve_upper(const Clique& clique, CliqueSolution::Rows& x) {
  const Index pivots = 3 * clique.num_columns(), rows = 3 * clique.num_rows();
  using Row = Eigen::Vector4d;
  for (Index c = pivots - 1; c >= 0; c -= 2) {
    const double* const l = clique.panel.data() + static_cast<std::size_t>(c) * rows;
    Row x_c = x.col(c);
    if (c == 0) {
      for (Index r = 1; r < rows; ++r) x_c -= l[r] * x.col(r);
      x.col(0) = x_c / l[0];
      break;
    }
    const double* const previous = l - rows;
    Row x_previous = x.col(c - 1);
    for (Index r = c + 1; r < rows; ++r) {
      x_c -= l[r] * x.col(r);
      x_previous -= previous[r] * x.col(r);
    }
    x_c /= l[c];
    x.col(c) = x_c;
    x.col(c - 1) = (x_previous - previous[c] * x_c) / previous[c - 1];
  }
}

}  // namespace rotavg

#pragma GCC diagnostic pop
