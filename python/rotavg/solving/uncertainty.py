"""How well a solution's rotations are known: covariances from the Hessian at the optimum."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.errors import GraphError, OptionError, SolverError
from rotavg.base.memory import check_memory
from rotavg.graph.covariances import information, precision_of_weight_one
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.grounded import Grounded
from rotavg.solving.robust import PriorFit
from rotavg.solving.solved import Solved

_BYTES_PER_PAIR = 250  # at most at a time: the pairs, the core's result and the one in its frame

Frame = Literal["world", "node"]
Fits = tuple[Optional[PriorFit], Optional[PriorFit]]  # of absolute priors, and of gravity


def covariances(
    solution: Solved, pairs: ArrayLike | None, noise_variance: float | None, frame: Frame
) -> NDArray[np.float64]:
    """See `Solution.covariances`."""
    if frame not in ("world", "node"):
        raise OptionError(f"frame is {frame!r}, expected 'world' or 'node'")
    if pairs is not None:
        count = pairs.size // 2 if isinstance(pairs, np.ndarray) else 0
        check_memory(f"the covariances of {count} pairs", _BYTES_PER_PAIR * count, SolverError)
    rows = None if pairs is None else _rows(solution, pairs)
    graph, grounded, robust = solution.graph, solution.grounded, solution.robust
    if robust is not None:
        # What is distrusted counts for nothing, but keeps the parts of the graph together.
        graph = graph.with_weights(graph.weights * np.where(solution.is_outlier, 1e-6, 1.0))
    try:
        variance = _noise_variance(solution, noise_variance, _fits(solution))
        found = _found(solution, rows, variance, graph, grounded)
        if found is None and robust is not None and grounded is not None:
            # Priors may contradict one another and none be an outlier, where there are few: then
            # they have the weights that are left of them, and the noise is that of the edges.
            absolute, gravity = fits = _fits(solution)
            without = _disbelieved(absolute), _disbelieved(gravity)
            variance = _noise_variance(solution, noise_variance, without)
            final = grounded.with_prior_weights(*(None if f is None else f.weights for f in fits))
            found = _found(solution, rows, variance, graph, final)
    except _core.TooLarge as error:
        raise SolverError(str(error)) from None
    if found is None:
        raise SolverError(
            "the rotations are no strict minimum of the objective (its Hessian is not positive "
            "definite), so that they have no covariances"
        )
    if frame == "node":
        R = solution.rotations if rows is None else solution.rotations[rows[:, 1]]
        found = np.swapaxes(R, 1, 2) @ found @ R
    return found


def _found(
    solution: Solved,
    rows: NDArray[np.int64] | None,
    variance: float,
    graph: MeasurementGraph,
    grounded: Grounded | None,
) -> NDArray[np.float64] | None:
    """Covariances of a problem with other weights; None where there is no strict minimum."""
    information = None if solution.isotropic is None else _information(solution)
    if grounded is not None:
        return grounded.with_weights(graph.weights).covariances(
            solution.rotations,
            None if rows is None else _indices(rows),
            noise_variance=variance,
            num_threads=1,
            information=information,
            prior_information=_prior_information(solution),
        )
    return _core.covariances(
        graph._core,
        solution.rotations,
        _indices(_from_roots(solution.component) if rows is None else rows),
        noise_variance=variance,
        information=information,
        num_threads=1,
    )


def rms_degrees(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k,) root mean square of the error angle, degrees, of covariances (k, 3, 3), radians^2."""
    return np.asarray(np.degrees(np.sqrt(np.trace(covariances, axis1=1, axis2=2))))


def beyond_half_a_turn(rms: NDArray[np.float64]) -> str:
    """What to say of RMS angles (k,), degrees, some of which are more than rotations can be off."""
    count = int((rms > 180.0).sum())
    return (
        f"{count} of {len(rms)} beyond 180 deg, which no rotation can be off by: nothing is known "
        "of them, or the noise variance is not that of an edge of weight 1 in radians^2 per axis"
    )


