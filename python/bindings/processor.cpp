#include <pybind11/pybind11.h>

namespace {

bool runs_avx2_core() {
#ifdef ROTAVG_HAS_AVX2_CORE
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
  return false;
#endif
}

}  // namespace

PYBIND11_MODULE(_processor, m) {
  m.doc() = "What this processor can run. For rotavg/_core.py.";
  m.def("runs_avx2_core", &runs_avx2_core);
}
