"""One rotation for each piece of a part: the small problem that joins the parts.

At first a piece is what hangs together inside a part; in the rounds it is an aggregate of nodes,
which is smaller. Where piece p is turned as a whole, R_i <- Q_p R_i, an edge between pieces p and q
costs w |Q_p (R_i R_ij R_j^T) - Q_q|^2: a rotation averaging problem in the Q, in which all edges of
a pair add up to tr(Q_p N_pq Q_q^T) with N_pq = sum w R_i R_ij R_j^T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.owners import partition
from rotavg.distributed.part import Part, Rotations
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.solve import solve

AGGREGATES = (128, 64, 32, 16, 8)  # of a part
MOST_AGGREGATES = 1 << 16  # of all parts: one process holds their small problem
LEAST_AGGREGATE = 8  # nodes
MOST_PAIRS = 8  # of aggregates with edges between them, for each


def pieces(part: Part) -> NDArray[np.int64]:
    """(num_own,) the piece of every own node, numbered from 0."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = part.num_own
    inner = (part.edges.i < n) & (part.edges.j < n)
    i, j = part.edges.i[inner], part.edges.j[inner]
    adjacency = coo_array((np.ones(len(i)), (i, j)), shape=(n, n))
    _, label = connected_components(adjacency, directed=False)
    return label.astype(np.int64)


def aggregates(
    part: Part, piece: NDArray[np.int64], most: int = MOST_AGGREGATES
) -> NDArray[np.int64]:
    """(num_own,) pieces divided further, by METIS, numbered from 0.

    The more there are, the fewer rounds. But where each has edges to most of the others, as on
    expanders, the small problem would be as large as the graph, and is of no use: then fewer. There
    are `most` at most.
    """
    n = part.num_own
    inner = (part.edges.i < n) & (part.edges.j < n)
    i, j = part.edges.i[inner], part.edges.j[inner]
    for count in AGGREGATES:
        if count > most or n < LEAST_AGGREGATE * count:
            continue
        label = partition(n, i, j, np.ones(len(i)), count)
        between = label[i] != label[j]
        a, b = label[i[between]].astype(np.int64), label[j[between]].astype(np.int64)
        pairs = len(np.unique(np.minimum(a, b) * count + np.maximum(a, b)))
        if pairs <= min(MOST_PAIRS, 0.25 * (count - 1)) * count:
            _, both = np.unique(np.stack([piece, label]), axis=1, return_inverse=True)
            return both.reshape(-1).astype(np.int64)
    return piece


@dataclass(frozen=True, eq=False)
class Joints:
    """Pairs of pieces with the sum of their edges.

    Attributes:
        p, q: (k,) pieces, p < q.
        N: (k, 3, 3) sums of w R_i R_ij R_j^T, turned so that i is in p.
    """

    p: NDArray[np.int64]
    q: NDArray[np.int64]
    N: NDArray[np.float64]

    @staticmethod
    def summed(p: NDArray[np.int64], q: NDArray[np.int64], N: NDArray[np.float64]) -> Joints:
        """Those of the same pair added up."""
        swapped = p > q
        p, q = np.where(swapped, q, p), np.where(swapped, p, q)
        N = np.where(swapped[:, None, None], N.transpose(0, 2, 1), N)
        pairs, place = np.unique(np.stack([p, q], axis=1), axis=0, return_inverse=True)
        sums = np.zeros((len(pairs), 3, 3))
        np.add.at(sums, place.reshape(-1), N)
        return Joints(pairs[:, 0], pairs[:, 1], sums)

    @staticmethod
    def joined(parts: list[Joints]) -> Joints:
        """Those of several parts."""
        return Joints.summed(
            np.concatenate([joints.p for joints in parts]),
            np.concatenate([joints.q for joints in parts]),
            np.concatenate([joints.N for joints in parts]),
        )


def joints(part: Part, R: Rotations, piece: NDArray[np.float64]) -> Joints:
    """Of the edges that the part counts.

    Args:
        part: the part.
        R: (n, 3, 3) of all its nodes.
        piece: (n,) of all its nodes.
    """
    edges = part.edges.take(part.counted)
    p, q = piece[edges.i].astype(np.int64), piece[edges.j].astype(np.int64)
    between = p != q
    edges, p, q = edges.take(between), p[between], q[between]
    N = R[edges.i] @ edges.rotations @ R[edges.j].transpose(0, 2, 1)
    return Joints.summed(p, q, edges.weights[:, None, None] * N)


def turns(all_joints: Joints, num_pieces: int, first: bool) -> Rotations:
    """The best rotation Q of every piece; certified the first time, when nothing is known yet.

    Every pair becomes at most three measurements, and the problem one for `solve`: with N = U
    diag(s) V^T, U V^T a rotation, and D_k = diag(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1),

        N = sum_k c_k U D_k V^T,    c_k = tr(diag(s) D_k) / 4 - the least of the four

    as the D_k are orthogonal and add up to zero. All U D_k V^T are rotations.
    """
    U, s, Vt = np.linalg.svd(all_joints.N)
    flip = np.linalg.det(U) * np.linalg.det(Vt) < 0
    U[flip, :, 2] *= -1
    s[flip, 2] *= -1
    signs = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    shares = s @ signs.T / 4.0
    weights = shares - shares.min(axis=1, keepdims=True)
    k, which = np.nonzero(weights > 1e-14 * np.abs(s).max(axis=1, keepdims=True))
    if len(k) == 0:
        return np.tile(np.eye(3), (num_pieces, 1, 1))
    rotations = (U[k] * signs[which][:, None, :]) @ Vt[k]
    graph = MeasurementGraph(
        np.stack([all_joints.p[k], all_joints.q[k]], axis=1),
        rotations,
        weights[k, which],
        nodes=np.arange(num_pieces),
    )
    init = "auto" if first else np.tile(np.eye(3), (num_pieces, 1, 1))
    solution = solve(graph, init=init, certify=first, num_threads=1)
    return np.asarray(solution.rotations)
