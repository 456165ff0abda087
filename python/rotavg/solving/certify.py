"""A certificate for any rotations, whoever found them."""

from __future__ import annotations

from typing import Any

import numpy as np

from rotavg import _core
from rotavg.base.errors import OptionError
from rotavg.graph.covariances import precision_of_weight_one
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.grounded import ground
from rotavg.priors.priors import Priors
from rotavg.solving import options
from rotavg.solving.anisotropic import given_precisions
from rotavg.solving.certificate import Certificate, certificate_from_core
from rotavg.solving.core_call import NodeRotations, call_core, node_rotations


def certify(
    graph: MeasurementGraph,
    rotations: NodeRotations,
    *,
    priors: Priors | None = None,
    anisotropic: bool = False,
    tolerance: float = 1e-6,
    failure_probability: float = 1e-12,
    seed: int = 0,
    max_flops: float = 1e12,
    time_limit: float | None = None,
    num_threads: int | None = None,
) -> Certificate:
    """Bound how far any rotations are from the global optimum, whoever found them.

    Args:
        graph: the measurements.
        rotations: (n, 3, 3) world_from_node, rows as in `graph.nodes`; or a solution or a dict,
            which have them by id. They need not be stationary.
        priors: what is known beforehand: then the rotations are in the world of the priors, and the
            bound is that of the problem with them.
        anisotropic: whether for the objective with the full covariances of the graph (see `solve`).
        tolerance: the largest relative gap that is called optimal.
        failure_probability: how large a chance of being wrong a proof may have where one without
            would cost much more; 0 for none: then there may only be an estimate.
        seed: of the random start of such a proof.
        max_flops: no factorisation takes more operations than this.
        time_limit: limit in seconds; the verdict is "not_certified" where it is hit.
        num_threads: None for all processors.

    Raises:
        GraphError: if these are not n rotations, or not where `priors` hold them.
        OptionError: for an option out of range.
    """
    if not isinstance(anisotropic, (bool, np.bool_)):
        raise OptionError(f"anisotropic is {anisotropic!r}; expected True or False")
    grounded = None if priors is None else ground(graph, priors)
    limits: dict[str, Any] = {
        "tolerance": options.nonnegative("tolerance", tolerance),
        "max_flops": options.nonnegative("max_flops", max_flops),
        "time_limit": options.seconds(time_limit),
        "num_threads": options.threads(num_threads),
    }
    R = node_rotations(graph, rotations, "rotations")
    precisions, unit = None, 1.0
    if anisotropic:
        precisions = given_precisions(graph)
        assert graph.covariances is not None
        unit = precision_of_weight_one(graph.covariances, graph.weights)
    core = call_core(
        graph,
        _core.certify,
        R,
        failure_probability=options.probability("failure_probability", failure_probability),
        seed=options.whole("seed", seed, 0, 2**64 - 1),
        priors=None if grounded is None else grounded.core,
        precisions=precisions,
        prior_precision=unit,
        **limits,
    )
    certificate = certificate_from_core(core, tolerance)
    assert certificate is not None
    return certificate
