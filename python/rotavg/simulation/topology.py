"""Which nodes a simulated graph joins, and where they are; all pure functions of n and a seed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Edges = NDArray[np.int64]
Vectors = NDArray[np.float64]

_BAND_WIDTH = 9


def num_edges(kind: str, n: int, density: float) -> float:
    """About how many edges the graph of this kind has."""
    per_node = {"cycle": 1.0, "grid": 3.0, "sphere": 2.0, "band": float(_BAND_WIDTH)}
    if kind in per_node:
        return per_node[kind] * n
    pairs = 0.5 * n * (n - 1)
    return pairs if kind == "complete" else density * pairs + n


def complete(n: int) -> Edges:
    """All pairs i < j."""
    return np.column_stack(np.triu_indices(n, 1))


def erdos_renyi(n: int, density: float, rng: np.random.Generator) -> Edges:
    """Each pair i < j with probability `density`, and the few edges that connect the parts.

    Time and memory grow with the number of edges, not of pairs: the gaps between chosen pairs,
    counted through, are geometrically distributed.
    """
    pairs = n * (n - 1) // 2
    chosen: list[NDArray[np.int64]] = []
    last = -1
    while density > 0 and last < pairs:
        expected = (pairs - last) * density
        gaps = rng.geometric(density, size=int(expected + 4 * np.sqrt(expected)) + 8)
        places = last + np.cumsum(np.minimum(gaps, pairs + 1))
        chosen.append(places[places < pairs])
        last = int(places[-1])
    edges = _pairs(np.concatenate(chosen) if chosen else np.empty(0, dtype=np.int64))
    part = spanning_forest(n, edges, rng)[1]
    roots = rng.permutation(np.unique(part))
    # A random tree on the parts, each joined at a random one of its nodes.
    order = np.argsort(part, kind="stable")
    start = np.searchsorted(part[order], roots)
    size = np.searchsorted(part[order], roots, side="right") - start
    member = order[start + rng.integers(size)]
    earlier = rng.integers(np.arange(1, len(roots)))
    bridges = np.column_stack([member[1:], member[earlier]])
    return np.concatenate([edges, np.sort(bridges, axis=1)])


def cycle(n: int) -> Edges:
    """0 -> 1 -> ... -> n - 1 -> 0."""
    k = np.arange(n)
    return np.column_stack([k, (k + 1) % n])


def grid(n: int) -> tuple[Edges, Vectors, Vectors]:
    """A cubic lattice walked to and fro: edges, positions, frames world_from_node.

    The edges are the steps of the walk, then the other pairs of lattice neighbours.
    """
    side = max(1, round(n ** (1 / 3)))
    side += side**3 < n
    k = np.arange(n)
    z, y, x = k // side**2, k // side % side, k % side
    x = np.where((k // side) % 2 == 1, side - 1 - x, x)
    y = np.where(z % 2 == 1, side - 1 - y, y)
    lattice = np.column_stack([x, y, z])
    visited = np.full((side + 1,) * 3, -1)  # one layer more, so that every node has neighbours
    visited[x, y, z] = k
    beside = [visited[tuple((lattice + step).T)] for step in np.eye(3, dtype=np.int64)]
    ends = np.sort(np.column_stack([np.tile(k, 3), np.concatenate(beside)]), axis=1)
    closures = ends[(ends[:, 0] >= 0) & (ends[:, 1] - ends[:, 0] > 1)]
    positions = lattice.astype(np.float64)
    heading = _heading(positions)
    up = np.where(heading[:, 2:] == 0, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    return np.concatenate([_walk(n), closures]), positions, _frames(heading, up)


def sphere(n: int) -> tuple[Edges, Vectors, Vectors]:
    """A spiral of rings on the unit sphere from pole to pole: edges, positions, frames.

    The edges are the steps of the walk, then each node's to the one a full turn on. In a frame,
    x points along the path and z away from the centre.
    """
    turn = min(n - 1, max(2, round(np.sqrt(n))))
    k = np.arange(n)
    polar, azimuth = np.pi * (k + 0.5) / n, 2 * np.pi * k / turn
    positions = np.column_stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    )
    closures = np.column_stack([k[:-turn], k[turn:]])
    if turn == 1:  # the walk already
        closures = closures[:0]
    return np.concatenate([_walk(n), closures]), positions, _frames(_heading(positions), positions)


def band(n: int, loop_closures: float, rng: np.random.Generator) -> Edges:
    """Each node joined to the next 9, and a fraction of these edges replaced by random pairs.

    The steps to the very next node stay, so that the graph stays connected.
    """
    k = np.arange(n)
    steps = range(1, min(_BAND_WIDTH, n - 1) + 1)
    edges = np.concatenate([np.column_stack([k[:-d], k[d:]]) for d in steps])
    count = min(round(loop_closures * len(edges)), len(edges) - (n - 1))
    i = rng.integers(n, size=count)
    j = (i + rng.integers(1, n, size=count)) % n
    replaced = n - 1 + rng.choice(len(edges) - (n - 1), size=count, replace=False)
    edges[replaced] = np.sort(np.column_stack([i, j]), axis=1)
    return edges


def spanning_forest(
    n: int, edges: NDArray[Any], rng: np.random.Generator
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which edges (m,) are in a random spanning forest, and a label (n,) of each node's part.

    Boruvka's algorithm for edges ranked at random: every part takes the first edge that leaves
    it, until none does.
    """
    part = np.arange(n)
    taken = np.zeros(len(edges), dtype=np.bool_)
    left = rng.permutation(len(edges))
    while True:
        a, b = part[edges[left, 0]], part[edges[left, 1]]
        leaves = a != b
        left, a, b = left[leaves], a[leaves], b[leaves]
        if left.size == 0:
            return taken, part
        # Of several assignments to one place the last one holds: write the first ranks last.
        first = np.full(n, -1)
        rank = np.arange(left.size)[::-1]
        both = np.column_stack([a[::-1], b[::-1]]).ravel()
        first[both] = np.repeat(rank, 2)
        joining = np.flatnonzero(first >= 0)
        chosen = first[joining]
        taken[left[chosen]] = True
        parent = np.arange(n)
        parent[joining] = a[chosen] + b[chosen] - joining  # the part at the other end
        mutual = (parent[parent] == np.arange(n)) & (np.arange(n) < parent)
        parent[mutual] = np.flatnonzero(mutual)
        while not np.array_equal(parent, parent[parent]):
            parent = parent[parent]
        part = parent[part]


def _pairs(place: NDArray[np.int64]) -> Edges:
    """The pairs i < j at these places of the sequence (0,1) (0,2) (1,2) (0,3) ..."""
    j = np.floor((1 + np.sqrt(1 + 8 * place.astype(np.float64))) / 2).astype(np.int64)
    j -= j * (j - 1) // 2 > place  # the root may have been rounded either way
    j += j * (j + 1) // 2 <= place
    return np.column_stack([place - j * (j - 1) // 2, j])


def _walk(n: int) -> Edges:
    return np.column_stack([np.arange(n - 1), np.arange(1, n)])


def _heading(positions: Vectors) -> Vectors:
    steps = np.diff(positions, axis=0)
    return np.concatenate([steps, steps[-1:]])


def _frames(forward: Vectors, up: Vectors) -> Vectors:
    """Rotations (n, 3, 3) whose z axis is along `up`, and x as far as possible along `forward`."""
    z = up / np.linalg.norm(up, axis=1, keepdims=True)
    y = np.cross(z, forward)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=2)
