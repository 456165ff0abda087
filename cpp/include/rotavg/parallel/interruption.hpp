#pragma once

#include <atomic>
#include <functional>
#include <thread>

namespace rotavg {

/// Asks whether to go on with work that several threads share: once in a while, as a question may
/// cost as much as thousands of multiplications, and only on the thread that made this object.
class Interruption {
 public:
  /// @param keep_going false stops; may be empty. Must outlive this object
  explicit Interruption(const std::function<bool()>& keep_going)
      : keep_going_(keep_going), asking_(std::this_thread::get_id()) {}

  /// Takes note of work done, and asks after every few million multiplications.
  bool goes_on(double multiplications) {
    constexpr double between_questions = 5e6;
    if (is_stopped() || !keep_going_ || std::this_thread::get_id() != asking_) {
      return !is_stopped();
    }
    since_question_ += multiplications;
    return since_question_ < between_questions || ask();
  }

  /// Asks at once.
  bool ask() {
    since_question_ = 0.0;
    if (!is_stopped() && keep_going_ && !keep_going_()) stopped_ = true;
    return !is_stopped();
  }

  bool is_stopped() const { return stopped_.load(std::memory_order_relaxed); }

 private:
  const std::function<bool()>& keep_going_;
  const std::thread::id asking_;
  double since_question_ = 0.0;
  std::atomic<bool> stopped_{false};
};

}  // namespace rotavg
