#pragma once

#include <chrono>
#include <functional>
#include <optional>

#include <pybind11/pybind11.h>

#include "gil.hpp"

namespace rotavg_python {

/// Lets Ctrl-C end a computation that runs without the GIL. `keep_going` asks Python for pending
/// signals at most every 50 ms; once the computation has come back, `rethrow` raises what a signal
/// handler raised (KeyboardInterrupt).
class SignalCheck {
 public:
  std::function<bool()> keep_going() {
    return [this] {
      if (error_) return false;
      const auto now = std::chrono::steady_clock::now();
      if (now < next_) return true;
      next_ = now + std::chrono::milliseconds(50);
      const WithGil gil;
      if (PyErr_CheckSignals() != 0) error_.emplace();
      return !error_;
    };
  }

  /// Whether it was Ctrl-C, and not what another handler raised. Needs the GIL.
  bool is_keyboard_interrupt() const { return error_ && error_->matches(PyExc_KeyboardInterrupt); }

  /// Needs the GIL.
  void rethrow() {
    if (error_) throw *error_;
  }

 private:
  std::optional<pybind11::error_already_set> error_;
  std::chrono::steady_clock::time_point next_{};
};

}  // namespace rotavg_python
