"""Prior knowledge as ordinary edges: a graph with one node more, the world, held at I.

All that solves, certifies and measures then holds as it stands.

- A node whose rotation F_i is fixed is one with the world: R_i = R_w F_i.
- An absolute prior is an edge from the world.
- Gravity is two parallel edges to the world. With Q a rotation that takes g to d, and Q' = Q (2 g
  g^T - I), which turns by pi about d besides, (Q + Q') / 2 = d g^T, so that

      w |R_i Q - R_w|^2 + w |R_i Q' - R_w|^2 = 2 w |R_i d - R_w g|^2 + 8 w.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import rows_by_label
from rotavg.base.errors import GraphError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.priors import CheckedPriors, Priors


@dataclass(frozen=True, eq=False)
class Grounded:
    """The graph with the world as its first node, and how its rows map to the given one's.

    Attributes:
        given: the graph of the measurements.
        priors: what is known.
        row: (n,) row in `graph` of every given node; 0, the world, of fixed ones.
        world_from: (n, 3, 3) R_i = Q[row_i] world_from_i: the fixed rotations, else I.
    """

    given: MeasurementGraph
    priors: CheckedPriors
    row: NDArray[np.int64]
    world_from: NDArray[np.float64]

    @classmethod
    def of(cls, given: MeasurementGraph, priors: CheckedPriors) -> Grounded:
        """Ground a graph; GraphError if nothing is left to solve."""
        free = np.ones(given.num_nodes, dtype=np.bool_)
        free[priors.fixed] = False
        if not free.any():
            raise GraphError("the rotations of all nodes are fixed: nothing is left to solve")
        world_from = np.tile(np.eye(3), (given.num_nodes, 1, 1))
        world_from[priors.fixed] = priors.fixed_rotations
        grounded = cls(given, priors, np.where(free, np.cumsum(free), 0), world_from)
        if not grounded.kept.any() and len(grounded._prior_edges[0]) == 0:
            raise GraphError("no edge and no prior says anything of a node that is not fixed")
        return grounded

    def with_weights(self, weights: NDArray[np.float64]) -> Grounded:
        """The same with other weights (m,) of the measurements."""
        return replace(self, given=self.given.with_weights(weights))

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """(m,) the measurements that are not between two fixed nodes."""
        return np.asarray((self.row[self.given.indices] > 0).any(axis=1))

    @cached_property
    def graph(self) -> MeasurementGraph:
        """The graph with the world; first the kept measurements, then the priors."""
        i, j = self.given.indices[self.kept].T
        measured = (
            self.world_from[i] @ self.given.rotations[self.kept] @ _transposed(self.world_from[j])
        )
        edges, rotations, prior_weights = self._prior_edges
        return MeasurementGraph(
            np.concatenate([self.row[self.given.indices[self.kept]], edges]),
            np.concatenate([measured, rotations]),
            np.concatenate([self.given.weights[self.kept], prior_weights]),
            np.arange(int(self.row.max()) + 1),
        )

    @cached_property
    def _prior_edges(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        p = self.priors
        gravity = self._free_gravity
        world = np.zeros_like
        absolute, down = self.row[p.absolute], self.row[p.gravity[gravity]]
        Q = _taking(p.down, p.gravity_downs[gravity])
        half_turn = 2 * np.outer(p.down, p.down) - np.eye(3)
        weights = p.gravity_weights[gravity]
        edges = [
            np.stack([world(absolute), absolute], axis=1),
            np.stack([down, world(down)], axis=1),
            np.stack([down, world(down)], axis=1),
        ]
        return (
            np.concatenate(edges),
            np.concatenate([p.absolute_rotations, Q, Q @ half_turn]),
            np.concatenate([p.absolute_weights, weights, weights]),
        )

    @cached_property
    def _free_gravity(self) -> NDArray[np.bool_]:
        """(c,) the gravity priors of nodes that are not fixed."""
        return np.asarray(self.row[self.priors.gravity] > 0)

    @cached_property
    def component(self) -> NDArray[np.int32]:
        """(n,) label of the component of every given node; that of the world is 0."""
        return self.graph.components()[self.row]

    @cached_property
    def turn(self) -> NDArray[np.int32]:
        """(rows of graph,) labels of parts whose heading is free: gravity alone holds them; else
        -1.
        """
        rows = np.arange(self.graph.num_nodes)
        ends = self.graph.indices
        inside = ends[(ends > 0).all(axis=1)]
        part = rows.copy()
        if len(inside) > 0:
            eye = np.tile(np.eye(3), (len(inside), 1, 1))
            part = MeasurementGraph(inside, eye, nodes=rows).components().astype(np.int64)
        held = np.zeros(part.max() + 1, dtype=np.bool_)
        held[part[0]] = True
        i, j = self.row[self.given.indices[self.kept]].T
        held[part[i[j == 0]]] = held[part[j[i == 0]]] = True
        held[part[self.row[self.priors.absolute]]] = True
        tilted = np.zeros_like(held)
        tilted[part[self.row[self.priors.gravity[self._free_gravity]]]] = True
        free = tilted & ~held
        label = np.where(free, np.cumsum(free) - 1, -1)
        return label[part].astype(np.int32)

    @property
    def freedom(self) -> int:
        """Equations less unknowns, if every equation has full rank."""
        loose = int(self.graph.components().max())  # beside the world's component
        equations = 3 * (int(self.kept.sum()) + len(self.priors.absolute))
        equations += 2 * int(self._free_gravity.sum())
        unknowns = 3 * (int(self.row.max()) - loose) - int(self.turn.max() + 1)
        return equations - unknowns

    def costs(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(edges of graph,) what each adds to the objective; gravity in the first of its two."""
        Q = self.rows_of(rotations)
        i, j = self.graph.indices.T
        chords = np.sum((Q[i] @ self.graph.rotations - Q[j]) ** 2, axis=(1, 2))
        costs = self.graph.weights * chords
        count = int(self._free_gravity.sum())
        if count > 0:
            gravity = self.gravity_costs(rotations)[self._free_gravity]
            costs[-2 * count :] = np.concatenate([gravity, np.zeros(count)])
        return np.asarray(costs)

    def gravity_costs(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(c,) 2 w |R_i d - g|^2 of every gravity prior."""
        p = self.priors
        tilt = np.einsum("kab,kb->ka", rotations[p.gravity], p.gravity_downs) - p.down
        return np.asarray(2 * p.gravity_weights * np.sum(tilt**2, axis=1))

    def prior_costs(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) what the priors of every given node add to the objective."""
        p = self.priors
        costs = np.zeros(len(rotations))
        off = rotations[p.absolute] - p.absolute_rotations
        costs[p.absolute] += p.absolute_weights * np.sum(off**2, axis=(1, 2))
        costs[p.gravity] += self.gravity_costs(rotations)
        return costs

    def objective(self, rotations: NDArray[np.float64]) -> float:
        """Of the measurements and the priors, with what nothing can change between fixed nodes."""
        constant = float(self.gravity_costs(rotations)[~self._free_gravity].sum())
        i, j = self.given.indices[~self.kept].T
        chords = (rotations[i] @ self.given.rotations[~self.kept] - rotations[j]) ** 2
        constant += float(self.given.weights[~self.kept] @ np.sum(chords, axis=(1, 2)))
        return constant + float(self.costs(rotations).sum())

    def rows(self, rotations: NDArray[np.float64], certified: bool) -> list[tuple[str, str]]:
        """Names and sentences for a printed report."""
        p = self.priors
        off = rotations[p.absolute] - p.absolute_rotations
        tilt = np.einsum("kab,kb->ka", rotations[p.gravity], p.gravity_downs) - p.down
        known = [f"{len(p.fixed)} fixed"] if len(p.fixed) else []
        for count, name, chords in (
            (len(p.absolute), "absolute", np.linalg.norm(off, axis=(1, 2)) / np.sqrt(2)),
            (len(p.gravity), "gravity", np.linalg.norm(tilt, axis=1)),
        ):
            if count:
                angle = np.degrees(2 * np.arcsin(np.minimum(np.median(chords) / 2, 1)))
                known.append(f"{count} {name} (residuals {angle:.3g} deg in the median)")
        text = ", ".join(known) + ("; the certificate covers them" if certified else "")
        rows = [("priors", text)]
        if (self.turn >= 0).any():
            count = int(self.turn.max()) + 1
            parts = "" if count == 1 else f" of {count} parts, each its own"
            rows.append(("heading", f"free{parts}: gravity alone holds them"))
        return rows

    def rotations_of(self, Q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotations of the given nodes from those of the rows."""
        return np.asarray(Q[self.row] @ self.world_from)

    def rows_of(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotations of the rows from those of the given nodes."""
        Q = np.empty((int(self.row.max()) + 1, 3, 3))
        Q[0] = np.eye(3)
        free = self.row > 0
        Q[self.row[free]] = rotations[free]
        return Q

    def aligned(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn every component of the measurements as a whole to where it meets its priors best:
        the rotation next to sum of w P R^T + 2 w g (R d)^T (Arun, Huang and Blostein 1987).
        """
        p = self.priors
        label = self.given.components()
        profile = np.zeros((label.max() + 1, 3, 3))
        firm = 1e3 * max([self.given.weights.max(), *p.absolute_weights, *p.gravity_weights])
        for rows, targets, weights in (
            (p.fixed, p.fixed_rotations, np.full(len(p.fixed), firm)),
            (p.absolute, p.absolute_rotations, p.absolute_weights),
        ):
            terms = weights[:, None, None] * (targets @ _transposed(rotations[rows]))
            np.add.at(profile, label[rows], terms)
        seen = np.einsum("kab,kb->ka", rotations[p.gravity], p.gravity_downs)
        terms = 2 * p.gravity_weights[:, None, None] * (p.down[:, None] * seen[:, None, :])
        np.add.at(profile, label[p.gravity], terms)
        U, _, Vt = np.linalg.svd(profile)
        U[:, :, 2] *= np.where(np.linalg.det(U @ Vt) < 0, -1.0, 1.0)[:, None]
        known = np.abs(profile).max(axis=(1, 2)) > 0
        turns = np.where(known[:, None, None], U @ Vt, np.eye(3))
        return np.asarray(turns[label] @ rotations)

    def headed(self, Q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the heading is free, turn about down so that the first node of each part is as
        near to the identity as it can be.
        """
        Q = Q.copy()
        for part in rows_by_label(self.turn, int(self.turn.max()) + 1):
            first = Q[part[0]]
            g = self.priors.down
            # tr(exp(phi [g]) R) = const + cos(phi) (tr R - g R g) - sin(phi) g . vee(R - R^T)
            vee = np.array([first[2, 1], first[0, 2], first[1, 0]])
            vee -= np.array([first[1, 2], first[2, 0], first[0, 1]])
            phi = np.arctan2(-(g @ vee), np.trace(first) - g @ first @ g)
            Q[part] = _about(g, float(phi)) @ Q[part]
        return Q


def ground(given: MeasurementGraph, priors: Priors) -> Grounded | None:
    """Ground a graph by what is known; None if that is nothing."""
    if not isinstance(given, MeasurementGraph):
        raise GraphError(f"found a {type(given).__name__}, expected a MeasurementGraph")
    checked = CheckedPriors.of(priors, given)
    return Grounded.of(given, checked) if checked.any else None


def _transposed(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.swapaxes(rotations, -1, -2)


def _about(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
    return np.asarray(_core.nearest_rotation(R[None])[0])


def _taking(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (k, 3, 3) that take the unit vector a (3,) to the unit vectors b (k, 3).

    Two half turns, about a and then about the bisector. Where b is nearer to -a, a half turn about
    what is across comes before, as sums of nearly opposite vectors drown in rounding.
    """
    if len(b) == 0:
        return np.empty((0, 3, 3))
    across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    across /= np.linalg.norm(across)
    flipped = (b @ a < 0)[:, None]
    middle = np.where(flipped, -a, a) + b
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    to_b = 2 * middle[:, :, None] * middle[:, None, :] - np.eye(3)
    about_a, about_across = (2 * np.outer(axis, axis) - np.eye(3) for axis in (a, across))
    first = np.where(flipped[:, :, None], about_a @ about_across, about_a)
    return np.asarray(_core.nearest_rotation(to_b @ first))
