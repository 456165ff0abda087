#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/graph/widest_level.hpp>
#include <rotavg/linalg/subtrees.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/parallel/threads.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// Graphs of at most so many edges at a node, on average, are sparse: their Laplacians factor at
/// little cost, unless they fill in.
constexpr double sparse_degree = 20.0;

/// What all matrices of one component share, its scalar Laplacian and those of 3 x 3 blocks alike:
/// the sparsity pattern, the order of elimination and the elimination tree. Each is computed when
/// it is first asked for.
class Elimination {
 public:
  /// @param graph, components must outlive this object
  /// @param skipped so many of the component's first nodes have no rows in the matrices; without
  ///        the first, the root, a Laplacian is positive definite
  /// @param num_threads that assemble and factorise the matrices, where there is work for them
  Elimination(const MeasurementGraph& graph, const Components& components, Index component,
              Index skipped = 1, int num_threads = 1)
      : graph_(&graph),
        components_(&components),
        component_(component),
        skipped_(skipped),
        num_threads_(num_threads) {}

  Index component() const { return component_; }
  Index skipped() const { return skipped_; }
  int num_threads() const { return num_threads_; }
  /// Number of rows of blocks.
  Index size() const { return static_cast<Index>(all_nodes().size()) - skipped_; }
  /// The component's first node.
  Index root() const { return all_nodes().front(); }
  /// The node of row a.
  Index node(Index a) const { return all_nodes()[a + skipped_]; }

  /// Floating-point operations that a factorisation with blocks of size B takes. Cheap where it is
  /// certain that they are more than `limit`: then only a lower bound, above the limit, is
  /// returned.
  double flops(int B, double limit) {
    if (size() == 0) return 0.0;
    if (!has_order()) {
      const double lower_bound = least_flops(B);
      if (lower_bound > limit) return lower_bound;
    }
    return operations(B) * order().multiplications;
  }

  /// Entries of the factor below its diagonal, in blocks.
  double nonzeros() { return size() == 0 ? 0.0 : order().nonzeros; }

  /// Whether the order has been asked for, so that flops() costs nothing.
  bool has_order() const { return is_asked_; }

  /// Makes the order and its analysis ready, on a thread beside others, unless they seem to be more
  /// than so many operations of the Laplacian are worth. Nothing changes for who asks afterwards,
  /// but that it is there; nobody may ask meanwhile. Without the memory for it, nothing is.
  void prepare(double max_flops) try {
    if (size() == 0 || likely_flops(1) > max_flops || least_flops(1) > max_flops) return;
    if (!order_) order_ = elimination_order(pattern());
    if (operations(1) * order_->multiplications <= max_flops) analyse();
  } catch (const std::bad_alloc&) {
    pattern_ = {};
    order_.reset();
    symbolic_.reset();
  }

  /// What flops() will be, about, by a look at the graph, before any order is sought. Of random
  /// graphs, whose largest front takes most of it, within a factor of six; of preferential
  /// attachment and small worlds up to seven and twenty times too much; of lattices and cities far
  /// too little, as they have many fronts like the largest, and of trees of dense parts far too
  /// much.
  /// @param B size of the blocks
  double likely_flops(int B) {
    if (!likely_front_) likely_front_ = likely_front();
    return B * B * B * std::pow(*likely_front_, 3) / 3.0;
  }

  /// Bytes that a factorisation with blocks of size B takes: the factor, the fronts that wait, and
  /// the matrix; of a small one, about.
  double factor_bytes(int B) {
    if (size() == 0) return 0.0;
    constexpr double small = 1e7, fronts = 1.5;
    const double bytes = B * B * sizeof(double);
    const double matrix = bytes * static_cast<double>(pattern().row.size());
    const double about = bytes * (fronts * nonzeros() + size());
    if (about < small) return about + matrix;
    double factor = 0.0;
    for (const Supernode& node : symbolic()->supernodes()) {
      factor += bytes * static_cast<double>(node.rows()) * node.columns();
    }
    return factor + waiting_bytes(B);
  }

  /// The same where the factor is not kept (definiteness()), but for the columns at hand.
  double definiteness_bytes(int B) {
    double largest = 0.0;
    for (const Supernode& node : symbolic()->supernodes()) {
      largest = std::max(largest, static_cast<double>(node.rows()) * node.columns());
    }
    return waiting_bytes(B) + B * B * sizeof(double) * largest * num_threads_;
  }

  const BlockPattern& pattern() {
    if (pattern_.size() == 0 && size() > 0) build_pattern();
    return pattern_;
  }

  std::shared_ptr<const SymbolicCholesky> symbolic() {
    order();
    analyse();
    return symbolic_;
  }

  /// The blocks, in the order of pattern().row, of the matrix with `diagonal(i)` at node i, and for
  /// every edge k `off_diagonal(k)` in the row of its end i and the column of its end j, and the
  /// transpose on the other side. Parallel edges add up.
  template <int B, typename Diagonal, typename OffDiagonal>
  std::vector<Eigen::Matrix<double, B, B>> assemble(Diagonal&& diagonal,
                                                    OffDiagonal&& off_diagonal) {
    using Block = Eigen::Matrix<double, B, B>;
    std::vector<Block> blocks(pattern().row.size());  // which who writes there touches first
    const double work = 10.0 * B * B * static_cast<double>(places_.size());
    parallel_for(size(), threads_for(num_threads_, work), [&](Index a) {
      blocks[pattern_.start[a]] = diagonal(node(a));
      for (Index p = first_place_[a]; p < first_place_[a + 1]; ++p) {
        blocks[places_[p].entry].setZero();
      }
      for (Index p = first_place_[a]; p < first_place_[a + 1]; ++p) {
        const Place& place = places_[p];
        const Block block = off_diagonal(place.edge);
        if (row_of(graph_->edges()[place.edge].i) == place.column) {
          blocks[place.entry] += block.transpose();
        } else {
          blocks[place.entry] += block;
        }
      }
    });
    return blocks;
  }

