"""The paper's algorithms as one would write them with NumPy, from the shortest paths.

They stop by the paper's rule, the relative step. Without mu, Algorithm 3 need not converge: there
is a limit on the sweeps, too.
"""

from __future__ import annotations

import time

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh

from benchmarks.peers.measurement_matrix import measurement_matrix, stacked, unstacked
from benchmarks.problem import Problem

STEP = 1e-7
MAX_SWEEPS = 10_000
_EIGENVALUE_TOLERANCE = 1e-4


class _Sweeps:
    """Sweeps over the stacked rotations Y = R^T (3n, 3) until the step is small."""

    def __init__(self, problem: Problem, variant: str) -> None:
        self.variant = variant
        self.matrix = measurement_matrix(problem)
        self.stack = stacked(problem.start).copy()
        self.time_limit = problem.time_limit
        self.said = ""

    def solve(self) -> None:
        deadline = time.perf_counter() + self.time_limit
        self.set_up()
        sweeps, step = 0, np.inf
        while step >= STEP and sweeps < MAX_SWEEPS and time.perf_counter() < deadline:
            before = self.stack.copy()
            self.sweep()
            step = self.step(before)
            sweeps += 1
        end = "sweep" if sweeps == MAX_SWEEPS else "time"
        end = "converged" if step < STEP else f"{end} limit"
        self.said = f"{end} ({sweeps} sweeps)"

    def set_up(self) -> None:
        pass

    def sweep(self) -> None:
        raise NotImplementedError

    def step(self, before: NDArray[np.float64]) -> float:
        """|R^t - R^(t-1)| / |R^t|."""
        return float(np.linalg.norm(self.stack - before) / np.linalg.norm(self.stack))

    def rotations(self) -> NDArray[np.float64]:
        return unstacked(self.stack)

    def claim(self) -> str:
        return self.said


class Bcd(_Sweeps):
    """Algorithm 2: one node after the other, with the newest values."""

    def __init__(self, problem: Problem, variant: str) -> None:
        super().__init__(problem, variant)
        # For each node its three rows of R-tilde, and the rows of Y that they meet.
        self.rows: list[tuple[NDArray[np.float64], NDArray[np.int32] | slice]] = []
        for k in range(problem.num_nodes):
            if scipy.sparse.issparse(self.matrix):
                rows = self.matrix[[3 * k, 3 * k + 1, 3 * k + 2]]
                columns = np.unique(rows.indices)
                self.rows.append((rows[:, columns].toarray(), columns))
            else:
                self.rows.append((self.matrix[3 * k : 3 * k + 3], slice(None)))

    def sweep(self) -> None:
        for k, (rows, columns) in enumerate(self.rows):
            self.stack[3 * k : 3 * k + 3] = nearest_rotations(rows @ self.stack[columns])

    def step(self, before: NDArray[np.float64]) -> float:
        """The mean over k of |R_k^t - R_k^(t-1)| / |R_k|; the paper has the sum."""
        steps = np.linalg.norm((self.stack - before).reshape(-1, 9), axis=1)
        return float(np.mean(steps) / np.sqrt(3))


class Sum(_Sweeps):
    """Algorithm 3: all nodes at once; `variant` says what mu is."""

    def set_up(self) -> None:
        self.mu = 0.0
        if self.variant == "min_eigenvalue":
            least = eigsh(
                self.matrix,
                k=1,
                which="SA",
                tol=_EIGENVALUE_TOLERANCE,
                v0=np.random.default_rng(0).standard_normal(self.matrix.shape[0]),
                return_eigenvectors=False,
            )[0]
            self.mu = max(0.0, -least * (1 + 2 * _EIGENVALUE_TOLERANCE))

    def sweep(self) -> None:
        target = self.matrix @ self.stack + self.mu * self.stack
        self.stack = nearest_rotations(target.reshape(-1, 3, 3)).reshape(-1, 3)


def nearest_rotations(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotations nearest to matrices (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(matrices)
    U[..., -1] *= np.linalg.det(U @ Vt)[..., None]
    return U @ Vt
