"""SciPy's L-BFGS-B over rotation vectors w_i with R_i = exp([w_i]) start_i.

Of scipy.optimize this is what competes. On smallGrid3D, sphere-300 and complete-150, CG, TNC,
Newton-CG and trust-krylov took 1 to 3 times as long, `least_squares` with the analytic sparse
Jacobian 2 to 160 times.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from benchmarks.peers.measurement_matrix import measurement_matrix, stacked, unstacked
from benchmarks.problem import Problem


class Lbfgs:
    def __init__(self, problem: Problem, variant: str) -> None:
        self.matrix = measurement_matrix(problem)
        self.constant = 6 * problem.weights.sum()
        self.start = problem.start
        self.time_limit = problem.time_limit

    def solve(self) -> None:
        deadline = time.perf_counter() + self.time_limit

        def stop_in_time(intermediate_result: Any) -> None:
            if time.perf_counter() > deadline:
                raise StopIteration

        self.result = minimize(
            self.objective,
            np.zeros(self.start.size // 3),
            jac=True,
            method="L-BFGS-B",
            callback=stop_in_time,
            options={"maxiter": 10**6, "maxfun": 10**6, "maxcor": 20, "ftol": 1e-14, "gtol": 1e-7},
        )

    def objective(self, w: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """F = 6 sum w - tr(R Rt R^T), equation (20) of the paper, and its gradient."""
        R = self.at(w)
        Y = stacked(R)
        product = self.matrix @ Y
        K = -2 * unstacked(product) @ np.swapaxes(R, 1, 2)
        turn = np.stack(  # derivative along R_i <- exp([w]) R_i
            [K[:, 2, 1] - K[:, 1, 2], K[:, 0, 2] - K[:, 2, 0], K[:, 1, 0] - K[:, 0, 1]], axis=1
        )
        value = self.constant - float(np.sum(Y * product))
        return value, _pulled_back(w.reshape(-1, 3), turn).ravel()

    def at(self, w: NDArray[np.float64]) -> NDArray[np.float64]:
        return Rotation.from_rotvec(w.reshape(-1, 3)).as_matrix() @ self.start

    def rotations(self) -> NDArray[np.float64]:
        return self.at(self.result.x)

    def claim(self) -> str:
        end = "converged" if self.result.success else str(self.result.message).lower().strip(" :")
        if end == "abnormal" and np.abs(self.result.jac).max() <= self.lost:
            end = "converged as far as rounding lets it"
        return f"{end} ({self.result.nit} its)"

    @property
    def lost(self) -> float:
        """F is a difference, 6 sum w - …: what a step along a smaller gradient would gain is lost
        in its rounding, and a line search that looks for it ends as "abnormal".
        """
        mean_degree = self.constant / self.start.size * 3.0
        return float(np.sqrt(2.0 * np.finfo(np.float64).eps * self.constant * mean_degree))


def _pulled_back(w: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """J^T turn, J the left Jacobian of the exponential map at w; all (n, 3)."""
    angle = np.linalg.norm(w, axis=1, keepdims=True)
    small = angle < 1e-4
    t = np.where(small, 1.0, angle)
    a = np.where(small, 1 / 2, (1 - np.cos(t)) / t**2)
    b = np.where(small, 1 / 6, (t - np.sin(t)) / t**3)
    once = np.cross(w, turn)
    return turn - a * once + b * np.cross(w, once)
