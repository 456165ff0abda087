"""In which world a solution goes back into the file of a pose graph."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.io.dialects import G2O_3D, Dialect
from rotavg.io.placed import held_by_priors, places_of
from rotavg.io.registry import SolutionLike
from rotavg.solving.anchors import in_gauge_of

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gauge:
    """The rotations as they are written, and where positions belong.

    Attributes:
        rotations: (n, 3, 3).
        known: positions (3,) that the file has of some rows, where components are held by these.
        placed: those that priors have of some rows, and the information (3, 3) about them, where
            components are held by priors.
    """

    rotations: Floats
    known: dict[int, Floats]
    placed: dict[int, tuple[Floats, Floats]]


def gauge_of(
    solution: SolutionLike, dialect: Dialect, vertices: Mapping[int, Floats], fixed: Set[int]
) -> Gauge:
    """The gauge of a file whose vertices have the numbers (num_pose,), and some of them are fixed.

    A component is turned to what is fixed of it, else left in the world of priors that hold it,
    else turned to its first node.
    """
    graph = solution.graph
    ids, label = graph.nodes.tolist(), graph.components()
    given = {k: vertices[node] for k, node in enumerate(ids) if node in vertices}
    poses = np.array(list(given.values())).reshape(-1, dialect.num_pose)
    usable = np.isfinite(poses).all(axis=1)
    if dialect == G2O_3D:
        usable &= (poses[:, 3:] != 0).any(axis=1)
    rows, poses = np.array(list(given), dtype=np.int64)[usable], poses[usable]
    turned, moved = dialect.rotations(poses[:, dialect.dimension :]), dialect.translations(poses)
    is_fixed = np.array([ids[k] in fixed for k in rows], dtype=np.bool_)

    priors, held = held_by_priors(solution)
    held = held & ~np.isin(label, label[rows[is_fixed]])
    free = ~held[rows]
    rotations, anchors = in_gauge_of(
        graph, solution.rotations, rows[free], turned[free], is_fixed[free]
    )
    placed = places_of(solution, priors, held)
    alone = held & ~np.isin(label, label[list(placed)])  # of whose places no prior tells
    first = np.unique(label, return_index=True)[1]
    anchors |= set(first[alone[first]].tolist())
    return Gauge(rotations, {int(k): p for k, p in zip(rows, moved) if k in anchors}, placed)


def turned_along(before: Floats, after: Floats, where: Floats) -> Floats:
    """Positions (n, 3) turned as the rotations (n, 3, 3) were."""
    return np.asarray(np.einsum("nab,ncb,nc->na", after, before, where))
