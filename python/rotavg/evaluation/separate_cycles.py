"""Short cycles that share no edge: where the noise of edges is independent, so are their errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.measurement_graph import MeasurementGraph

_FEW_CYCLES = 5
_ANYTHING = float(np.radians(60.0))  # of rotations at random half are beyond 130
_LITTLE = 0.3  # of independent rotations it is 1
_MOST_EDGES = 50_000  # that are looked at
_MOST_CYCLES = 1000
_LONGEST = 20  # edges of a cycle: errors of longer ones say little of an edge
_MOST_VISITED = 400  # nodes, in the search for one cycle
_MOST_WORK = 400_000  # nodes in all: a fraction of a second


@dataclass(frozen=True)
class SeparateCycles:
    """Cycles of three edges and more, no edge in two of them.

    Attributes:
        edges: for every length, (k, length) rows of the graph's edges.
        along: for every length, (k, length) whether the cycle passes the edge from i to j.
    """

    edges: tuple[NDArray[np.intp], ...]
    along: tuple[NDArray[np.bool_], ...]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """(k,) edges of every cycle, rising."""
        return np.concatenate(
            [np.full(len(e), e.shape[1]) for e in self.edges] or [np.empty(0, np.int64)]
        )

    def errors(self, rotations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k,) angles, radians, by which these rotations (m, 3, 3) miss the identity around them.

        In the order of `lengths`.
        """
        found = [np.empty(0)]
        for edges, along in zip(self.edges, self.along):
            around = np.broadcast_to(np.eye(3), (len(edges), 3, 3))
            for row, forward in zip(edges.T, along.T):
                R = rotations[row]
                around = around @ np.where(forward[:, None, None], R, np.swapaxes(R, 1, 2))
            # |C - I|_F = 2 sqrt(2) sin(angle / 2), which is exact where the angle is small.
            chord = np.linalg.norm(around - np.eye(3), axis=(1, 2)) / 8**0.5
            found.append(2 * np.arcsin(np.minimum(1, chord)))
        return np.concatenate(found)


def separate_cycles(ends: NDArray[np.int32]) -> SeparateCycles:
    """Some, each through an edge of a graph and a short way around it, as they come.

    Of parallel edges one is used: two of them differ by the same angle in every reading.

    Args:
        ends: (m, 2) rows of the nodes of every edge, as in `MeasurementGraph.indices`.
    """
    neighbours: dict[int, dict[int, int]] = {}
    indices = ends[:_MOST_EDGES].tolist()
    for edge, (i, j) in enumerate(indices):
        neighbours.setdefault(i, {})[j] = edge
        neighbours.setdefault(j, {})[i] = edge
    found: dict[int, list[tuple[list[int], list[bool]]]] = {}
    for cycle in _cycles(indices, neighbours):
        edges = [neighbours[a].pop(b) for a, b in zip(cycle, [*cycle[1:], cycle[0]])]
        for a, b in zip(cycle, [*cycle[1:], cycle[0]]):
            del neighbours[b][a]
        along = [indices[edge][0] == a for edge, a in zip(edges, cycle)]
        found.setdefault(len(edges), []).append((edges, along))
        if sum(map(len, found.values())) >= _MOST_CYCLES:
            break
    lengths = sorted(found)
    return SeparateCycles(
        tuple(np.array([edges for edges, _ in found[k]], dtype=np.intp) for k in lengths),
        tuple(np.array([along for _, along in found[k]], dtype=np.bool_) for k in lengths),
    )


def _cycles(indices: list[list[int]], neighbours: dict[int, dict[int, int]]) -> Iterator[list[int]]:
    """Nodes around cycles of edges that are there; whoever takes one removes its edges."""
    work = 0
    count = len(indices)
    # Evenly spread over the graph: each step by the golden section of the number of edges.
    step = max(1, round(0.618 * count))
    while np.gcd(step, count) > 1:
        step += 1
    for k in range(count):
        edge = k * step % count
        i, j = indices[edge]
        if neighbours[i].get(j) == edge:
            around, visited = _way_around(neighbours, i, j)
            if around is not None:
                yield around
            work += visited
            if work > _MOST_WORK:
                return


def _way_around(
    neighbours: dict[int, dict[int, int]], i: int, j: int
) -> tuple[list[int] | None, int]:
    """The nodes of a shortest path from i to j that is not their edge; None if none is near.

    And how many nodes were visited.
    """
    before = {i: i}
    layer = [node for node in neighbours[i] if node != j]
    before.update((node, i) for node in layer)
    for _ in range(_LONGEST - 2):
        for node in layer:
            if j in neighbours[node]:
                path = [j, node]
                while path[-1] != i:
                    path.append(before[path[-1]])
                return path[::-1], len(before)
        if not layer or len(before) > _MOST_VISITED:
            break
        following = []
        for node in layer:
            for other in neighbours[node]:
                if other not in before:
                    before[other] = node
                    following.append(other)
        layer = following
    return None, len(before)


def in_degrees(
    read: MeasurementGraph, told: Callable[[], MeasurementGraph]
) -> tuple[float, float] | None:
    """Median errors of cycles as they were read, and in degrees, if they were meant so; radians.

    Small rotations close nearly, whatever they are. So the cycles must miss by anything as read,
    and in degrees by little of what their edges turn.

    Args:
        read: rotation vectors taken for radians.
        told: gives the same taken for degrees.
    """
    cycles = separate_cycles(read.indices)
    if len(cycles.lengths) < _FEW_CYCLES:
        return None
    before = float(np.median(cycles.errors(np.asarray(read.rotations))))
    if before < _ANYTHING:
        return None
    R = np.asarray(told().rotations)
    after = cycles.errors(R)
    turned = 2 * np.arcsin(np.minimum(1, np.linalg.norm(R - np.eye(3), axis=(1, 2)) / 8**0.5))
    total = np.concatenate([np.sqrt((turned[rows] ** 2).sum(axis=1)) for rows in cycles.edges])
    if np.median(after / np.maximum(total, 1e-300)) > _LITTLE:
        return None
    return before, float(np.median(after))
