"""The semidefinite relaxation of rotation averaging with full covariances, by a general solver.

Olsson, Lochman, Malmport and Zach 2025 (arXiv 2503.07353): Y >= 0 (3n x 3n) with Y_ii = I, and Y_ij
in the convex hull of SO(3) for every edge, that is Y_ij = X(Z_ij) with Z_ij >= 0 (4 x 4) and
tr Z = 1, where X is the matrix of a unit quaternion, linear in the products Z of x, y, z, w.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

import rotavg

# X[a, b] as (place in Z, factor), the places those of x, y, z, w.
_QUATERNION = {
    (0, 0): ((0, 0, 1), (1, 1, -1), (2, 2, -1), (3, 3, 1)),
    (1, 1): ((0, 0, -1), (1, 1, 1), (2, 2, -1), (3, 3, 1)),
    (2, 2): ((0, 0, -1), (1, 1, -1), (2, 2, 1), (3, 3, 1)),
    (0, 1): ((0, 1, 2), (2, 3, -2)),
    (1, 0): ((0, 1, 2), (2, 3, 2)),
    (0, 2): ((0, 2, 2), (1, 3, 2)),
    (2, 0): ((0, 2, 2), (1, 3, -2)),
    (1, 2): ((1, 2, 2), (0, 3, -2)),
    (2, 1): ((1, 2, 2), (0, 3, 2)),
}


def matrix_weights(graph: rotavg.MeasurementGraph) -> NDArray[np.float64]:
    """(m, 3, 3) M = tr(H) / 2 I - H, H = C^-1: f = sum 2 (tr M - tr(R_i R_ij M R_j^T))."""
    assert graph.covariances is not None
    H = np.linalg.inv(graph.covariances)
    H = (H + np.swapaxes(H, 1, 2)) / 2
    return np.asarray(np.trace(H, axis1=1, axis2=2)[:, None, None] / 2 * np.eye(3) - H)


def accuracy(graph: rotavg.MeasurementGraph, objective: float) -> float:
    """What the solver can be off by: the terms of f are as large as the sum of |tr M|."""
    return 1e-6 * objective + 1e-8 * float(np.abs(matrix_weights(graph)).sum())


def relaxation(graph: rotavg.MeasurementGraph) -> float:
    """Its optimum, which bounds f from below, by Clarabel (an interior point method)."""
    import clarabel

    M = matrix_weights(graph)
    scale = float(np.abs(M).max())
    size = 3 * graph.num_nodes
    offsets = np.cumsum([0, _length(size)] + [_length(4)] * graph.num_edges)
    q = np.zeros(offsets[-1])
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    right: list[float] = []

    def equal(terms: list[tuple[int, float]], value: float) -> None:
        for place, factor in terms:
            rows.append(len(right))
            columns.append(place)
            values.append(factor)
        right.append(value)

    for node in range(graph.num_nodes):
        for a in range(3):
            for b in range(a + 1):
                equal([_term(0, 3 * node + a, 3 * node + b, 1.0)], float(a == b))
    for k, ((i, j), R) in enumerate(zip(graph.indices.tolist(), graph.rotations)):
        at = int(offsets[k + 1])
        N = R @ M[k] / scale
        equal([_term(at, a, a, 1.0) for a in range(4)], 1.0)
        for (a, b), products in _QUATERNION.items():
            place, factor = _term(0, 3 * i + a, 3 * j + b, 1.0)
            q[place] -= 2 * N[a, b] * factor
            # Z[a, b] and Z[b, a] are one entry, so a product counts once.
            equal([(place, factor)] + [_term(at, c, d, -x) for c, d, x in products], 0.0)
    count = len(right)
    A = sparse.vstack(
        [
            sparse.csc_matrix((values, (rows, columns)), shape=(count, len(q))),
            -sparse.identity(len(q), format="csc"),
        ],
        format="csc",
    )
    cones = [clarabel.ZeroConeT(count), clarabel.PSDTriangleConeT(size)]
    cones += [clarabel.PSDTriangleConeT(4)] * graph.num_edges
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    P = sparse.csc_matrix((len(q), len(q)))
    b = np.concatenate([right, np.zeros(len(q))])
    solution = clarabel.DefaultSolver(P, q, A, b, cones, settings).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise RuntimeError(f"Clarabel: {solution.status}")
    constant = 2 * np.trace(M, axis1=1, axis2=2).sum()
    return float(solution.obj_val * scale + constant)


def _length(size: int) -> int:
    return size * (size + 1) // 2


def _term(start: int, a: int, b: int, factor: float) -> tuple[int, float]:
    """Place and factor of an entry in a triangle, columns of its upper half, scaled by sqrt(2)."""
    row, column = min(a, b), max(a, b)
    place = start + _length(column) + row
    return place, factor if row == column else factor / np.sqrt(2)
