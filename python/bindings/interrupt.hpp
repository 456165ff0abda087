#pragma once

#include <chrono>
#include <functional>

#include <pybind11/pybind11.h>

namespace rotavg_python {

/// Lets Ctrl-C end a computation that runs without the GIL. `keep_going` asks Python for pending
/// signals at most every 50 ms; once the computation has come back, `rethrow` raises what a signal
/// handler raised (KeyboardInterrupt).
class SignalCheck {
 public:
  std::function<bool()> keep_going() {
    return [this] {
      if (interrupted_) return false;
      const auto now = std::chrono::steady_clock::now();
      if (now < next_) return true;
      next_ = now + std::chrono::milliseconds(50);
      const pybind11::gil_scoped_acquire gil;
      interrupted_ = PyErr_CheckSignals() != 0;
      if (interrupted_) PyErr_Fetch(&type_, &value_, &traceback_);
      return !interrupted_;
    };
  }

  /// Needs the GIL.
  void rethrow() {
    if (!interrupted_) return;
    PyErr_Restore(type_, value_, traceback_);
    throw pybind11::error_already_set();
  }

 private:
  bool interrupted_ = false;
  std::chrono::steady_clock::time_point next_{};
  PyObject* type_ = nullptr;
  PyObject* value_ = nullptr;
  PyObject* traceback_ = nullptr;
};

}  // namespace rotavg_python
