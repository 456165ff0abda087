#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include <rotavg/anisotropic/certificate_matrix.hpp>
#include <rotavg/certify/bound.hpp>
#include <rotavg/certify/complement_bound.hpp>
#include <rotavg/certify/operator_columns.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/parallel/huge_pages.hpp>
#include <rotavg/parallel/reduce.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The blocks of S row by row, one behind the other: 160 bytes an edge, for loops that go through
/// them many times.
struct CertificateRows {
  struct Entry {
    Matrix3 block;
    Index column;
  };

  explicit CertificateRows(const AnisotropicCertificateMatrix& S) {
    start.reserve(static_cast<std::size_t>(S.num_nodes()) + 1);
    entries.reserve(S.edges().size() * 2 + static_cast<std::size_t>(S.num_nodes()));
    for (Index a = 0; a < S.num_nodes(); ++a) {
      start.push_back(entries.size());
      S.add_row(a, [&](const Matrix3& block, Index b) { entries.push_back({block, b}); });
    }
    start.push_back(entries.size());
  }

  std::vector<std::size_t> start;  ///< (n + 1,)
  LargeVector<Entry> entries;
};

/// M = D^-1/2 S D^-1/2 of one component with full covariances, on the complement of D^1/2 N, N =
/// [I … I]^T, for the iterations that factorise nothing (certify/random_start.hpp); as
/// LocalOperator, but in the global frame. With D the scale of the nodes its spectrum is below 2:
/// an edge adds d^T W d - 2 x_i . p x x_j <= (2 |W| + |p|) (|x_i|^2 + |x_j|^2).
///
/// @tparam C columns
template <int C>
class GlobalOperator : public OperatorColumns<GlobalOperator<C>, C> {
 public:
  using Columns = OperatorColumns<GlobalOperator<C>, C>;
  using Block = typename Columns::Block;
  using Vectors = typename Columns::Vectors;

  /// @param S must outlive this object
  explicit GlobalOperator(const AnisotropicCertificateMatrix& S)
      : S_(&S), rows_(std::make_shared<const CertificateRows>(S)) {
    for (Index a = 0; a < num_nodes(); ++a) total_ += degree(a);
  }
  /// The same with other columns.
  template <int K>
  explicit GlobalOperator(const GlobalOperator<K>& other)
      : S_(other.S_), rows_(other.rows_), total_(other.total_) {}

  Index num_nodes() const { return S_->num_nodes(); }
  int num_threads() const { return S_->num_threads(); }
  /// Of the complement.
  Eigen::Index dimension() const { return S_->size() - 3; }
  double degree(Index a) const { return S_->scale(a); }
  Vector3 in_global_frame(Index, const Vector3& z) const { return z; }
  const Matrix3& in_own_frame(Index, const Matrix3& x) const { return x; }

  /// Bounds the rounding of one product, |computed - M y| <= rounding() |y|.
  double rounding() const {
    double worst = 0.0;
    for (Index a = 0; a < num_nodes(); ++a) {
      const double sums = 8.0 * (S_->num_edges_at(a) + 16.0) * unit_roundoff;
      worst = std::max(worst, S_->block_rounding(a) / degree(a) + sums);
    }
    return worst + this->rounding_of_sums();
  }

  /// result <- scale D^-1 S z + shift z + old result * factor
  void apply(const Vectors& z, double scale, double shift, double factor, Vectors& result) const {
    parallel_for(num_nodes(), num_threads(), [&](Index a) {
      Block sum = Block::Zero();
      for (std::size_t e = rows_->start[a]; e < rows_->start[a + 1]; ++e) {
        const CertificateRows::Entry& entry = rows_->entries[e];
        this->add_product(entry.block, z[entry.column], sum);
      }
      const double s = scale / degree(a);
      for (int k = 0; k < 3 * C; ++k) {
        result[a](k) = s * sum(k) + shift * z[a](k) + factor * result[a](k);
      }
    });
  }

  /// Onto the complement: N^T D z = 0.
  void project(Vectors& z) const {
    const auto mean = block_sum<Sums<3 * C>>(num_nodes(), this->node_threads(), [&](Index a) {
      Sums<3 * C> along;
      for (int k = 0; k < 3 * C; ++k) along.value[k] = degree(a) * z[a](k);
      return along;
    });
    parallel_for(num_nodes(), this->node_threads(), [&](Index a) {
      for (int k = 0; k < 3 * C; ++k) z[a](k) -= mean.value[k] / total_;
    });
  }

 private:
  template <int K>
  friend class GlobalOperator;

  const AnisotropicCertificateMatrix* S_;
  std::shared_ptr<const CertificateRows> rows_;
  double total_ = 0.0;
};

/// The bound that a random start gives, where it speaks for R. Of the rounding of K, the errors of
/// the edges are held against their W if it matters, as S >= kappa L_W with kappa as there.
///
/// @param resolution how small a gap has to be told from zero
inline ComponentBound bound_by_random_start(const AnisotropicCertificateMatrix& S,
                                            const GlobalOperator<3>& M, double cut,
                                            double resolution,
                                            const std::function<bool()>& keep_going) {
  const auto rounding_of = [cut](const AnisotropicCertificateMatrix& matrix) {
    double square = 0.0;
    for (Index a = 0; a < matrix.num_nodes(); ++a) {
      square += std::pow(matrix.leftover_rounding(a), 2) / matrix.scale(a);
    }
    return std::sqrt(square / cut) + std::sqrt(matrix.leftover_edge_rounding());
  };
  constexpr double small_part = 0.1;  // of the resolution
  double rounding = rounding_of(S);
  if (rounding * rounding > small_part * resolution) {
    const double kappa = cut / (cut + S.below_firm_edges());
    rounding = std::min(rounding, rounding_of(S.less_firm_edges(kappa)));
  }
  const Eigen::MatrixXd K = S.leftover();
  return ComplementBound(M, K, cut, keep_going)(rounding, resolution);
}

}  // namespace rotavg

#pragma GCC diagnostic pop
