"""The positions of a solution, and the world that priors hold it in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.ids import as_ids, rows_of
from rotavg.io.registry import SolutionLike
from rotavg.priors.priors import Priors
from rotavg.solving.anchors import moved_to
from rotavg.solving.positions import positions

Floats = NDArray[np.float64]


def refined_positions(solution: SolutionLike) -> NDArray[Any] | None:
    """(n, 3) of a solution that was refined together with its positions; None of another."""
    return getattr(solution, "positions", None)


def robust_shares(solution: SolutionLike) -> NDArray[Any] | None:
    """(m,) what a robust loss has left of the edges; None of what knows of no loss."""
    return getattr(solution, "edge_shares", None)


def held_by_priors(solution: SolutionLike) -> tuple[Priors, NDArray[Any]]:
    """What was known beforehand, and (n,) which nodes it holds in its world: these stay there."""
    priors: Priors | None = getattr(solution, "priors", None)  # of refined poses
    nodes = [] if priors is None else list(priors.positions)
    if priors is None:
        grounded = getattr(solution, "grounded", None)
        priors = Priors() if grounded is None else grounded.priors
    nodes += [*priors.fixed, *priors.absolute, *priors.gravity]
    held = np.zeros(solution.graph.num_nodes, dtype=np.bool_)
    if nodes:
        label = solution.component  # type: ignore[attr-defined]
        held = np.isin(label, label[rows_of(as_ids(nodes, "prior"), solution.graph.nodes)])
    return priors, held


def places_of(
    solution: SolutionLike, priors: Priors, held: NDArray[np.bool_]
) -> dict[int, tuple[Floats, Floats]]:
    """Position (3,) and information (3, 3) that priors have of those rows that are `held` (n,)."""
    if not priors.positions:
        return {}
    rows = rows_of(as_ids(list(priors.positions), "position"), solution.graph.nodes).tolist()
    return {
        row: (np.asarray(p, dtype=np.float64), np.asarray(omega, dtype=np.float64))
        for row, (p, omega) in zip(rows, priors.positions.values())
        if held[row]
    }


def positions_of(solution: SolutionLike) -> NDArray[Any] | None:
    """(n, 3): those that were refined, or that fit; None where the graph has no translations.

    Those that fit are moved to the positions that priors know of components that they hold.
    Raises what `rotavg.positions` raises.
    """
    where = refined_positions(solution)
    if where is not None or solution.graph.translations is None:
        return where
    where = positions(solution.graph, solution.rotations, edge_shares=robust_shares(solution))
    return moved_to(solution.graph, where, places_of(solution, *held_by_priors(solution)))
