"""Solving with prior knowledge: without it first, then turned to meet it, then with it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import rows_by_label
from rotavg.priors.grounded import Grounded

Run = Callable[..., "dict[str, Any]"]


def solve_grounded(
    grounded: Grounded, run: Run, settings: dict[str, Any], *, warm: bool = False
) -> dict[str, Any]:
    """What the core returns for the given graph, with the figures of the problem with priors.

    Args:
        grounded: the problem.
        run: calls the core's solve() for a graph, with these settings changed.
        settings: of the core's solve().
        warm: whether settings["start"] is a solution, so that none without priors is needed first.
    """
    began = time.perf_counter()
    first: dict[str, Any] = {"iterations": 0, "status": "", "init": "", "seconds": {}}
    if warm:
        first["rotations"] = settings["start"]
    else:
        first = run(grounded.given, certify=False, tolerance=max(settings["tolerance"], 1e-6))
    robust = first.get("robust")
    weights = grounded.given.weights if robust is None else robust["edge_weights"]
    problem = grounded.with_weights(weights)
    limits: dict[str, Any] = {
        "max_iterations": max(0, settings["max_iterations"] - first["iterations"]),
        "time_limit": max(0.0, settings["time_limit"] - (time.perf_counter() - began)),
    }
    stopped = first["status"] == "stopped"
    if stopped:
        limits.update(max_iterations=0, callback=None)
    start = grounded.rows_of(grounded.aligned(first["rotations"]))
    core = run(problem.graph, start=start, loss="l2", cycle_threshold=0.0, **limits)
    if stopped:
        core["status"] = "stopped"

    rotations = grounded.rotations_of(grounded.headed(core["rotations"]))
    objective = problem.objective(rotations)
    core["trace"]["objective"] = core["trace"]["objective"] + (objective - core["objective"])
    core["certificate"] = _certificate(
        core["certificate"], problem, rotations, settings["certificate_tolerance"]
    )
    core["rotations"], core["objective"] = rotations, objective
    core["component"] = grounded.component
    core["init"] = first["init"]
    core["iterations"] += first["iterations"]
    for part, seconds in first["seconds"].items():
        core["seconds"][part] += seconds
    if not warm:
        without = f"without priors {first['method']}"
        core["reason"] = f"{without}, then {core['reason'] or core['method']}"
    if robust is not None:
        core["robust"] = robust
    return core


def _certificate(
    core: dict[str, Any], grounded: Grounded, rotations: NDArray[np.float64], tolerance: float
) -> dict[str, Any]:
    """The certificate relative to the objective without the constant that gravity brings along.

    The gap itself is that of the problem with the priors, which constants do not change; and it is
    no larger than the objective without the constant, which is not negative anywhere.
    """
    if core["verdict"] == "not_run" or len(grounded.priors.gravity) == 0:
        return core
    label = grounded.graph.components()[grounded.graph.indices[:, 0]]
    costs, weights = grounded.costs(rotations), grounded.graph.weights
    edges = rows_by_label(label, len(core["components"]))
    parts = [
        _part(part, costs[own], weights[own], tolerance) if len(own) > 0 else part
        for part, own in zip(core["components"], edges)
    ]
    # The worst: what is not certified, or else estimated, and of these the largest gap.
    order = ("proved", "estimated", "not_certified")
    worst = max(parts, key=lambda part: (order.index(part["verdict"]), part["relative_gap"]))
    return {
        **core,
        **{key: worst[key] for key in ("verdict", "relative_gap", "method")},
        "gap": sum(part["gap"] for part in parts),
        "components": parts,
    }


def _part(
    core: dict[str, Any],
    costs: NDArray[np.float64],
    weights: NDArray[np.float64],
    tolerance: float,
) -> dict[str, Any]:
    """The certificate of one component, whose edges cost and weigh so much."""
    objective = float(costs.sum())
    part = dict(core)
    if objective < part["gap"]:
        part.update(gap=objective, method="nonnegativity", verdict="proved")
    scale = max(objective, 1e-6 * float(np.minimum(weights, 1000 * weights.min()).sum()))
    part["relative_gap"] = part["gap"] / scale
    if part["relative_gap"] > tolerance:
        part["verdict"] = "not_certified"
    return part
