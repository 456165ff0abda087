"""The paper's three algorithms on one graph, and what its tables report of them."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.certificate import Verdict
from rotavg.solving.certify import certify
from rotavg.solving.solution import Solution
from rotavg.solving.solve import solve

# The paper's rule with an epsilon of ours, as it does not print its own. For BCDSR it gives no
# rule: |Y - Y'| / |Y| < epsilon.
EPSILON = 1e-9
STOPPING: dict[str, Any] = {"stop": "step", "tolerance": EPSILON}


@dataclass(frozen=True)
class Algorithm:
    """An algorithm as the tables name it, and the options of `rotavg.solve` that choose it."""

    name: str
    options: dict[str, Any]


BCDSR = Algorithm("BCDSR", {"method": "bcdsr"})
BCD = Algorithm("BCD", {"method": "bcd"})
SUM = Algorithm("SUM", {"method": "sum", "mu": "min_eigenvalue"})
ADAPTIVE_SUM = Algorithm("SUM, adaptive µ", {"method": "sum", "mu": "adaptive"})


@dataclass(frozen=True)
class Run:
    """One algorithm on one graph.

    Attributes:
        error: mean of |R_i R_ij - R_j|_F over the edges.
        squared_error: f / |E|, the mean of the squares.
        lambda_min: smallest eigenvalue of Lambda - Rt.
        certified: whether the answer is proved (or, where that is not possible, estimated) optimal.
        converged: whether the stopping rule was met.
        iterations: sweeps.
        seconds: CPU time of one thread, from the graph to the rotations, shortest paths included.
        objective: f.
        relaxed_objective: what the algorithm itself has minimised; of BCDSR that of (6).
    """

    error: float
    squared_error: float
    lambda_min: float
    certified: bool
    converged: bool
    iterations: int
    seconds: float
    objective: float
    relaxed_objective: float


def timed_solve(
    graph: MeasurementGraph, algorithm: Algorithm, **options: Any
) -> tuple[Solution, float]:
    """Solve on one thread without a certificate; the solution and the seconds of CPU time."""
    start = time.thread_time()
    solution = solve(graph, num_threads=1, certify=False, **{**algorithm.options, **options})
    return solution, time.thread_time() - start


def run(graph: MeasurementGraph, algorithm: Algorithm) -> Run:
    """Run an algorithm from the shortest paths (Lemma 3), and certify what it has found."""
    solution, seconds = timed_solve(graph, algorithm, init="shortest_path", **STOPPING)
    certificate = certify(graph, solution.rotations, num_threads=1)
    # |R_i R_ij - R_j|_F of rotations that an angle lies between
    residuals = 2 * np.sqrt(2) * np.sin(solution.residual_angles / 2)
    return Run(
        error=float(residuals.mean()),
        squared_error=solution.objective / graph.num_edges,
        lambda_min=certificate.lambda_min,
        certified=certificate.verdict != Verdict.NOT_CERTIFIED,
        converged=solution.status.converged,
        iterations=solution.iterations,
        seconds=seconds,
        objective=solution.objective,
        relaxed_objective=float(solution.trace.objective[-1]),
    )
