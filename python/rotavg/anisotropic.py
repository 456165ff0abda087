"""Noise that is not the same in all directions: a refinement from the isotropic optimum."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.arrays import read_only

if TYPE_CHECKING:
    from rotavg.solution import Solution


def first_bad_covariance(covariances: NDArray[np.float64]) -> tuple[int, str] | None:
    """Row and defect of the first (m, 3, 3) that is no covariance; None if all are."""
    finite = np.asarray(np.isfinite(covariances).all(axis=(1, 2)))
    safe = covariances.copy()
    safe[~finite] = np.eye(3)
    size = np.abs(safe).max(axis=(1, 2))
    off = np.abs(safe - np.swapaxes(safe, 1, 2)).max(axis=(1, 2))
    good = finite & (off <= 1e-9 * size) & (np.linalg.eigvalsh(safe)[:, 0] > 1e-13 * size)
    if good.all():
        return None
    row = int(np.argmin(good))
    if not finite[row]:
        return row, "the covariance holds a NaN or an infinity"
    return row, "the covariance is not symmetric and positive definite"


def pose_family(
    covariances: NDArray[np.float64], rotations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Covariances of measurements R_ji = R_ij^T (vision family), in the frame of i, for R_ij.

    R_ji exp([e]) is the transpose of exp([-e]) R_ij = R_ij exp([-R_ij^T e]).
    """
    return np.asarray(np.swapaxes(rotations, 1, 2) @ covariances @ rotations)


def isotropic_weights(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) 3 / tr: one over the mean variance about an axis."""
    return np.asarray(3 / np.trace(covariances, axis1=1, axis2=2))


def information(solution: Solution) -> NDArray[np.float64]:
    """(m, 3, 3) inverse covariances, times what a robust loss left of the weights."""
    graph = solution.graph
    assert graph.covariances is not None
    share = solution.edge_weights / graph.weights
    omega = np.linalg.inv(graph.covariances)
    return np.asarray(share[:, None, None] * (omega + np.swapaxes(omega, 1, 2)) / 2)


def refined(solution: Solution, settings: dict[str, Any]) -> Solution:
    """The local minimum of sum of r^T C^-1 r next to the solution; see `solve`."""
    from rotavg.solution import Status, Timings, Trace

    spent = solution.timings
    began = time.perf_counter()
    core = _core.refine_anisotropic(
        solution.graph._core,
        information(solution),
        solution.rotations,
        tolerance=settings["tolerance"],
        max_iterations=max(0, settings["max_iterations"] - solution.iterations),
        time_limit=max(0.0, settings["time_limit"] - spent.total),
        num_threads=settings["num_threads"],
    )
    seconds = time.perf_counter() - began
    status = Status[core["status"].upper()]
    if solution.status is Status.STOPPED:
        status = solution.status
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
