"""Which part owns every node: METIS on the nodes, or on the chunks that they came in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, require
from rotavg.distributed.edges import Edges


@dataclass(frozen=True, eq=False)
class Owners:
    """The part of every node.

    Attributes:
        nodes: (n,) ids, rising.
        part: (n,).
    """

    nodes: NDArray[np.int64]
    part: NDArray[np.int32]

    @property
    def num_parts(self) -> int:
        """How many parts own a node."""
        return int(self.part.max(initial=-1)) + 1

    def __getitem__(self, ids: NDArray[np.int64]) -> NDArray[np.int32]:
        owners: NDArray[np.int32] = self.part[np.searchsorted(self.nodes, ids)]
        return owners

    def nodes_of(self, part: int) -> NDArray[np.int64]:
        """Those of one part, rising."""
        nodes: NDArray[np.int64] = self.nodes[self.part == part]
        return nodes

    @staticmethod
    def by_nodes(edges: Edges, num_parts: int) -> Owners:
        """Of a graph in one piece."""
        nodes = edges.nodes()
        i, j = np.searchsorted(nodes, edges.i), np.searchsorted(nodes, edges.j)
        return Owners.numbered(nodes, partition(len(nodes), i, j, np.ones(len(i)), num_parts))

    @staticmethod
    def numbered(nodes: NDArray[np.int64], part: NDArray[np.int32]) -> Owners:
        """Without parts that own nothing."""
        _, number = np.unique(part, return_inverse=True)
        return Owners(nodes, number.astype(np.int32))


def ends_of(chunk: Edges) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The nodes of a chunk, and how many ends of edges each has there."""
    nodes = chunk.nodes()
    ends = np.searchsorted(nodes, np.concatenate([chunk.i, chunk.j]))
    return nodes, np.bincount(ends, minlength=len(nodes))


def homes(ends: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]]) -> Owners:
    """Of every node, the chunk that has most of its edges; the first of several."""
    nodes = np.concatenate([ids for ids, _ in ends])
    counts = np.concatenate([count for _, count in ends])
    chunk = np.repeat(np.arange(len(ends), dtype=np.int32), [len(ids) for ids, _ in ends])
    order = np.lexsort((chunk, -counts, nodes))
    nodes, first = np.unique(nodes[order], return_index=True)
    return Owners(nodes, chunk[order][first])


def crossings(
    chunk: Edges, home: Owners, num_chunks: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Between the homes of which chunks edges of a chunk are, a num_chunks + b, and how many."""
    between = home[chunk.i].astype(np.int64) * num_chunks + home[chunk.j]
    return np.unique(between, return_counts=True)


def by_chunks(
    home: Owners,
    crossing: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
    num_parts: int,
) -> Owners:
    """Chunks grouped to parts, by the `crossings` of all of them."""
    num_chunks = len(crossing)
    between = np.concatenate([pairs for pairs, _ in crossing])
    counts = np.concatenate([count for _, count in crossing])
    sizes = np.bincount(home.part, minlength=num_chunks)
    i, j = np.divmod(between, num_chunks)
    group = partition(num_chunks, i, j, counts, num_parts, sizes)
    return Owners.numbered(home.nodes, group[home.part])


def shares(home: Owners, num_chunks: int, num_parts: int) -> NDArray[np.int64]:
    """(num_chunks,) into how many parts each chunk goes, where there are fewer chunks."""
    sizes = np.bincount(home.part, minlength=num_chunks)
    upto = np.round(num_parts * np.cumsum(sizes) / max(1, sizes.sum()))
    share: NDArray[np.int64] = np.maximum(1, np.diff(upto, prepend=0.0)).astype(np.int64)
    return share


def divided(chunk: Edges, number: int, home: Owners, share: NDArray[np.int64]) -> NDArray[np.int32]:
    """Into which of its parts the nodes of a chunk go, by the edges between them."""
    nodes = home.nodes_of(number)
    inner = chunk.take((home[chunk.i] == number) & (home[chunk.j] == number))
    i, j = np.searchsorted(nodes, inner.i), np.searchsorted(nodes, inner.j)
    return partition(len(nodes), i, j, np.ones(len(i)), int(share[number]))


def by_shares(
    home: Owners, share: NDArray[np.int64], labels: Sequence[NDArray[np.int32]]
) -> Owners:
    """The parts of all chunks that were `divided`."""
    part = np.empty(len(home.nodes), np.int32)
    for number, (first, label) in enumerate(zip(np.cumsum(share) - share, labels)):
        part[home.part == number] = first + label
    return Owners.numbered(home.nodes, part)


def partition(
    num_nodes: int,
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    weights: NDArray[np.generic],
    num_parts: int,
    sizes: NDArray[np.int64] | None = None,
) -> NDArray[np.int32]:
    """Parts of equal size with little between them, by METIS (Karypis and Kumar 1998).

    Args:
        num_nodes: n.
        i: (m,) one end of every edge.
        j: (m,) the other.
        weights: (m,) whole numbers; those of parallel edges add up.
        num_parts: how many.
        sizes: (n,) of the nodes; by default 1.

    Returns:
        (n,) the part of every node; some parts may stay empty on tiny graphs.

    Raises:
        GraphError: for fewer than one part.
        MissingExtraError: without pymetis.
    """
    if num_parts < 1:
        raise GraphError(f"found {num_parts} parts, expected one or more")
    if num_parts == 1 or num_nodes == 0:
        return np.zeros(num_nodes, np.int32)
    if num_parts >= num_nodes:
        return np.arange(num_nodes, dtype=np.int32)
    pymetis = require("pymetis", "distributed")
    sparse = require("scipy.sparse", "distributed")
    off = i != j
    one_way = sparse.coo_array((weights[off], (i[off], j[off])), shape=(num_nodes, num_nodes))
    both = (one_way + one_way.T).tocsr()
    _, part = pymetis.part_graph(
        num_parts,
        pymetis.CSRAdjacency(both.indptr, both.indices),
        eweights=np.asarray(both.data, np.int64),
        vweights=None if sizes is None else np.maximum(sizes, 1),
    )
    return np.asarray(part, np.int32)
