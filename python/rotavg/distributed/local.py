"""What a part computes from the rotations of all its nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.distributed.deadline import Deadline
from rotavg.distributed.part import Part, Rotations
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.solve import solve


@dataclass(frozen=True)
class Level:
    """The objective and its gradient; those of parts add up.

    Attributes:
        objective: sum of w |R_i R_ij - R_j|^2 over the edges that are counted.
        squares: |g|^2, of the gradient g at own nodes.
        relative: max |g_i| / deg_i, radians.
        weight: sum of w over these edges.
    """

    objective: float = 0.0
    squares: float = 0.0
    relative: float = 0.0
    weight: float = 0.0

    @property
    def noise(self) -> float:
        """The root mean square of the residuals, radians."""
        return math.sqrt(0.5 * self.objective / self.weight) if self.weight > 0.0 else 0.0

    def __add__(self, other: Level) -> Level:
        return Level(
            self.objective + other.objective,
            self.squares + other.squares,
            max(self.relative, other.relative),
            self.weight + other.weight,
        )


def level(part: Part, R: Rotations) -> Level:
    """At rotations of all nodes of the part."""
    total, weight, g = 0.0, 0.0, np.zeros((part.num_own, 3))
    for edges, counted in part.blocks():
        for mine, some in ((True, edges.take(counted)), (False, edges.take(~counted))):
            if len(some) == 0:
                continue
            rows = np.stack([some.i, some.j], axis=1).astype(np.int32)
            graph = _core.MeasurementGraph(len(R), rows, some.rotations, some.weights)
            g += _core.gradient(graph, R)[: part.num_own]
            if mine:
                total += _core.objective(graph, R)
                weight += float(some.weights.sum())
    norms = np.linalg.norm(g, axis=1)
    relative = np.divide(norms, part.degree, out=np.zeros_like(norms), where=part.degree > 0)
    return Level(total, float(norms @ norms), float(relative.max(initial=0.0)), weight)


def vee_difference(G: Rotations) -> NDArray[np.float64]:
    """(k, 3) the vectors v with [v] = G - G^T."""
    return np.stack(
        [G[:, 2, 1] - G[:, 1, 2], G[:, 0, 2] - G[:, 2, 0], G[:, 1, 0] - G[:, 0, 1]], axis=1
    )


def add_at(sums: NDArray[np.float64], rows: NDArray[np.int64], values: NDArray[np.float64]) -> None:
    """Add values (k, ...) to rows of sums (n, ...); rows beyond its end are left out."""
    n = len(sums)
    flat, added = sums.reshape(n, -1), values.reshape(len(values), -1)
    for c in range(flat.shape[1]):
        flat[:, c] += np.bincount(rows, added[:, c], minlength=n)[:n]


def solve_region(part: Part, R: Rotations, tolerance: float, deadline: Deadline) -> Rotations:
    """The own nodes of a solution of the region, with the halo held (restricted additive Schwarz).

    The held nodes are one: the world. With R_w = I, an edge R_i R_ij ~ R_j to a held R_j is one of
    R_ij R_j^T from i to w, and one from a held R_i is one of R_i R_ij from w to j.

    Args:
        part: the part.
        R: (n, 3, 3) of all its nodes; the region's to start from.
        tolerance: of the relative gradient, radians.
        deadline: after which what has been reached is returned.
    """
    i, j = part.edges.i, part.edges.j
    world = part.num_region
    inside_i, inside_j = i < world, j < world
    rotations = part.edges.rotations.copy()
    rotations[~inside_j] = rotations[~inside_j] @ R[j[~inside_j]].transpose(0, 2, 1)
    rotations[~inside_i] = R[i[~inside_i]] @ rotations[~inside_i]
    ends = np.stack([np.where(inside_i, i, world), np.where(inside_j, j, world)], axis=1)
    weights = part.edges.weights
    return _solved(ends, rotations, weights, R[:world], tolerance, deadline)[: part.num_own]


def solve_majorised(part: Part, R: Rotations, tolerance: float, deadline: Deadline) -> Rotations:
    """The own nodes of a solution that never makes the whole objective larger, whatever the other
    parts do at the same time.

    With a = R_i R_ij and b = R_j, an edge between two parts is at most |a - b|^2 <= 2 |a - c|^2 + 2
    |b - c|^2 for any c, with equality where c = (a + b) / 2. c at the present rotations makes it a
    sum of two terms, one for each part; and 2 |a - c|^2 = |a - b0|^2 + |a - a0|^2 + const: an edge
    to where the other end is, and one to where its own end is, both of the same weight.
    """
    i, j = part.edges.i, part.edges.j
    world = part.num_own
    own = (i < world) | (j < world)
    edges = part.edges.take(own)
    i, j, weights = edges.i, edges.j, edges.weights
    rotations = edges.rotations.copy()
    out, into = j >= world, i >= world
    rotations[out] = rotations[out] @ R[j[out]].transpose(0, 2, 1)
    rotations[into] = R[i[into]] @ rotations[into]
    ends = np.stack([np.where(into, world, i), np.where(out, world, j)], axis=1)
    stay = np.bincount(
        np.concatenate([i[out], j[into]]),
        np.concatenate([weights[out], weights[into]]),
        minlength=world,
    )
    at = np.flatnonzero(stay > 0)
    return _solved(
        np.concatenate([ends, np.stack([at, np.full_like(at, world)], axis=1)]),
        np.concatenate([rotations, R[at].transpose(0, 2, 1)]),
        np.concatenate([weights, stay[at]]),
        R[:world],
        tolerance,
        deadline,
    )


def _solved(
    ends: NDArray[np.int64],
    rotations: Rotations,
    weights: NDArray[np.float64],
    start: Rotations,
    tolerance: float,
    deadline: Deadline,
) -> Rotations:
    """Rotations of all nodes but the last, the world, which stays at I."""
    if len(ends) == 0:
        return start
    world = len(start)
    graph = MeasurementGraph(ends, rotations, weights, nodes=np.arange(world + 1))
    init = np.concatenate([start, np.eye(3)[None]])
    solution = solve(
        graph,
        init=init,
        tolerance=tolerance,
        certify=False,
        num_threads=1,
        time_limit=deadline.left(),
    )
    R = solution.rotations
    result: Rotations = R[world].T @ R[:world]
    return result


def inner_graph(part: Part) -> MeasurementGraph | None:
    """The own nodes and the edges between them; None where there are none."""
    inner = (part.edges.i < part.num_own) & (part.edges.j < part.num_own)
    if not inner.any():
        return None
    edges = part.edges.take(inner)
    return MeasurementGraph(
        np.stack([edges.i, edges.j], axis=1),
        edges.rotations,
        edges.weights,
        nodes=np.arange(part.num_own),
    )


def solve_alone(part: Part, deadline: Deadline) -> Rotations:
    """The own nodes by the edges between them; each piece in a gauge of its own."""
    graph = inner_graph(part)
    if graph is None:
        return np.tile(np.eye(3), (part.num_own, 1, 1))
    solution = solve(
        graph, certify=False, num_threads=1, tolerance=1e-4, time_limit=deadline.left()
    )
    return np.asarray(solution.rotations)
