#pragma once

#include <memory>
#include <utility>

#include <rotavg/solve/options.hpp>
#include <rotavg/solve/solution.hpp>

namespace rotavg {

/// Remembers that a callback has returned false, for what consists of several runs: the one that
/// was told may have converged at that very iteration, and the next would not know.
class StopRequest {
 public:
  /// The options with a callback that is not called again once it has returned false.
  SolveOptions heeding(SolveOptions options) const {
    ProgressCallback& callback = options.iteration.callback;
    if (callback) {
      callback = [made = made_, given = std::move(callback)](const Progress& progress) {
        *made = *made || !given(progress);
        return !*made;
      };
    }
    return options;
  }

  /// Whether it has.
  bool made() const { return *made_; }

  /// Tells of it what it has cut short.
  /// @param chooses whether another run would have followed where this one is not certified
  void tell(Solution& solution, bool chooses) const {
    const bool is_done = is_converged(solution.status) &&
                         !(chooses && solution.certificate.verdict == Verdict::not_certified);
    if (made() && !is_done) solution.status = Status::stopped;
  }

 private:
  std::shared_ptr<bool> made_ = std::make_shared<bool>(false);
};

}  // namespace rotavg
