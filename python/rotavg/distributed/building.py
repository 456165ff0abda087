"""From measurements in chunks to parts on workers; no process ever holds all of them.

A chunk is a file, or what one call of a reader gives. A node's home is the chunk that has most of
its edges; chunks are grouped to parts by METIS on the graph of chunks, or divided where there are
fewer of them. The nodes of a graph in memory are divided by METIS themselves.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError
from rotavg.distributed.coarse import pieces
from rotavg.distributed.edges import Edges
from rotavg.distributed.network import Network, gathered
from rotavg.distributed.owners import (
    Owners,
    by_chunks,
    by_shares,
    crossings,
    divided,
    ends_of,
    homes,
    shares,
)
from rotavg.distributed.part import Part, make_part, wired
from rotavg.distributed.places import Places
from rotavg.graph.measurement_graph import MeasurementGraph

NOTHING = "there is nothing to solve: no edge was given"
MOST_LAYERS = 8  # of overlap
MOST_OVERLAP = 0.25  # of the own nodes

Ids = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Region:
    """A part while it grows its overlap.

    Attributes:
        number: of the part.
        own, nodes: ids, rising; nodes are own and overlap.
        edges: all with an end in the region.
    """

    number: int
    own: Ids
    nodes: Ids
    edges: Edges

    @property
    def ring(self) -> Ids:
        """The nodes next to the region."""
        return np.setdiff1d(self.edges.nodes(), self.nodes)


def sent(client: Any, graph: MeasurementGraph, num_parts: int) -> tuple[Iterator[Any], int, Any]:
    """A graph that is here, on its way to workers: chunks, how many parts, and who owns what.

    Data that were scattered are lost with the worker that has them; so they go as arguments of
    tasks, which the scheduler keeps.
    """
    edges = Edges.of(graph)
    owners = Owners.by_nodes(edges, num_parts)
    part = owners[edges.i]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Sending large graph")
        chunks = [
            client.submit(_as_it_is, edges.take(part == p), pure=False)
            for p in range(owners.num_parts)
        ]
        return iter(chunks), owners.num_parts, client.submit(_as_it_is, owners, pure=False)


def build(
    client: Any, chunks: Iterable[Any], num_parts: int, owners: Any = None
) -> tuple[Network, list[Any]]:
    """The parts on the workers, which forget the chunks as soon as they can.

    Args:
        client: of the cluster.
        chunks: futures of `Edges`; for them to be forgotten, nobody else may hold them.
        num_parts: how many.
        owners: a future of `Owners`; by default found by the chunks.

    Returns:
        the network, and the pieces (num_own,) of every part, futures.

    Raises:
        GraphError: there is no edge at all.
    """

    def submit(function: Any, *arguments: Any, **options: Any) -> Any:
        return client.submit(function, *arguments, pure=False, **options)

    held = list(chunks)
    del chunks
    if not held:
        raise GraphError(NOTHING)
    if owners is None:
        owners = _owners(client, submit, held, num_parts)
    (count,) = gathered(client, [submit(_num_parts, owners)])
    told = gathered(client, [submit(_present, chunk, owners) for chunk in held])
    if not any(told):
        raise GraphError(NOTHING)
    pieces_of: list[list[Any]] = [[] for _ in range(count)]
    places = Places(client, count)
    at = places.submit
    for k, present in enumerate(told):
        split = submit(_split, held[k], owners, present)
        for place, p in enumerate(present):
            pieces_of[p].append(submit(_item, split, place, priority=1))
    # What makes room comes first.
    regions = [at(p, _region, p, owners, pieces_of[p], priority=1) for p in range(count)]
    del held, split, pieces_of
    regions = _grown(client, at, regions, owners)
    parts = [at(p, _part, region) for p, region in enumerate(regions)]
    del regions
    asks = [at(p, _asks, part, owners) for p, part in enumerate(parts)]
    asked = gathered(client, [at(p, sorted, ask) for p, ask in enumerate(asks)])
    askers: list[list[Any]] = [[] for _ in parts]
    for q, whom in enumerate(asked):
        for p in whom:
            askers[p].append(at(q, _item, asks[q], p))
    parts = [at(p, _wired, part, owners, askers[p]) for p, part in enumerate(parts)]
    network = Network(places, parts, asked)
    return network, network.each(pieces)


def _owners(client: Any, submit: Any, chunks: Sequence[Any], num_parts: int) -> Any:
    home = submit(homes, [submit(ends_of, chunk) for chunk in chunks])
    if len(chunks) < num_parts:
        share = submit(shares, home, len(chunks), num_parts)
        labels = [submit(divided, chunk, k, home, share) for k, chunk in enumerate(chunks)]
        return submit(by_shares, home, share, labels)
    crossing = [submit(crossings, chunk, home, len(chunks)) for chunk in chunks]
    return submit(by_chunks, home, crossing, num_parts)


def _grown(client: Any, at: Any, regions: list[Any], owners: Any) -> list[Any]:
    """With as many layers of overlap as are worth their room: they save rounds."""
    own = sum(gathered(client, [at(p, _num_nodes, region) for p, region in enumerate(regions)]))
    for _ in range(MOST_LAYERS):
        rings = [at(p, _ring, region) for p, region in enumerate(regions)]
        sizes = [at(p, _size_and_owners, ring, owners) for p, ring in enumerate(rings)]
        told = gathered(client, sizes)
        now = sum(gathered(client, [at(p, _num_nodes, region) for p, region in enumerate(regions)]))
        more = sum(size for size, _ in told)
        if more == 0 or now + more > (1.0 + MOST_OVERLAP) * own:
            break
        regions = [
            at(
                p,
                _larger,
                region,
                rings[p],
                [at(q, _edges_at, regions[q], rings[p], owners) for q in told[p][1]],
            )
            for p, region in enumerate(regions)
        ]
    return regions


def _as_it_is(value: Any) -> Any:
    return value


def _num_parts(owners: Owners) -> int:
    return owners.num_parts


def _item(container: Any, key: int) -> Any:
    return container[key]


def _num_nodes(region: Region) -> int:
    return len(region.nodes)


def _present(chunk: Edges, owners: Owners) -> list[int]:
    """The parts that have an edge of the chunk."""
    found: list[int] = np.union1d(owners[chunk.i], owners[chunk.j]).tolist()
    return found


def _split(chunk: Edges, owners: Owners, present: list[int]) -> list[Edges]:
    """The edges of each of these parts; those between two parts go to both."""
    i, j = owners[chunk.i], owners[chunk.j]
    return [chunk.take((i == p) | (j == p)) for p in present]


def _region(number: int, owners: Owners, chunks: list[Edges]) -> Region:
    own = owners.nodes_of(number)
    return Region(number, own, own, Edges.concatenated(chunks))


def _ring(region: Region) -> Ids:
    return region.ring


def _size_and_owners(ring: Ids, owners: Owners) -> tuple[int, list[int]]:
    return len(ring), np.unique(owners[ring]).tolist()


def _edges_at(region: Region, ring: Ids, owners: Owners) -> Edges:
    """Those at nodes of the ring that this part owns, each delivered by one part alone: the one
    that owns the first of its ends that is in the ring.
    """
    edges = region.edges
    first = np.isin(edges.i, ring)
    end = np.where(first, edges.i, edges.j)
    here = owners[end] == region.number
    return edges.take(here & (first | np.isin(edges.j, ring)))


def _larger(region: Region, ring: Ids, found: list[Edges]) -> Region:
    edges = Edges.concatenated(found)
    known = np.isin(edges.i, region.nodes) | np.isin(edges.j, region.nodes)
    return Region(
        region.number,
        region.own,
        np.union1d(region.nodes, ring),
        Edges.concatenated([region.edges, edges.take(~known)]),
    )


def _part(region: Region) -> Part:
    return make_part(region.number, region.own, region.nodes, region.edges)


def _asks(part: Part, owners: Owners) -> dict[int, Ids]:
    others = part.nodes[part.num_own :]
    owner = owners[others]
    return {int(q): others[owner == q] for q in np.unique(owner)}


def _wired(part: Part, owners: Owners, asked: list[Ids]) -> Part:
    return wired(part, owners[part.nodes[part.num_own :]], asked)
