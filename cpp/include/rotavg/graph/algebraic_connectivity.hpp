#pragma once

#include <functional>

#include <rotavg/compiled.hpp>
#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// lambda_2(L) of one component, its algebraic connectivity (Fiedler 1973): the larger, the easier
/// the averaging (Wilson, Bindel and Snavely 2016). NaN for a single node, or if the work was
/// stopped.
ROTAVG_INLINE double algebraic_connectivity(const MeasurementGraph& graph,
                                            const Components& components, Index component,
                                            const std::function<bool()>& keep_going = {});

}  // namespace rotavg

#ifndef ROTAVG_COMPILED
#include <rotavg/graph/algebraic_connectivity_impl.hpp>
#endif
