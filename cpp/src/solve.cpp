// What rotavg::compiled holds (rotavg/compiled.hpp), one half: the solvers.

#include <rotavg/robust/solve_rigs_impl.hpp>
#include <rotavg/robust/solve_robust_impl.hpp>
#include <rotavg/robust/solve_robust_with_priors_impl.hpp>
#include <rotavg/so3/nearest_impl.hpp>
#include <rotavg/solve/solve_impl.hpp>
#include <rotavg/solve/solve_with_priors_impl.hpp>
