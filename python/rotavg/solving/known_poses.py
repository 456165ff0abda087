"""What is known of the poses of a pose graph: what is held, what is weighed, and where to start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError
from rotavg.graph.conventions import first_no_rotation
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.translations import first_not_positive_definite
from rotavg.priors.grounded import ground
from rotavg.priors.priors import Priors
from rotavg.solving.anchors import in_gauge_of
from rotavg.solving.pose_losses import PoseLoss
from rotavg.solving.pose_terms import KnownGravity, KnownPositions, KnownRotations, Terms
from rotavg.solving.positions import positions
from rotavg.solving.solution import Solution

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KnownPoses:
    """What is known of the n nodes.

    Attributes:
        rows: (k,) nodes whose poses are held.
        rotations, positions: (k, 3, 3) and (k, 3) these poses.
        terms: what is weighed.
        turned: (n,) whether a rotation is known of the node's component.
        places: the positions that are weighed; None if none is.
        held: (n, 6) coordinates, translation first, that do not move.
    """

    rows: NDArray[np.int64]
    rotations: Floats
    positions: Floats
    terms: list[Terms]
    turned: NDArray[np.bool_]
    places: KnownPositions | None
    held: NDArray[np.bool_]

    def start(
        self,
        solution: Solution,
        loss: PoseLoss = "l2",
        loss_scale: float | Literal["auto"] = "auto",
        edge_shares: Floats | None = None,
        trusted: NDArray[np.bool_] | None = None,
    ) -> tuple[Floats, Floats]:
        """Poses of all nodes that agree with what is known, as far as a rigid motion can.

        The loss is that of the positions, which count shares (m,) of the edges' information, by
        default what the rotations' loss has left; it does not touch trusted edges (m,).
        """
        graph = solution.graph
        all_rows = np.ones(len(self.rows), dtype=np.bool_)
        turned, _ = in_gauge_of(graph, solution.rotations, self.rows, self.rotations, all_rows)
        rotations = np.where(self.turned[:, None, None], solution.rotations, turned)
        rotations[self.rows] = self.rotations
        held = dict(zip(self.rows.tolist(), self.positions))
        where = positions(
            graph,
            rotations,
            fixed=held,
            loss=loss,
            loss_scale=loss_scale,
            edge_shares=solution.edge_shares if edge_shares is None else edge_shares,
            trusted=trusted,
        )
        return rotations, where if self.places is None else self._placed(graph, rotations, where)

    def _placed(self, graph: MeasurementGraph, rotations: Floats, where: Floats) -> Floats:
        """Positions moved, component by component, and rotations turned in place, to the known."""
        assert self.places is not None
        label = graph.components()
        rows, given = self.places.rows[:, 0], self.places.positions
        for part in np.unique(label[rows]):
            if (label[self.rows] == part).any():
                continue
            here, there = rows[label[rows] == part], given[label[rows] == part]
            centre, goal = where[here].mean(axis=0), there.mean(axis=0)
            nodes = label == part
            turn = np.eye(3)
            if not self.turned[nodes].any():
                # Kabsch 1976; where a line of positions leaves a turn open, any will do.
                turn = _core.nearest_rotation(
                    np.ascontiguousarray(((there - goal).T @ (where[here] - centre))[None])
                )[0]
                rotations[nodes] = turn @ rotations[nodes]
            where[nodes] = (where[nodes] - centre) @ turn.T + goal
        return where


def known_poses(
    solution: Solution, fixed: Mapping[Any, tuple[ArrayLike, ArrayLike]], priors: Priors
) -> KnownPoses:
    """What is held and weighed; GraphError for what is no pose, or of no node.

    In a component of whose rotations or positions nothing is known, those of its first node are
    held.
    """
    graph = solution.graph
    ground(graph, priors)  # which checks them, all but the positions
    rows, rotations, where = _fixed(graph, fixed)
    held = np.zeros((graph.num_nodes, 6), dtype=np.bool_)
    held[rows] = True
    turned_rows = _rows(graph, priors.fixed, "fixed")
    if np.isin(turned_rows, rows).any():
        node = graph.nodes[turned_rows[np.isin(turned_rows, rows)][0]].item()
        raise GraphError(f"node {node!r} is fixed twice: its pose, and its rotation in the priors")
    held[turned_rows, 3:] = True
    terms: list[Terms] = []
    absolute = _rows(graph, priors.absolute, "absolute")
    if len(absolute):
        values = list(priors.absolute.values())
        weights = np.array([weight for _, weight in values])
        given = np.array([np.asarray(P, dtype=np.float64) for P, _ in values])
        terms.append(KnownRotations(absolute[:, None], _isotropic(weights), given))
    gravity = _rows(graph, priors.gravity, "gravity")
    if len(gravity):
        seen = _units(
            np.array([np.asarray(d, dtype=np.float64) for d, _ in priors.gravity.values()])
        )
        weights = np.array([weight for _, weight in priors.gravity.values()])
        down = _units(np.asarray(priors.down, dtype=np.float64)[None])[0]
        terms.append(KnownGravity(gravity[:, None], _isotropic(weights), seen, down))
    places = _places(graph, priors)
    if places is not None:
        terms.append(places)

    label = graph.components()
    first = np.unique(label, return_index=True)[1]
    placed = np.zeros(len(first), dtype=np.bool_)
    turned = placed.copy()
    turned[label[np.concatenate([turned_rows, absolute, gravity])]] = True
    of_priors = turned[label]
    placed[label[rows]] = turned[label[rows]] = True
    if places is not None:
        placed[label[places.rows[:, 0]]] = turned[label[places.rows[:, 0]]] = True
    held[first[~placed], :3] = True
    held[first[~turned], 3:] = True
    return KnownPoses(rows, rotations, where, terms, of_priors, places, held)


def _fixed(
    graph: MeasurementGraph, fixed: Mapping[Any, tuple[ArrayLike, ArrayLike]]
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Rows, rotations and positions of fixed poses."""
    rows = _rows(graph, fixed, "fixed")
    rotations, where = np.empty((len(rows), 3, 3)), np.empty((len(rows), 3))
    for k, (node, pose) in enumerate(fixed.items()):
        of = f"the fixed pose of node {node!r}"
        if not isinstance(pose, (tuple, list)) or len(pose) != 2:
            raise GraphError(f"{of} is {pose!r}, expected a pair of a rotation and a position")
        rotations[k] = as_floats(pose[0], (3, 3), f"the rotation of {of}")
        where[k] = as_floats(pose[1], (3,), f"the position of {of}")
        if first_no_rotation(rotations[k : k + 1]) is not None:
            raise GraphError(f"{of} has a matrix that is no rotation")
        if not np.isfinite(where[k]).all():
            raise GraphError(f"{of} has the position {where[k].tolist()}, expected finite numbers")
    return rows, rotations, where


