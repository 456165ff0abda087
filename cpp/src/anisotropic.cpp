// What rotavg::compiled holds (rotavg/compiled.hpp), a third part: full covariances.

#include <rotavg/anisotropic/certify_impl.hpp>
#include <rotavg/anisotropic/solve_impl.hpp>
#include <rotavg/anisotropic/with_priors_impl.hpp>
