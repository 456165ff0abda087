"""In what world a solution is told where nothing holds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import read_only, rows_by_label
from rotavg.graph.means import karcher_mean
from rotavg.solving.solution import Solution


def in_mean_gauge(solution: Solution, start: NDArray[np.float64] | None) -> Solution:
    """The same solution turned such that the mean of the rotations is that of the start.

    In every component that no prior holds, the Karcher mean of the R_i is that of S_i, the
    rotations (n, 3, 3) that were started from; without them, the identity.
    """
    rotations = np.array(solution.rotations)
    turns = np.broadcast_to(np.eye(3), rotations.shape).copy()
    held = solution.grounded is not None and solution.grounded.priors.hold_world
    parts = rows_by_label(solution.component, solution.num_components)
    for rows in parts[1:] if held else parts:
        if start is None:
            turns[rows] = karcher_mean(rotations[rows]).T
            continue
        # Near the start first: of rotations that lie far apart there are several means.
        apart = karcher_mean(rotations[rows] @ np.swapaxes(start[rows], 1, 2)).T
        near, goal = apart @ rotations[rows], karcher_mean(start[rows])
        turns[rows] = goal @ karcher_mean(near, goal).T @ apart
    robust = solution.robust
    if robust is not None:  # alternatives are told in the gauge of the answer
        turned = (
            replace(story, rotations=read_only(turns @ story.rotations))
            for story in robust.alternatives
        )
        robust = replace(robust, alternatives=tuple(turned))
    rigs = solution.rigs
    if rigs is not None:
        row = {node: k for k, node in enumerate(solution.graph.nodes.tolist())}
        turn_of = {frame: turns[row[node]] for node, (frame, _) in rigs.images.items()}
        frames = {frame: read_only(turn_of[frame] @ Q) for frame, Q in rigs.frames.items()}
        rigs = replace(rigs, frames=frames)
    return replace(solution, rotations=read_only(turns @ rotations), robust=robust, rigs=rigs)
