"""Large simulated graphs as plain arrays, made in seconds: `edges` (m, 2) and `rotations`."""

from __future__ import annotations

from typing import Callable

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.conventions import matrices_from_rotvecs

Arrays = tuple[NDArray[np.int64], NDArray[np.float64]]

_NOISE = 0.1  # radians
_BLOCK = 50  # nodes in a neighbourhood of the city
_AT_ONCE = 1 << 20


def expander(n: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """A cycle, and ten edges a node between random nodes: m = 11 n."""
    i = rng.integers(n, size=10 * n)
    j = (i + rng.integers(2, n - 1, size=10 * n)) % n
    return np.concatenate([_cycle(n), np.column_stack([i, j])])


def band(n: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Each node joined to the next, and to nine of the 59 behind it, at random: m = 10 n."""
    i = np.repeat(np.arange(n), 9)
    j = i + rng.integers(2, 61, size=len(i))
    return np.concatenate([_cycle(n)[:-1], np.column_stack([i, j])[j < n]])


def city(n: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Neighbourhoods of 50 nodes, of whose pairs four in ten are joined, on a square grid.

    Of two neighbourhoods side by side four pairs are joined: m is about 10 n.
    """
    side = int(np.sqrt(n / _BLOCK))
    blocks = side * side
    a, b = np.triu_indices(_BLOCK, 1)
    inside = [_cycle(_BLOCK)[:-1]]  # in one piece
    chosen = rng.random((blocks, len(a))) < 0.4
    block, pair = np.nonzero(chosen)
    inside = [(np.arange(blocks)[:, None, None] * _BLOCK + inside[0]).reshape(-1, 2)]
    inside.append(np.column_stack([block * _BLOCK + a[pair], block * _BLOCK + b[pair]]))
    cells = np.arange(blocks).reshape(side, side)
    beside = np.concatenate(
        [
            np.column_stack([cells[:, :-1].ravel(), cells[:, 1:].ravel()]),
            np.column_stack([cells[:-1].ravel(), cells[1:].ravel()]),
        ]
    )
    links = np.repeat(beside, 4, axis=0)
    return np.concatenate([*inside, links * _BLOCK + rng.integers(_BLOCK, size=links.shape)])


FAMILIES: dict[str, Callable[[int, np.random.Generator], NDArray[np.int64]]] = {
    "expander": expander,
    "band": band,
    "city": city,
}


def arrays(family: str, n: int, seed: int) -> Arrays:
    """The edges of a graph, and rotations that are noisy measurements of a random truth."""
    rng = np.random.default_rng([seed, n])
    edges = FAMILIES[family](n, rng)
    truth = _random_rotations(int(edges.max()) + 1, rng)
    measured = np.empty((len(edges), 3, 3))
    for begin in range(0, len(edges), _AT_ONCE):  # so that little memory is used beside it
        part = slice(begin, begin + _AT_ONCE)
        i, j = edges[part].T
        off = matrices_from_rotvecs(rng.normal(0, _NOISE / np.sqrt(3), (len(i), 3)))
        np.matmul(np.swapaxes(truth[i], 1, 2) @ truth[j], off, out=measured[part])
    return edges, measured


def _random_rotations(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    axes = rng.standard_normal((n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return matrices_from_rotvecs(rng.uniform(0, np.pi, (n, 1)) * axes)


def _cycle(n: int) -> NDArray[np.int64]:
    return np.column_stack([np.arange(n), (np.arange(n) + 1) % n])
