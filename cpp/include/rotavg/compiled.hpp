#pragma once

/// How a program comes to the entry points of the library: nearest_rotation(),
/// algebraic_connectivity(), certify(), solve(), solve_robust(), estimate_rigs(), solve_rigs(),
/// refine_anisotropic(), covariances(), marginal_covariances(), positions() and the class Online.
/// Their headers hold the contract; the header of the same name with `_impl` holds the definition.
///
/// Header-only (the CMake target rotavg::rotavg), the one includes the other. With ROTAVG_COMPILED
/// defined (rotavg::compiled does), it does not: the definitions are compiled once, in cpp/src.
#ifdef ROTAVG_COMPILED
#define ROTAVG_INLINE
#else
#define ROTAVG_INLINE inline
#endif
