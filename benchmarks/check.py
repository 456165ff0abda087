"""The conventions of every adapter, tried on a graph without noise before anything is measured.

All rotations are random, so that a transpose in the wrong place leaves residuals of two radians;
the given start is off, so that a solver must move.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rotavg
from benchmarks.cases import shortest_path_start
from benchmarks.problem import Problem
from benchmarks.runner import Limits, measure
from benchmarks.solvers import Solver
from rotavg.graph.conventions import matrices_from_rotvecs

# Mean residual, radians. Robust estimators stop at steps of 1e-3.
LARGEST_RESIDUAL = 1e-2
_START_OFF = 0.1
_TIMEOUT_S = 30.0


def check_graph() -> rotavg.MeasurementGraph:
    """A small graph without noise."""
    return rotavg.simulate("erdos_renyi", 20, density=0.4, seed=1).graph


def write_check_problem(path: Path) -> None:
    """Write the problem that adapters are tried on."""
    graph = check_graph()
    turns = np.random.default_rng(1).standard_normal((graph.num_nodes, 3)) * _START_OFF
    start = shortest_path_start(graph) @ matrices_from_rotvecs(turns)
    Problem(graph.indices, graph.rotations, graph.weights, start).save(path)


def refusal(solver: Solver, check_problem: Path, limits: Limits) -> str:
    """Why the solver is not to be measured; empty if it is."""
    limits = Limits(limits.threads, _TIMEOUT_S, limits.memory_gib)
    run = measure(solver, check_problem, check_problem, limits)
    if run.rotations is None:
        return f"{run.outcome}: {run.message}"
    graph = check_graph()
    try:
        objective = rotavg.objective(graph, run.rotations)
    except rotavg.Error as error:
        return f"its answer to the graph without noise is refused: {error}"
    # |R_i R_ij - R_j|_F^2 = 8 sin^2(angle / 2), for small angles 2 angle^2.
    residual = float(np.sqrt(objective / (2 * graph.num_edges)))
    if not residual <= LARGEST_RESIDUAL:
        return f"it leaves {residual:.2g} rad on a graph without noise: a convention is wrong"
    return ""
