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

from rotavg.distributed.coarse import MOST_AGGREGATES, Joints, aggregates, joints, turns
from rotavg.distributed.deadline import NEVER, Deadline
from rotavg.distributed.local import (
    Level,
    level,
    solve_alone,
    solve_majorised,
    solve_region,
)
from rotavg.distributed.mixing import mean, remembered, steps_gram
from rotavg.distributed.network import Network
from rotavg.distributed.part import Part, Rotations


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

    A round is a map G: parts solve their regions, all at once, then aggregates are turned. Where
    that does not lower the objective, it is repeated with `solve_majorised`, which cannot fail.
    Anderson's mixing of the last rounds is tried as well, and kept where it is better still.

    Args:
        network: the parts.
        pieces: (num_own,) arrays of every part, futures.
        deadline: after which the parts end what they are at, with what they have reached.
    """

    def __init__(
        self,
        network: Network,
        pieces: Sequence[Any],
        deadline: Deadline = NEVER,
    ) -> None:
        self.network = network
        self.pieces, self.first_piece = numbered(network, pieces)
        self.num_pieces = int(self.first_piece[-1])
        self.deadline = deadline
        self.all_pieces = network.with_neighbours(as_they_are, self.pieces)
        aggregate = network.each(aggregates, pieces, most=MOST_AGGREGATES // len(network))
        self.aggregates, self.first_aggregate = numbered(network, aggregate)
        self.num_aggregates = int(self.first_aggregate[-1])
        self.all_aggregates = network.with_neighbours(as_they_are, self.aggregates)
        self._past: list[Any] = []  # of every part; none yet where it is empty
        self.start = time.perf_counter()

    def begin(self) -> Round:
        """Every part solved alone, and joined, for a start."""
        network = self.network
        rotations = network.each(solve_alone, deadline=self.deadline)
        found = network.gather(network.with_neighbours(joints, rotations, self.all_pieces))
        Q = turns(Joints.joined(found), self.num_pieces, first=True)
        self.state = self._measured(self.turned(rotations, Q))
        return self.told(0, "joined")

    def reweight(self, parts: list[Any], rotations: list[Any]) -> None:
        """Go on from rotations with other weights of the edges."""
        self.network = Network(self.network.places, parts, self.network.neighbours)
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
        begun = self._past or [None] * len(self.network)
        self._past = self.network.each(remembered, begun, before.rotations, after.rotations)
        if begun[0] is not None:
            mixed = self._measured(self._mixed())
            if _falls(mixed, after):
                after, kind = mixed, "mixed"
        if _falls(after, before):
            self.state = after
        return self.told(number, kind)

    def forget(self) -> None:
        """Let go of what only further rounds would need."""
        self._past.clear()
        self.all_aggregates.clear()

    def components(self) -> tuple[list[Any], int]:
        """Which connected component of the graph every own node is in, and how many have an edge.

        Nodes without an edge are said to be in component 0.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        network = self.network
        found = network.gather(
            network.with_neighbours(joints, self.state.rotations, self.all_pieces)
        )
        both = Joints.joined(found)
        shape = (self.num_pieces, self.num_pieces)
        pairs = coo_array((np.ones(len(both.p)), (both.p, both.q)), shape=shape)
        _, label = connected_components(pairs, directed=False)
        joined = network.gather(network.each(_with_an_edge, self.pieces))
        with_edges = np.unique(label[np.concatenate(joined)])
        number = np.zeros(self.num_pieces, np.int64)
        number[with_edges] = np.arange(len(with_edges))
        labels = _shared(number[label], self.first_piece)
        return network.each(_labels, self.pieces, labels), len(with_edges)

    def in_gauge(self, component: list[Any], count: int) -> list[Any]:
        """The rotations, with I for the first node of every component."""
        network, rotations = self.network, self.state.rotations
        first = np.full(count, np.iinfo(np.int64).max)
        back = np.tile(np.eye(3), (count, 1, 1))
        for ids, R in network.gather(network.each(_first, rotations, component, count=count)):
            earlier = ids < first
            first[earlier], back[earlier] = ids[earlier], R[earlier].transpose(0, 2, 1)
        return network.each(_in_gauge, rotations, component, back=back)

    def told(self, number: int, kind: str) -> Round:
        """Where the rounds are."""
        now = self.state.level
        return Round(number, now.objective, now.relative, kind, time.perf_counter() - self.start)

    def _swept(self, how: Callable[..., Any], rotations: list[Any], tolerance: float) -> list[Any]:
        return self.network.with_neighbours(
            how, rotations, tolerance=tolerance, deadline=self.deadline
        )

    def _measured(self, rotations: list[Any]) -> State:
        levels = self.network.gather(self.network.with_neighbours(level, rotations))
        return State(rotations, reduce(add, levels, Level()))

    def _joined(self, rotations: list[Any]) -> list[Any]:
        if self.num_aggregates == 1:
            return rotations
        network = self.network
        found = network.gather(network.with_neighbours(joints, rotations, self.all_aggregates))
        Q = turns(Joints.joined(found), self.num_aggregates, first=False)
        return network.each(_turned, rotations, self.aggregates, _shared(Q, self.first_aggregate))

    def turned(self, rotations: list[Any], Q: Rotations) -> list[Any]:
        """Every piece turned by its rotation."""
        if self.num_pieces == 1:
            return rotations
        return self.network.each(_turned, rotations, self.pieces, _shared(Q, self.first_piece))

    def _mixed(self) -> list[Any]:
        """Anderson's mixing: the mean of G's values whose steps cancel best (Walker, Ni 2011)."""
        network = self.network
        gram = np.sum(network.gather(network.each(steps_gram, self._past)), axis=0)
        # Minimise c^T gram c over sum c = 1.
        damped = gram + 1e-12 * np.trace(gram) * np.eye(len(gram))
        ones = np.ones(len(gram))
        share = np.linalg.solve(damped, ones) if np.any(gram) else ones
        return network.each(mean, self._past, share=share / share.sum())


