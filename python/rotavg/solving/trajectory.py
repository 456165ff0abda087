"""Trajectories among measurement graphs: what a robust loss does to their odometry."""

from __future__ import annotations

import numpy as np

from rotavg.solving.known_edges import is_step, is_trajectory
from rotavg.solving.solved import Solved

_SHOWN = 3  # steps that are named
_FAR = 3.0  # times the threshold of outliers


def doubted_odometry(solution: Solved) -> str | None:
    """A sentence, where a robust loss calls edges of a trajectory's odometry outliers."""
    graph, robust = solution.graph, solution.robust
    if robust is None or not solution.is_outlier.any() or not is_trajectory(graph):
        return None
    steps = is_step(graph) & (robust.edge_verdicts != "excluded")
    doubted = np.flatnonzero(steps & solution.is_outlier)
    if len(doubted) == 0:
        return None
    some = f"{len(doubted)} of {int(steps.sum())} edges between consecutive numbers are outliers"
    named = ", ".join(f"{i!r} -> {j!r}" for i, j in graph.edges[doubted[:_SHOWN]].tolist())
    more = ", ..." if len(doubted) > _SHOWN else ""
    return (
        f"{some} ({named}{more}): slips of odometry, or, if it cannot be wrong, trust it "
        '(--trust-odometry, trusted="odometry")'
    )


def strained_trust(solution: Solved) -> str | None:
    """A sentence, where trusted edges lie far off, as those do that contradict one another."""
    graph, robust = solution.graph, solution.robust
    if robust is None:
        return None
    trusted = robust.edge_verdicts == "trusted"
    if not trusted.any():
        return None
    # The threshold is that of the median weight; what is less precise may lie further off.
    unit = np.median(graph.weights[robust.edge_verdicts != "excluded"])
    reach = _FAR * robust.threshold * np.sqrt(np.maximum(1, unit / graph.weights))
    far = trusted & (solution.residual_angles > reach)
    if not far.any():
        return None
    k = int(np.argmax(np.where(far, solution.residual_angles, 0)))
    i, j = graph.edges[k].tolist()
    off = np.degrees(solution.residual_angles[k])
    some = f"{int(far.sum())} of {int(trusted.sum())} trusted edges lie far off"
    return f"{some}, at most {off:.3g} deg ({i!r} -> {j!r}): are they all to be trusted?"
