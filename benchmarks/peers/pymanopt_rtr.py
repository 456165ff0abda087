"""Pymanopt's Riemannian trust regions (Absil, Baker, Gallivan 2007), from the shortest paths."""

from __future__ import annotations

import numpy as np
import pymanopt
from numpy.typing import NDArray

from benchmarks.peers.measurement_matrix import measurement_matrix, stacked, unstacked
from benchmarks.problem import Problem


class TrustRegions:
    def __init__(self, problem: Problem, variant: str) -> None:
        matrix = measurement_matrix(problem)
        constant = 6 * problem.weights.sum()
        manifold = pymanopt.manifolds.SpecialOrthogonalGroup(3, k=problem.num_nodes)

        # f = 6 sum w - tr(R Rt R^T) in the ambient space: its gradient is -2 R Rt.
        @pymanopt.function.numpy(manifold)
        def cost(R: NDArray[np.float64]) -> float:
            Y = stacked(R)
            return float(constant - np.sum(Y * (matrix @ Y)))

        @pymanopt.function.numpy(manifold)
        def gradient(R: NDArray[np.float64]) -> NDArray[np.float64]:
            return -2 * unstacked(matrix @ stacked(R))

        @pymanopt.function.numpy(manifold)
        def hessian(R: NDArray[np.float64], V: NDArray[np.float64]) -> NDArray[np.float64]:
            return -2 * unstacked(matrix @ stacked(V))

        self.problem = pymanopt.Problem(
            manifold, cost, euclidean_gradient=gradient, euclidean_hessian=hessian
        )
        self.start = problem.start
        self.optimizer = pymanopt.optimizers.TrustRegions(verbosity=0, max_time=problem.time_limit)

    def solve(self) -> None:
        self.result = self.optimizer.run(self.problem, initial_point=self.start)

    def rotations(self) -> NDArray[np.float64]:
        return self.result.point

    def claim(self) -> str:
        said = self.result.stopping_criterion
        end = "converged" if "min grad norm" in said else said.split(";")[0]
        return f"{end} ({self.result.iterations} its)"