def _fits(solution: Solved) -> Fits:
    fit = solution.robust
    return (None, None) if fit is None else (fit.absolute_priors, fit.gravity_priors)


def _disbelieved(fit: PriorFit | None) -> PriorFit | None:
    return fit and replace(fit, is_outlier=np.ones(len(fit.nodes), dtype=bool))


def estimated_noise_variance(solution: Solved, fits: Fits | None = None) -> float:
    """Variance per axis, radians^2, of the noise of an edge of weight 1: NaN for a forest.

    With anisotropic noise: what the covariances are to be multiplied by.
    The sum of w |2 sin(angle / 2)|^2 over its degrees of freedom, 3 (m - n + components); with a
    robust loss of the edges that are no outliers, and of the parts that they hold together.
    `fits` tells which absolute priors and which gravity are outliers; by default the solution does.
    """
    trusted = ~solution.is_outlier
    fits = _fits(solution) if fits is None else fits
    if solution.isotropic is not None and solution.grounded is not None:
        freedom = solution.grounded.degrees_of_freedom(trusted, *fits)
        return solution.objective / freedom if freedom > 0 else float("nan")
    if solution.isotropic is not None:
        freedom = 3 * (int(trusted.sum()) - solution.graph.num_nodes + solution.num_components)
        return solution.objective / freedom if freedom > 0 else float("nan")
    if solution.grounded is not None:
        return solution.grounded.noise_variance(solution.rotations, trusted, *fits)
    parts = solution.num_components if solution.robust is None else solution.robust.num_parts
    freedom = 3 * (int(trusted.sum()) - solution.graph.num_nodes + parts)
    if freedom <= 0:
        return float("nan")
    chords = 2 * np.sin(solution.residual_angles[trusted] / 2)
    return float(np.sum(solution.graph.weights[trusted] * chords**2) / freedom)


def _from_roots(component: NDArray[np.int32]) -> NDArray[np.int64]:
    """Pairs (n, 2) of the first node of every node's component and the node itself."""
    first = np.unique(component, return_index=True)[1]
    return np.stack([first[component], np.arange(len(component))], axis=1)


def _indices(pairs: NDArray[np.int64]) -> NDArray[np.int32]:
    return np.ascontiguousarray(pairs, dtype=np.int32)


def _information(solution: Solved) -> NDArray[np.float64]:
    assert solution.graph.covariances is not None
    return information(solution.graph.covariances, np.where(solution.is_outlier, 1e-6, 1.0))


def _prior_information(solution: Solved) -> float:
    C = solution.graph.covariances
    if solution.isotropic is None or C is None:
        return 1.0
    return precision_of_weight_one(C, solution.graph.weights)


def _noise_variance(solution: Solved, given: float | None, fits: Fits) -> float:
    if given is not None:
        if isinstance(given, (int, float, np.number)) and 0 < given < np.inf:
            return float(given)
        raise OptionError(f"noise_variance is {given!r}, expected a positive number or None")
    estimate = estimated_noise_variance(solution, fits)
    if np.isnan(estimate):
        raise SolverError(
            "the graph has no cycles, so that all measurements are met exactly and the noise "
            "cannot be estimated: give noise_variance, that of an edge of weight 1"
        )
    return estimate


def _rows(solution: Solved, pairs: ArrayLike) -> NDArray[np.int64]:
    ids = as_ids(pairs, "pairs")
    if ids.ndim != 2 or ids.shape[1] != 2:
        raise GraphError(f"pairs have shape {ids.shape}, expected (k, 2)")
    rows = rows_of(ids, solution.graph.nodes)
    if (rows < 0).any():
        raise GraphError(f"node {ids.flat[np.argmin(rows)].item()!r} is not in the graph")
    label = solution.component[rows]
    apart = label[:, 0] != label[:, 1]
    if apart.any():
        a, b = ids[np.argmax(apart)].tolist()
        raise GraphError(
            f"nodes {a!r} and {b!r} are in different components: their rotations are not known "
            "relative to each other"
        )
    return rows
