#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/front.hpp>
#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/online/clique.hpp>
#include <rotavg/parallel/interruption.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Adds what a child left over, whose rows may stand in another order here.
inline void add_rest(const Front<3>& front, const Clique& child) {
  const std::vector<Index>& place = child.in_parent;
  const std::size_t height = 3 * place.size();
  for (std::size_t c = 0; c < place.size(); ++c) {
    for (std::size_t r = c; r < place.size(); ++r) {
      const double* const from = child.rest.data() + 3 * c * height + 3 * r;
      const bool as_is = place[r] >= place[c];
      for (int b = 0; b < 3; ++b) {
        for (int a = r == c ? b : 0; a < 3; ++a) {
          const double value = from[b * height + a];
          if (as_is) {
            front.column(3 * place[c] + b)[3 * place[r] + a] += value;
          } else {
            front.column(3 * place[r] + a)[3 * place[c] + b] += value;
          }
        }
      }
    }
  }
}

/// Sums the front of a clique, and factorises its columns.
///
/// @tparam System that of CliqueTree
/// @param cliques among which its children are, factorised
/// @param place -1 of every variable, and so it is left
/// @returns whether all pivots were positive
template <typename System>
bool factorize(const System& system, std::vector<Clique>& cliques, Clique& clique,
               std::vector<Index>& place, PartialCholesky& dense) {
  const Index columns = clique.num_columns(), rows = clique.num_rows();
  const Index pivots = 3 * columns, below = 3 * (rows - columns);
  clique.panel.resize(static_cast<std::size_t>(pivots) * (pivots + below));
  clique.rest.resize(static_cast<std::size_t>(below) * below);
  const Front<3> front{clique.panel.data(), pivots, below, clique.rest.data()};
  front.set_zero(1);
  for (Index r = 0; r < rows; ++r) place[clique.row(r)] = r;
  std::vector<double> nonzeros(rows, 0.0), terms(rows, 0.0);
  for (const Index c : clique.children) {
    Clique& child = cliques[c];
    child.in_parent.clear();
    for (const Index v : child.below) child.in_parent.push_back(place[v]);
    add_rest(front, child);
    for (std::size_t r = 0; r < child.below.size(); ++r) {
      nonzeros[child.in_parent[r]] += child.nonzeros[r];
      terms[child.in_parent[r]] += child.terms[r];
    }
  }
  // linalg/cholesky_rounding.hpp, column by column.
  constexpr double margin = 1.01;
  double of_columns = 0.0;
  clique.rounding = clique.gamma = 0.0;
  for (const Index c : clique.children) {
    clique.rounding += cliques[c].rounding;
    clique.gamma += cliques[c].gamma;
  }
  for (Index k = 0; k < columns; ++k) {
    const Index v = clique.columns[k];
    const double in_row = 2.0 + nonzeros[k] + 3.0 * (k + 1.0);
    of_columns += 3.0 * in_row;
    const double sum = terms[k] + of_columns + 3.0 * (rows - k - 1.0) * in_row;
    const double mu = system.mu(v);
    const double shift =
        margin * unit_roundoff * sum * system.degree(v) + system.block_rounding(v) + mu;
    Matrix3 block = system.diagonal(v);
    for (int a = 0; a < 3; ++a) block(a, a) -= shift;
    front.block(k, k) += block;
    system.for_each_entry(v, [&](Index u, const Matrix3& off) {  // (v, u)
      const Index r = place[u];
      if (r > k) front.block(r, k) += off.transpose();
    });
    const double error = system.right_hand_side_rounding(v);
    clique.rounding += error * error / mu;
    clique.gamma += 3.0 * margin * unit_roundoff * in_row;
  }
  clique.nonzeros.clear();
  clique.terms.clear();
  for (Index r = columns; r < rows; ++r) {
    clique.nonzeros.push_back(nonzeros[r] + 3.0 * columns);
    clique.terms.push_back(terms[r] + of_columns);
  }
  for (Index r = 0; r < rows; ++r) place[clique.row(r)] = -1;
  const std::function<bool()> always;
  Interruption never(always);
  return dense(front.panel, pivots, below, front.rest, never) == CholeskyOutcome::positive_definite;
}

}  // namespace rotavg

#pragma GCC diagnostic pop
