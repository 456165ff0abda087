"""The paper's matrix R-tilde for solvers written with NumPy and SciPy."""

from __future__ import annotations

from typing import Union

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from benchmarks.problem import Problem

Matrix = Union[NDArray[np.float64], scipy.sparse.csr_array]

_DENSE_FROM = 0.05  # share of blocks filled from which a dense product is the faster one


def measurement_matrix(problem: Problem) -> Matrix:
    """The symmetric (3n, 3n) matrix with blocks w R_ij and w R_ij^T: dense or CSR, by the graph."""
    n = problem.num_nodes
    i, j = problem.indices.T.astype(np.int64)
    weighted = problem.weights[:, None, None] * problem.rotations
    if 2 * len(i) >= _DENSE_FROM * n * n:
        blocks = np.zeros((n, 3, n, 3))
        for a, b in np.ndindex(3, 3):
            np.add.at(blocks[:, a, :, b], (i, j), weighted[:, a, b])
            np.add.at(blocks[:, b, :, a], (j, i), weighted[:, a, b])
        return blocks.reshape(3 * n, 3 * n)
    values = np.concatenate([weighted, np.swapaxes(weighted, 1, 2)])
    rows = 3 * np.concatenate([i, j])[:, None, None] + np.arange(3)[:, None]
    columns = 3 * np.concatenate([j, i])[:, None, None] + np.arange(3)
    places = tuple(np.broadcast_to(k, values.shape).ravel() for k in (rows, columns))
    return scipy.sparse.coo_array((values.ravel(), places), shape=(3 * n, 3 * n)).tocsr()


def stacked(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """R^T (3n, 3) of the paper's R = [R_1 ... R_n]: the transposed rotations (n, 3, 3), stacked."""
    return np.swapaxes(rotations, -1, -2).reshape(-1, 3)


def unstacked(stack: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (n, 3, 3) of a stack (3n, 3)."""
    return np.swapaxes(stack.reshape(-1, 3, 3), -1, -2)
