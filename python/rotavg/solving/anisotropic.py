"""Full covariances of the measurements: the same algorithms on matrix weights, and logarithms."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.base.errors import OptionError
from rotavg.graph.covariances import NOT_USED, information, precision_of_weight_one
from rotavg.graph.ids import edge_error
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.rigs import with_frames_of
from rotavg.solving.certificate import certificate_from_core
from rotavg.solving.problem import Problem
from rotavg.solving.solution import Solution
from rotavg.solving.status import Status, Timings, Trace
from rotavg.solving.stop_request import asks_to_stop

# How far the start, the problem with one weight for each edge, is solved: radians.
START_TOLERANCE = 1e-6
# Radians^2: their inverses are numbers that can be computed with.
LARGEST_COVARIANCE = 1e80


def check(graph: MeasurementGraph, anisotropic: object) -> None:
    """Refuse what full covariances do not go with.

    Raises OptionError for the option or a graph without, GraphError for an extreme covariance.
    """
    if anisotropic not in (True, "log"):
        raise OptionError(f"anisotropic is {anisotropic!r}, expected True, False or 'log'")
    if graph.covariances is None:
        why = "".join(f"; {note}" for note in graph.notes if note.startswith(NOT_USED))
        raise OptionError(f"anisotropic needs a graph with covariances, and this one has none{why}")
    size = np.abs(graph.covariances).max(axis=(1, 2))
    extreme = ~((size > 1 / LARGEST_COVARIANCE) & (size < LARGEST_COVARIANCE))
    if extreme.any():
        row = int(np.argmax(extreme))
        raise edge_error(
            graph.edges,
            row,
            f"found a covariance whose largest entry is {size[row]:.3g} radians^2; "
            f"expected it between {1 / LARGEST_COVARIANCE:g} and {LARGEST_COVARIANCE:g}",
        )


def settings_of_start(settings: dict[str, Any], problem: Problem) -> dict[str, Any]:
    """The settings of what is solved first: the problem with one weight for each edge."""
    tolerance = settings["tolerance"]
    if problem.sensors is None:  # what is found of sensors stays
        tolerance = max(tolerance, START_TOLERANCE)
    first = {**settings, "certify": False, "stop": "gradient", "tolerance": tolerance}
    known = problem.grounded is not None or problem.sensors is not None
    climbs = settings["method"] == "staircase"
    if settings["loss"] == "l2" and not known and (settings["start"] is not None or climbs):
        first["max_iterations"] = 0  # from there at once
        if climbs:
            first["method"] = "bcd"
    return first


def given_precisions(graph: MeasurementGraph) -> NDArray[np.float64]:
    """(m, 3, 3) inverse covariances.

    Raises as `check`.
    """
    check(graph, True)
    assert graph.covariances is not None
    return information(graph.covariances, np.ones(graph.num_edges))


def with_final_weights(solution: Solution) -> _core.GroundedGraph | None:
    """The problem with the weights of the priors that a robust loss has ended with."""
    grounded, robust = solution.grounded, solution.robust
    if grounded is None or robust is None:
        return None if grounded is None else grounded.eased().core
    fits = robust.absolute_priors, robust.gravity_priors
    final = grounded.with_prior_weights(*(None if f is None else f.weights for f in fits))
    return final.eased().core


def with_covariances(solution: Solution, settings: dict[str, Any]) -> tuple[Solution, bool]:
    """The optimum with matrix weights from a solution without; see `solve`.

    Returns it, and whether its certificate was interrupted.
    """
    graph = solution.graph
    assert graph.covariances is not None
    spent = solution.timings
    stopped = asks_to_stop(solution.status, settings["callback"])
    left = 0 if stopped else max(0, settings["max_iterations"] - solution.iterations)
    core = _core.solve_anisotropic(
        graph._core,
        information(graph.covariances, solution.edge_weights / graph.weights),
        start=solution.rotations,
        **{name: settings[name] for name in _SETTINGS},
        max_iterations=left,
        time_limit=max(0.0, settings["time_limit"] - spent.total),
        callback=None if stopped else settings["callback"],
        iterations_before=solution.iterations,
        priors=with_final_weights(solution),
        prior_precision=precision_of_weight_one(graph.covariances, graph.weights),
    )
    seconds = core["seconds"]
    rotations, rigs = read_only(core["rotations"]), solution.rigs
    if rigs is not None:
        rigs = with_frames_of(rigs, graph.nodes.tolist(), rotations, core["objective"])
    before = f"without covariances {solution.reason or solution.method}; then "
    found = replace(
        solution,
        rotations=rotations,
        rigs=rigs,
        objective=core["objective"],
        gradient_norm=core["gradient_norm"],
        relative_gradient=core["relative_gradient"],
        status=Status.STOPPED if stopped else Status[core["status"].upper()],
        iterations=solution.iterations + core["iterations"],
        method=core["method"],
        reason=(before if solution.iterations > 0 else "") + (core["reason"] or core["method"]),
        trace=Trace(**{name: read_only(values) for name, values in core["trace"].items()}),
        timings=Timings(
            spent.init, spent.solve + seconds["init"] + seconds["solve"], seconds["certify"]
        ),
        certificate=certificate_from_core(core["certificate"], settings["certificate_tolerance"]),
        component=read_only(core["component"]),
        isotropic=solution,
        anisotropic="chordal",
    )
    return found, core["interrupted"]


_SETTINGS = (
    "method", "mu", "stop", "tolerance", "num_threads", "certify", "max_rank",
    "certificate_tolerance", "certificate_failure_probability", "certificate_seed",
    "certificate_max_flops",
)  # fmt: skip


def refined(solution: Solution, settings: dict[str, Any]) -> Solution:
    """The local minimum of sum of r^T C^-1 r next to the solution; see `solve`."""
    graph = solution.graph
    assert graph.covariances is not None
    spent = solution.timings
    stopped = asks_to_stop(solution.status, settings["callback"])
    left = 0 if stopped else max(0, settings["max_iterations"] - solution.iterations)
    began = time.perf_counter()
    core = _core.refine_anisotropic(
        graph._core,
        information(graph.covariances, solution.edge_weights / graph.weights),
        solution.rotations,
        tolerance=settings["tolerance"],
        max_iterations=left,
        time_limit=max(0.0, settings["time_limit"] - spent.total),
        num_threads=settings["num_threads"],
        callback=None if stopped else settings["callback"],
        iterations_before=solution.iterations,
        priors=with_final_weights(solution),
        prior_precision=precision_of_weight_one(graph.covariances, graph.weights),
    )
    seconds = time.perf_counter() - began
    rotations, rigs = read_only(core["rotations"]), solution.rigs
    if rigs is not None:
        rigs = with_frames_of(rigs, graph.nodes.tolist(), rotations, core["objective"])
    status = Status.STOPPED if stopped else Status[core["status"].upper()]
    then = f"then Gauss-Newton on the logarithms, {core['iterations']} iterations"
    return replace(
        solution,
        rotations=rotations,
        rigs=rigs,
        objective=core["objective"],
        gradient_norm=core["gradient_norm"],
        relative_gradient=core["relative_gradient"],
        status=status,
        iterations=solution.iterations + core["iterations"],
        reason=f"{solution.reason or solution.method}; {then}",
        trace=Trace(**{name: read_only(values) for name, values in core["trace"].items()}),
        timings=Timings(spent.init, spent.solve + seconds, spent.certify),
        certificate=None,
        isotropic=solution,
        anisotropic="log",
    )
