"""A refinement from the isotropic optimum, by the covariances of the measurements."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.graph.covariances import information
from rotavg.solving.solution import Solution
from rotavg.solving.status import Status, Timings, Trace


def refined(solution: Solution, settings: dict[str, Any]) -> Solution:
    """The local minimum of sum of r^T C^-1 r next to the solution; see `solve`."""
    graph = solution.graph
    assert graph.covariances is not None
    spent = solution.timings
    stopped = solution.status is Status.STOPPED
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
    )
    seconds = time.perf_counter() - began
    status = solution.status if stopped else Status[core["status"].upper()]
    then = f"then Gauss-Newton on the covariances, {core['iterations']} iterations"
    return replace(
        solution,
        rotations=read_only(core["rotations"]),
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
    )
