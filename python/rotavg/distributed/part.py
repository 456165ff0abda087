"""One part of a graph: what a worker holds of it, and what it computes by itself.

The nodes of a part, in this order: its own; an overlap of a few layers around them; the halo, the
nodes next to those. Own and overlap make the region, in which the part solves; rotations of overlap
and halo come from the parts that own them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.edges import Edges

Rotations = NDArray[np.float64]

BLOCK = 1 << 17  # edges that are worked on at a time: some 30 MB


@dataclass(frozen=True, eq=False)
class Part:
    """A part, its edges by rows of its nodes.

    Attributes:
        number: of the part.
        nodes: ids: own (rising), overlap, halo.
        num_own, num_region: how many are own; own or overlap.
        edges: all with an end in the region; i and j are rows of `nodes`.
        counted: (m,) whether an edge is this part's to count: it begins at an own node.
        touching: (m,) whether it has an own end and is another part's to count.
        degree: (num_own,) sums of weights.
        asks: of every part that it needs rotations of, the rows of those nodes.
        boundary: rows of the own nodes that other parts need.
    """

    number: int
    nodes: NDArray[np.int64]
    num_own: int
    num_region: int
    edges: Edges
    counted: NDArray[np.bool_]
    touching: NDArray[np.bool_]
    degree: NDArray[np.float64]
    asks: dict[int, NDArray[np.int64]] = field(default_factory=dict)
    boundary: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def blocks(self) -> Iterator[tuple[Edges, NDArray[np.bool_]]]:
        """Edges with an own end, so many at a time, and which of them are this part's to count."""
        rows = np.flatnonzero(self.counted | self.touching)
        for at in range(0, len(rows), BLOCK):
            some = rows[at : at + BLOCK]
            yield self.edges.take(some), self.counted[some]

    def edges_between_ids(self) -> Edges:
        """Those that are this part's to count, between ids."""
        edges = self.edges.take(self.counted)
        return replace(edges, i=self.nodes[edges.i], j=self.nodes[edges.j])

    def all_blocks(self) -> Iterator[tuple[slice, Edges]]:
        """All edges, so many at a time, with their rows."""
        for at in range(0, len(self.edges), BLOCK):
            rows = slice(at, at + BLOCK)
            yield rows, self.edges.take(rows)


def degrees(part: Part, edges: Edges) -> NDArray[np.float64]:
    """(num_own,) sums of the weights of these edges at own nodes."""
    ends = np.concatenate([edges.i, edges.j])
    sums = np.bincount(ends, np.tile(edges.weights, 2), minlength=part.num_own)
    return np.asarray(sums[: part.num_own], np.float64)


def make_part(number: int, own: NDArray[np.int64], region: NDArray[np.int64], edges: Edges) -> Part:
    """A part; what it is asked for by others is not known yet.

    Args:
        number: of the part.
        own: ids, rising.
        region: ids, rising; own and overlap.
        edges: all with an end in the region, between ids.
    """
    overlap = np.setdiff1d(region, own)
    halo = np.setdiff1d(edges.nodes(), region)
    nodes = np.concatenate([own, overlap, halo])
    order = np.argsort(nodes, kind="stable")
    i, j = (order[np.searchsorted(nodes, ids, sorter=order)] for ids in (edges.i, edges.j))
    counted = i < len(own)
    part = Part(
        number=number,
        nodes=nodes,
        num_own=len(own),
        num_region=len(region),
        edges=replace(edges, i=i, j=j),
        counted=counted,
        touching=~counted & (j < len(own)),
        degree=np.zeros(len(own)),
    )
    return replace(part, degree=degrees(part, part.edges))


def wired(part: Part, owners: NDArray[np.int32], asked: Sequence[NDArray[np.int64]]) -> Part:
    """The part, knowing whom to ask and what it will be asked for.

    Args:
        part: from `make_part`.
        owners: of every node that is not own, the part that owns it.
        asked: ids of own nodes that others need, by each of them.
    """
    asks = {int(q): part.num_own + np.flatnonzero(owners == q) for q in np.unique(owners)}
    boundary = np.unique(np.concatenate([np.zeros(0, np.int64), *asked]))
    return replace(part, asks=asks, boundary=np.searchsorted(part.nodes[: part.num_own], boundary))


def without_edges(part: Part) -> Part:
    """All of the part but its edges."""
    none = np.zeros(0, np.bool_)
    return replace(part, edges=Edges.concatenated([]), counted=none, touching=none)


def boundary_of(part: Part, own: Rotations) -> tuple[NDArray[np.int64], Rotations]:
    """Ids and rotations of the own nodes that others ask for."""
    return part.nodes[part.boundary], own[part.boundary]


def with_others(
    part: Part, own: Rotations, boundaries: dict[int, tuple[NDArray[np.int64], Rotations]]
) -> Rotations:
    """Rotations of all nodes of the part, those of others taken from their boundaries."""
    everything = np.empty((len(part.nodes), *own.shape[1:]))
    everything[: part.num_own] = own
    for q, rows in part.asks.items():
        ids, values = boundaries[q]
        everything[rows] = values[np.searchsorted(ids, part.nodes[rows])]
    return everything
