"""Rounds: every part solves against its surroundings, and one rotation a part joins them again."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, Callable, Optional

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.distributed.coarse import Joints, joints, turns
from rotavg.distributed.local import Level, level, solve_majorised, solve_region
from rotavg.distributed.network import Network
from rotavg.distributed.part import Part, Rotations

HISTORY = 5  # rounds that the mixing looks back on


@dataclass(frozen=True)
class Round:
    """What a round ended with.

    Attributes:
        number: from 0, the parts solved alone and joined.
        objective, relative_gradient: of the whole graph; radians.
        kind: "joined", "schwarz" (the parts solved with their overlap), "mixed" (the same, and
            Anderson's mixing was better), "majorised" (the first two were no gain), "reweighted".
        seconds: since the start.
    """

    number: int
    objective: float
    relative_gradient: float
    kind: str
    seconds: float


Callback = Optional[Callable[[Round], Any]]


@dataclass
class State:
    """Rotations of the own nodes of every part, futures, and their level."""

    rotations: list[Any]
    level: Level


def _falls(after: State, before: State) -> bool:
    """Whether the objective does; where that is lost in rounding, the gradient tells."""
    rounding = 1e-13 * before.level.objective
    change = after.level.objective - before.level.objective
    if abs(change) <= rounding:
        return after.level.squares <= before.level.squares
    return change < 0.0


class Rounds:
    """The iteration; `state` is the best so far, and never gets worse.

    A round is a map G: parts solve their regions, all at once, then the pieces are turned. Where
    that does not lower the objective, it is repeated with `solve_majorised`, which cannot fail.
    Anderson's mixing of the last rounds is tried as well, and kept where it is better still.

    Args:
        network: the parts.
        pieces: (num_own,) arrays of every part, futures; numbered over all parts.
        num_pieces: how many there are.
    """

    def __init__(self, network: Network, pieces: Sequence[Any], num_pieces: int) -> None:
        self.network, self.pieces, self.num_pieces = network, list(pieces), num_pieces
        self.all_pieces = network.with_neighbours(as_they_are, self.pieces)
        self._past: list[tuple[list[Any], list[Any]]] = []  # where rounds began, where G led
        self.start = time.perf_counter()

    def begin(self, rotations: list[Any]) -> Round:
        """From every part solved alone: joined, for a start."""
        self.state = self._measured(self.turned(rotations, self._turns(rotations, first=True)))
        return self.told(0, "joined")

    def reweight(self, parts: list[Any], rotations: list[Any]) -> None:
        """Go on from rotations with other weights of the edges."""
        self.network = Network(self.network.client, parts, self.network.neighbours)
        self._past.clear()
        self.state = self._measured(rotations)

    def next(self, number: int, tolerance: float) -> Round:
        """One round; the parts solve to this tolerance, radians."""
        before = self.state
        after = self._measured(self._joined(self._swept(solve_region, before.rotations, tolerance)))
        kind = "schwarz"
        if not _falls(after, before):
            swept = self._swept(solve_majorised, before.rotations, tolerance)
            after = self._measured(self._joined(swept))
            kind = "majorised"
            self._past.clear()
        self._past.append((before.rotations, after.rotations))
        del self._past[:-HISTORY]
        if len(self._past) > 1:
            mixed = self._measured(self._mixed())
            if _falls(mixed, after):
                after, kind = mixed, "mixed"
        if _falls(after, before):
            self.state = after
        return self.told(number, kind)

    def components(self) -> tuple[list[Any], int]:
        """Which connected component of the graph every own node is in, and how many there are."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        network = self.network
        found = network.gather(
            network.with_neighbours(joints, self.state.rotations, self.all_pieces)
        )
        both = Joints.joined(found)
        shape = (self.num_pieces, self.num_pieces)
        pairs = coo_array((np.ones(len(both.p)), (both.p, both.q)), shape=shape)
        count, label = connected_components(pairs, directed=False)
        return network.each(_labels, self.pieces, label=label.astype(np.int64)), int(count)

    def told(self, number: int, kind: str) -> Round:
        """Where the rounds are."""
        now = self.state.level
        return Round(number, now.objective, now.relative, kind, time.perf_counter() - self.start)

    def _swept(self, how: Callable[..., Any], rotations: list[Any], tolerance: float) -> list[Any]:
        return self.network.with_neighbours(how, rotations, tolerance=tolerance)

    def _measured(self, rotations: list[Any]) -> State:
        levels = self.network.gather(self.network.with_neighbours(level, rotations))
        return State(rotations, reduce(add, levels, Level()))

    def _joined(self, rotations: list[Any]) -> list[Any]:
        return self.turned(rotations, self._turns(rotations))

    def _turns(self, rotations: list[Any], first: bool = False) -> Rotations:
        """The best rotation of every piece."""
        found = self.network.gather(
            self.network.with_neighbours(joints, rotations, self.all_pieces)
        )
        return turns(Joints.joined(found), self.num_pieces, first)

    def turned(self, rotations: list[Any], Q: Rotations) -> list[Any]:
        """Every piece turned by its rotation."""
        if self.num_pieces == 1:
            return rotations
        return self.network.each(_turned, rotations, self.pieces, Q=Q)

    def _mixed(self) -> list[Any]:
        """Anderson's mixing: the mean of G's values whose steps cancel best (Walker, Ni 2011)."""
        network, depth = self.network, len(self._past)
        begins = [[begin[p] for begin, _ in self._past] for p in range(len(network))]
        ends = [[end[p] for _, end in self._past] for p in range(len(network))]
        gram = sum(
            network.gather(network.each(_steps_gram, begins, ends)), np.zeros((depth, depth))
        )
        # Minimise c^T gram c over sum c = 1.
        damped = gram + 1e-12 * np.trace(gram) * np.eye(depth)
        share = np.linalg.solve(damped, np.ones(depth)) if gram.any() else np.ones(depth)
        return network.each(_mean, ends, share=share / share.sum())


def _labels(part: Part, piece: NDArray[np.int64], label: NDArray[np.int64]) -> NDArray[np.int64]:
    return label[piece]


def as_they_are(part: Part, values: NDArray[Any]) -> NDArray[Any]:
    """What a part knows of all its nodes."""
    return values


def _turned(part: Part, own: Rotations, piece: NDArray[np.int64], Q: Rotations) -> Rotations:
    return Q[piece] @ own


def _steps_gram(part: Part, begins: list[Rotations], ends: list[Rotations]) -> NDArray[np.float64]:
    steps = np.stack([(end - begin).ravel() for begin, end in zip(begins, ends)])
    return steps @ steps.T


def _mean(part: Part, ends: list[Rotations], share: NDArray[np.float64]) -> Rotations:
    mean = sum(c * end for c, end in zip(share, ends))
    rotations: Rotations = _core.nearest_rotation(np.ascontiguousarray(mean))
    return rotations