def numbered(network: Network, pieces: Sequence[Any]) -> tuple[list[Any], NDArray[np.int64]]:
    """Pieces numbered one part after the other; the first of every part, and how many there are."""
    sizes = network.gather(network.each(_count, pieces))
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return [network.at(p, np.add, piece, int(first[p])) for p, piece in enumerate(pieces)], first


def _shared(values: NDArray[Any], first: NDArray[np.int64]) -> list[tuple[int, NDArray[Any]]]:
    """To every part what is its pieces', and the number of the first."""
    return [(int(a), values[a:b]) for a, b in zip(first[:-1], first[1:])]


def _count(part: Part, piece: NDArray[np.int64]) -> int:
    return int(piece.max(initial=-1)) + 1


def _with_an_edge(part: Part, piece: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(piece[part.degree > 0])


def _first(
    part: Part, own: Rotations, component: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], Rotations]:
    """(count,) the least id of every component with edges, and its rotation."""
    ids, R = np.full(count, np.iinfo(np.int64).max), np.tile(np.eye(3), (count, 1, 1))
    rows = np.flatnonzero(part.degree > 0)
    found, at = np.unique(component[rows], return_index=True)  # own nodes rise
    ids[found], R[found] = part.nodes[rows[at]], own[rows[at]]
    return ids, R


def _in_gauge(
    part: Part, own: Rotations, component: NDArray[np.int64], back: Rotations
) -> Rotations:
    R: Rotations = back[component] @ own if len(back) else own.copy()
    R[part.degree == 0] = np.eye(3)
    return R


def _labels(
    part: Part, piece: NDArray[np.int64], labels: tuple[int, NDArray[np.int64]]
) -> NDArray[np.int64]:
    first, label = labels
    return label[piece - first]


def as_they_are(part: Part, values: NDArray[Any]) -> NDArray[Any]:
    """What a part knows of all its nodes."""
    return values


def _turned(
    part: Part, own: Rotations, piece: NDArray[np.int64], turns: tuple[int, Rotations]
) -> Rotations:
    first, Q = turns
    return Q[piece - first] @ own
