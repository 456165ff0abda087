#pragma once

#include <chrono>
#include <optional>
#include <thread>

#include <pybind11/pybind11.h>
#ifdef __GLIBCXX__
#include <cxxabi.h>
#endif

namespace rotavg_python {

[[noreturn]] inline void sleep_until_the_program_is_gone() {
  for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
}

/// What f returns. f asks for Python's lock (the GIL), or runs Python.
///
/// Where a program ends while a daemon thread computes, Python before 3.14 ends that thread as soon
/// as it asks for the lock, by unwinding its stack. That must not go through destructors, nor
/// through what helpers still work on: the program would abort. The thread sleeps until the program
/// is gone, as it does from Python 3.14 on. Once Python has taken itself down, it has no lock left
/// that could be asked for, and the thread sleeps at once.
template <typename Function>
auto unless_the_program_ends(Function&& f) {
  if (!Py_IsInitialized()) sleep_until_the_program_is_gone();
#ifdef __GLIBCXX__
  try {
    return f();
  } catch (abi::__forced_unwind&) {
    sleep_until_the_program_is_gone();
  }
#else
  return f();
#endif
}

/// Without the GIL from here to the end of the scope.
class WithoutGil {
 public:
  WithoutGil() : state_(PyEval_SaveThread()) {}
  ~WithoutGil() {
    unless_the_program_ends([this] { PyEval_RestoreThread(state_); });
  }
  WithoutGil(const WithoutGil&) = delete;
  WithoutGil& operator=(const WithoutGil&) = delete;

 private:
  PyThreadState* state_;
};

/// With the GIL from here to the end of the scope.
class WithGil {
 public:
  WithGil() {
    unless_the_program_ends([this] { gil_.emplace(); });
  }

 private:
  std::optional<pybind11::gil_scoped_acquire> gil_;
};

}  // namespace rotavg_python
