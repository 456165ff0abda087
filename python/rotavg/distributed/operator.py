"""A part of M = D^-1/2 S D^-1/2: the operator of the certificate, applied to vectors in parts.

S = Lambda(R) - Rt (Theorem 1) in local frames, where its blocks beside the diagonal are the
measurements themselves, and D the degrees. Its null vectors there are D^1/2 R_i^T.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.local import add_at, vee_difference
from rotavg.distributed.part import Part, Rotations

UNIT_ROUNDOFF = 0.5 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Operator:
    """The rows of M of a part's own nodes.

    Attributes:
        matrix: (3 num_own, 3 n) sparse, of all nodes of the part.
        null: (num_own, 3, 3) blocks D^1/2 R^T of the null vectors.
        component: (num_own,) which component of the graph every node is in.
        degree: (num_own,).
        rounding: |computed - M y|_a <= rounding / 4 (|M| |y|)_a for every row a of this part, where
            the norm of |M|, of all parts, is at most 2 sqrt(3).
        leftover, leftover_rounding: (num_own,) |D^-1/2 S N|^2 of every row, and what its rounding
            can amount to.
    """

    matrix: Any
    null: NDArray[np.float64]
    component: NDArray[np.int64]
    degree: NDArray[np.float64]
    rounding: float
    leftover: NDArray[np.float64]
    leftover_rounding: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Rows:
    """3 x 3 blocks by rows, put where they belong as they come: a part's are most of its memory.

    Attributes:
        start: (num_own + 1,) of the rows.
        filled: (num_own,) how many blocks of every row have come.
        column, blocks: (q,), (q, 3, 3), in the order in which they came.
    """

    start: NDArray[np.int64]
    filled: NDArray[np.int64]
    column: NDArray[np.int32]
    blocks: NDArray[np.float64]

    @staticmethod
    def of(part: Part) -> _Rows:
        """With room for two blocks of every edge with own ends, and one on the diagonal."""
        counts = np.ones(part.num_own, np.int64)
        for edges, _ in part.blocks():
            ends = np.concatenate([edges.i, edges.j])
            counts += np.bincount(ends, minlength=part.num_own)[: part.num_own]
        start = np.concatenate([[0], np.cumsum(counts)])
        size = int(start[-1])
        return _Rows(start, np.zeros_like(counts), np.empty(size, np.int32), np.empty((size, 3, 3)))

    def append(
        self, row: NDArray[np.int64], column: NDArray[np.int64], blocks: NDArray[np.float64]
    ) -> None:
        """To each of these rows."""
        order = np.argsort(row, kind="stable")
        row = row[order]
        rank = np.arange(len(row)) - np.searchsorted(row, row)
        at = self.start[row] + self.filled[row] + rank
        self.column[at], self.blocks[at] = column[order], blocks[order]
        self.filled[:] += np.bincount(row, minlength=len(self.filled))


def make_operator(
    part: Part, R: Rotations, degree: NDArray[np.float64], component: NDArray[np.int64]
) -> Operator:
    """At rotations.

    Args:
        part: the part.
        R: (n, 3, 3) of all its nodes.
        degree: (n,) of all its nodes; where it is 0, the rows and null vectors are.
        component: (num_own,).
    """
    from scipy.sparse import bsr_array

    n, num_own = len(part.nodes), part.num_own
    some = np.where(degree > 0, degree, 1.0)
    root = np.sqrt(some)
    Lambda = np.zeros((num_own, 3, 3))
    g = np.zeros((num_own, 3))
    rows = _Rows.of(part)
    for edges, _ in part.blocks():
        i, j, w = edges.i, edges.j, edges.weights[:, None, None]
        scaled = (edges.weights / (root[i] * root[j]))[:, None, None] * edges.rotations
        for a, b, B, i_from_j in (
            (i, j, scaled, edges.rotations),
            (j, i, scaled.transpose(0, 2, 1), edges.rotations.transpose(0, 2, 1)),
        ):
            mine = a < num_own
            rows.append(a[mine], b[mine], -B[mine])
            turned = i_from_j @ R[b].transpose(0, 2, 1) @ R[a]  # I, where there is no residual
            add_at(Lambda, a, w * turned)
            add_at(g, a, edges.weights[:, None] * vee_difference(turned))
    at = np.arange(num_own)
    own_degree = some[:num_own]
    rows.append(at, at, 0.5 * (Lambda + Lambda.transpose(0, 2, 1)) / own_degree[:, None, None])
    start = rows.start
    matrix = bsr_array((rows.blocks, rows.column, start), shape=(3 * num_own, 3 * n))
    ends = np.diff(start)
    # Of a product with 3 x 3 blocks: (3 q + 8) u |M| |y| entry by entry, |M| at most sqrt(3) times
    # the norm 1 of either of its halves; of the blocks themselves some (q + 100) u each.
    rounding = 8.0 * (3.0 * float(ends.max(initial=0)) + 200.0) * UNIT_ROUNDOFF
    # S N = hat(axis sums) / 2 (the antisymmetric part of Lambda), |hat(x)|_F^2 = 2 |x|^2.
    square = 0.5 * (g**2).sum(axis=1) / own_degree
    error = ((ends + 100.0) * 4.0 * UNIT_ROUNDOFF) ** 2 * own_degree
    null = np.sqrt(degree[:num_own])[:, None, None] * R[:num_own].transpose(0, 2, 1)
    return Operator(matrix, null, component, degree[:num_own], rounding, square, error)


def along_null(
    operator: Operator, y: NDArray[np.float64], num_components: int
) -> NDArray[np.float64]:
    """(num_components, 3, C): N^T y of a part's rows y (num_own, 3, C)."""
    sums = np.zeros((num_components, 3, y.shape[2]))
    np.add.at(sums, operator.component, operator.null.transpose(0, 2, 1) @ y)
    return sums


def without_null(
    operator: Operator, y: NDArray[np.float64], means: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Less the part along the null vectors; `means` are N^T y over the sums of degrees."""
    return y - operator.null @ means[operator.component]


def apply(operator: Operator, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """The own rows (num_own, 3, C) of M y, y (n, 3, C) of all nodes of the part."""
    product = operator.matrix @ y.reshape(-1, y.shape[2])
    return np.asarray(product).reshape(-1, 3, y.shape[2])
