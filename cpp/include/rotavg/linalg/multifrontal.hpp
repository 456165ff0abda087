#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/buffer.hpp>
#include <rotavg/linalg/cholesky_rounding.hpp>
#include <rotavg/linalg/front.hpp>
#include <rotavg/linalg/partial_cholesky.hpp>
#include <rotavg/linalg/subtrees.hpp>
#include <rotavg/linalg/symbolic_cholesky.hpp>
#include <rotavg/parallel/interruption.hpp>
#include <rotavg/parallel/threads.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The multifrontal method (Duff and Reid 1983; Liu 1992) for P (A + shift I) P^T = L L^T, A of
/// B x B blocks: supernode by supernode, children first, the entries of its columns and what its
/// children left over are summed into a dense front, whose columns are factorised, and whose rest
/// is left for the parent. Threads share subtrees, and above them the fronts; every sum has its
/// order, whoever computes it. Nothing above a supernode needs its columns of L again: whether they
/// are kept is the caller's choice.
template <int B>
class Multifrontal {
 public:
  using Blocks = std::vector<Eigen::Matrix<double, B, B>>;

  explicit Multifrontal(std::shared_ptr<const SymbolicCholesky> symbolic, int num_threads)
      : symbolic_(std::move(symbolic)),
        num_threads_(num_threads),
        subtrees_(*symbolic_, B, num_threads),
        places_(*symbolic_, subtrees_,
                [](const Supernode& node) { return square(B * node.below.size()); }),
        stack_(places_.size) {}

  const Subtrees& subtrees() const { return subtrees_; }

  /// @param A the blocks of the lower triangle, in the order of BlockPattern::row; diagonal blocks
  ///        are symmetric
  /// @param keep_going asked every few milliseconds, on this thread; false stops
  /// @param make_panels called by each thread for a function that says where the columns of a
  ///        supernode go, `double* panel_of(Index s)`: B rows() times B columns() numbers
  template <typename MakePanels>
  CholeskyOutcome factorize(const Blocks& A, double shift, const std::function<bool()>& keep_going,
                            MakePanels&& make_panels) {
    Interruption interruption(keep_going);
    if (!interruption.ask()) return CholeskyOutcome::stopped;
    const int num_threads = threads_for(num_threads_, subtrees_.work());
    std::atomic<CholeskyOutcome> outcome{CholeskyOutcome::positive_definite};
    const auto eliminate = [&](Index s, auto& panel_of, PartialCholesky& dense, int threads) {
      if (outcome != CholeskyOutcome::positive_definite) return;
      const auto of_this = this->eliminate(s, A, shift, panel_of(s), dense, interruption, threads);
      if (of_this != CholeskyOutcome::positive_definite) outcome = of_this;
    };
    subtrees_.rise(
        num_threads,
        [&](const Subtrees::Range& range) {
          PartialCholesky dense;
          auto panel_of = make_panels();
          for (Index s = range.begin; s < range.end; ++s) eliminate(s, panel_of, dense, 1);
        },
        [&, dense = PartialCholesky(), panel_of = make_panels()](Index s) mutable {
          eliminate(s, panel_of, dense, num_threads);
        },
        [&] { interruption.ask(); });
    return interruption.is_stopped() ? CholeskyOutcome::stopped : outcome.load();
  }

 private:
  static std::size_t square(std::size_t size) { return size * size; }

  /// Sums the front of supernode s, and factorises its columns.
  /// @param panel receives the columns
  ROTAVG_ONE_COPY CholeskyOutcome eliminate(Index s, const Blocks& A, double shift, double* panel,
                                            PartialCholesky& dense, Interruption& interruption,
                                            int num_threads) {
    const Supernode& node = symbolic_->supernodes()[s];
    const Index pivots = B * node.columns(), below = B * node.num_below();
    const Front<B> front{panel, pivots, below, stack_.data() + places_.front[s]};
    const std::size_t rest_size = square(below);
    num_threads = threads_for(num_threads, B * B * B * node.work());
    front.set_zero(num_threads);
    for (Index k = node.begin; k < node.end; ++k) {
      const Index column = k - node.begin;
      for (auto e = symbolic_->entries_begin(k); e != symbolic_->entries_end(k); ++e) {
        auto target = front.block(e->place, column);
        if (e->transposed) {
          target += A[e->index].transpose();
        } else {
          target += A[e->index];
        }
      }
      if (shift != 0.0) front.block(column, column).diagonal().array() += shift;
    }
    symbolic_->for_each_child(s, [&](Index child) {
      front.add(symbolic_->supernodes()[child].in_parent, stack_.data() + places_.left_over[child],
                num_threads);
    });
    const auto outcome = dense(front.panel, pivots, below, front.rest, interruption, num_threads);
    // The rest takes the place of what the children left over.
    double* const left_over = stack_.data() + places_.left_over[s];
    if (left_over != front.rest) std::copy_n(front.rest, rest_size, left_over);
    return outcome;
  }

  std::shared_ptr<const SymbolicCholesky> symbolic_;
  int num_threads_;
  Subtrees subtrees_;
  FrontStacks places_;
  Buffer stack_;  // of fronts, and of what is left over for parents
};

/// Whether A is positive definite, by a factorisation of which nothing is kept: beside A there is
/// memory for the fronts that wait and for the columns at hand, which the next ones replace.
template <int B>
CholeskyOutcome definiteness(const std::shared_ptr<const SymbolicCholesky>& symbolic,
                             const typename Multifrontal<B>::Blocks& A, int num_threads,
                             const std::function<bool()>& keep_going) {
  const auto panel_size = [&symbolic](Index s) {
    const Supernode& node = symbolic->supernodes()[s];
    return static_cast<std::size_t>(B * node.rows()) * (B * node.columns());
  };
  std::size_t largest = 0;
  for (Index s = 0; s < static_cast<Index>(symbolic->supernodes().size()); ++s) {
    largest = std::max(largest, panel_size(s));
  }
  return Multifrontal<B>(symbolic, num_threads).factorize(A, 0.0, keep_going, [&] {
    return [&panel_size, largest, scratch = Buffer(), size = std::size_t{0}](Index s) mutable {
      if (panel_size(s) > size) {  // they grow towards the roots
        size = std::min(2 * panel_size(s), largest);
        scratch = Buffer();
        scratch = Buffer(size);
      }
      return scratch.data();
    };
  });
}

}  // namespace rotavg

#pragma GCC diagnostic pop