def _places(graph: MeasurementGraph, priors: Priors) -> KnownPositions | None:
    rows = _rows(graph, priors.positions, "position")
    if not len(rows):
        return None
    where, omega = np.empty((len(rows), 3)), np.empty((len(rows), 3, 3))
    for k, (node, known) in enumerate(priors.positions.items()):
        of = f"the position prior of node {node!r}"
        if not isinstance(known, (tuple, list)) or len(known) != 2:
            raise GraphError(f"{of} is {known!r}, expected a pair of a position and information")
        where[k] = as_floats(known[0], (3,), of)
        omega[k] = as_floats(known[1], (3, 3), f"the information of {of}")
        if not np.isfinite(where[k]).all():
            raise GraphError(f"{of} is {where[k].tolist()}, expected finite numbers")
        if first_not_positive_definite(omega[k : k + 1]) is not None:
            raise GraphError(f"the information of {of} is not symmetric positive definite")
    return KnownPositions(rows[:, None], omega, where)


def _rows(graph: MeasurementGraph, known: Mapping[Any, Any], kind: str) -> NDArray[np.int64]:
    if not known:
        return np.empty(0, dtype=np.int64)
    keys = [key.item() if isinstance(key, np.generic) else key for key in known]
    rows = rows_of(as_ids(keys, kind), graph.nodes)
    if (rows < 0).any():
        raise GraphError(f"{kind}: node {keys[int(np.argmin(rows))]!r} is not in the graph")
    return rows.astype(np.int64)


def _isotropic(weights: Floats) -> Floats:
    """Information of weights (k,), as in the objective: w |R - P|_F^2 is 2 w angle^2."""
    return np.asarray(2 * weights[:, None, None] * np.eye(3))


def _units(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
