// What rotavg::compiled holds (rotavg/compiled.hpp), the other half: what is told of a
// solution, refine_anisotropic() and algebraic_connectivity().

#include <rotavg/certify/certificate_impl.hpp>
#include <rotavg/certify/certify_with_priors_impl.hpp>
#include <rotavg/graph/algebraic_connectivity_impl.hpp>
#include <rotavg/solve/anisotropic_impl.hpp>
#include <rotavg/uncertainty/covariance_impl.hpp>
#include <rotavg/uncertainty/covariance_with_priors_impl.hpp>