 private:
  /// Of so many multiplications of blocks, each with an addition.
  static double operations(int B) { return 2.0 * B * B * B; }

  /// What flops() is at least: column j takes |L_j|^2 / 2 multiplications or more; with N columns
  /// and q entries, sum_j |L_j|^2 >= q^2 / N (Cauchy-Schwarz).
  double least_flops(int B) {
    const double q = num_entries();
    return 0.5 * operations(B) * q * q / size();
  }

  const EliminationOrder& order() {
    is_asked_ = true;
    if (!order_) order_ = elimination_order(pattern());
    return *order_;
  }
  void analyse() {
    if (!symbolic_) symbolic_ = std::make_shared<SymbolicCholesky>(pattern(), *order_);
  }

  /// Of the matrix, and of the fronts that wait.
  double waiting_bytes(int B) {
    const FrontStacks stacks(
        *symbolic(), Subtrees(*symbolic_, B, /*num_threads=*/1),
        [](const Supernode& node) { return node.below.size() * node.below.size(); });
    const auto blocks = static_cast<double>(stacks.size + pattern().row.size());
    return B * B * sizeof(double) * blocks;
  }

  /// About how many nodes the largest front has: some of the widest level, and fewer on chains and
  /// trees, which are wide as well, but have few independent cycles.
  double likely_front() const {
    constexpr double of_level = 0.7, of_cycles = 0.3;
    double neighbours = 0.0;  // parallel edges count as one
    std::vector<Index> seen_by(all_nodes().size(), -1);
    for (const Index i : all_nodes()) {
      for (const HalfEdge& h : graph_->row(i)) {
        neighbours += std::exchange(seen_by[components_->row_in_component[h.node]], i) != i;
      }
    }
    const double cycles = 0.5 * neighbours - static_cast<double>(all_nodes().size()) + 1.0;
    if (!(cycles > 0.0)) return 0.0;
    return std::min(of_level * widest_level(*graph_, *components_, component_, skipped_),
                    of_cycles * cycles);
  }

  struct Place {
    Index edge;
    Index entry;   // in pattern_.row
    Index column;  // of the entry
  };

  const std::vector<Index>& all_nodes() const { return components_->nodes[component_]; }
  Index row_of(Index node) const { return components_->row_in_component[node] - skipped_; }

  /// Entries of the pattern, counted without building it.
  double num_entries() {
    if (num_entries_ == 0.0) {
      std::vector<Index> last_column(static_cast<std::size_t>(size()), -1);  // of each row
      for (Index a = 0; a < size(); ++a) {
        num_entries_ += 1.0;  // the diagonal
        for (const HalfEdge& h : graph_->row(node(a))) {
          const Index b = row_of(h.node);
          if (b > a && std::exchange(last_column[b], a) != a) num_entries_ += 1.0;
        }
      }
    }
    return num_entries_;
  }

  /// Row by row, so that the rows of every column rise.
  void build_pattern() {
    const Index n = size();
    std::vector<Index> begin(static_cast<std::size_t>(n) + 1, 0);  // with parallel edges
    for (Index a = 0; a < n; ++a) {
      Index above = 1;  // the diagonal
      for (const HalfEdge& h : graph_->row(node(a))) above += row_of(h.node) > a;
      begin[a + 1] = begin[a] + above;
    }
    std::vector<Index> row(static_cast<std::size_t>(begin[n])), end(begin.begin(), begin.end() - 1);
    places_.clear();
    places_.reserve(row.size() - n);
    first_place_.assign(1, 0);
    for (Index a = 0; a < n; ++a) {
      row[end[a]++] = a;
      for (const HalfEdge& h : graph_->row(node(a))) {
        const Index b = row_of(h.node);
        if (b < 0 || b >= a) continue;
        if (row[end[b] - 1] != a) row[end[b]++] = a;
        places_.push_back({h.edge(), end[b] - 1, b});
      }
      first_place_.push_back(static_cast<Index>(places_.size()));
    }
    // Without the room that parallel edges would have taken.
    std::vector<Index> moved_by(static_cast<std::size_t>(n));
    pattern_.row.reserve(row.size());
    for (Index a = 0; a < n; ++a) {
      moved_by[a] = begin[a] - static_cast<Index>(pattern_.row.size());
      pattern_.row.insert(pattern_.row.end(), row.begin() + begin[a], row.begin() + end[a]);
      pattern_.start.push_back(static_cast<Index>(pattern_.row.size()));
    }
    if (pattern_.row.size() == row.size()) return;
    for (Place& place : places_) place.entry -= moved_by[place.column];
  }

  const MeasurementGraph* graph_;
  const Components* components_;
  Index component_, skipped_;
  int num_threads_;
  double num_entries_ = 0.0;
  BlockPattern pattern_;
  std::vector<Place> places_;
  std::vector<Index> first_place_;  // of every row; other rows have other entries
  std::optional<double> likely_front_;
  std::optional<EliminationOrder> order_;
  bool is_asked_ = false;
  std::shared_ptr<const SymbolicCholesky> symbolic_;
};

/// One for each component, without its root.
inline std::vector<Elimination> grounded_eliminations(const MeasurementGraph& graph,
                                                      const Components& components,
                                                      int num_threads = 1) {
  std::vector<Elimination> eliminations;
  for (Index c = 0; c < components.size(); ++c) {
    eliminations.emplace_back(graph, components, c, /*skipped=*/1, num_threads);
  }
  return eliminations;
}

}  // namespace rotavg

#pragma GCC diagnostic pop
