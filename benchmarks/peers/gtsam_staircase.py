"""GTSAM 4.3's certifiable staircase on factor graphs, pose family, with its default parameters.

Newer than Shonan averaging, and general: each level is a quadratically constrained problem, solved
by augmented Lagrangians.
"""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.problem import Problem

P_MIN, P_MAX = 3, 10  # the least that rotations allow, and as Shonan has it


class Staircase:
    """From the given start: the optimizer makes none of its own."""

    def __init__(self, problem: Problem, variant: str) -> None:
        graph = gtsam.NonlinearFactorGraph()
        for (i, j), rotation, weight in zip(
            problem.indices.tolist(), problem.rotations, problem.weights
        ):
            model = gtsam.noiseModel.Isotropic.Precision(9, weight)
            graph.add(gtsam.FrobeniusBetweenFactorRot3(i, j, gtsam.Rot3(rotation), model))
        start = gtsam.Values()
        for k, rotation in enumerate(problem.start):
            start.insert(k, np.asfortranarray(rotation.T))
        parameters = gtsam.RiemannianStaircaseParams()
        parameters.pMin, parameters.pMax = P_MIN, P_MAX
        self.optimizer = gtsam.RiemannianStaircaseOptimizer(graph, start, parameters)
        self.num_nodes = problem.num_nodes

    def solve(self) -> None:
        self.result = self.optimizer.optimize()
        if not self.result.hasRoundedSolution():
            raise RuntimeError("no rounded solution")

    def rotations(self) -> NDArray[np.float64]:
        """Orthogonal to some digits, and all of them may be reflections: -Q is as good as Q."""
        values = self.result.roundedValues()
        Q = np.array([values.atMatrix(k).T for k in range(self.num_nodes)])
        if np.median(np.linalg.det(Q)) < 0:
            Q = -Q
        return rotavg.nearest_rotation(Q)

    def claim(self) -> str:
        verdict = "certified" if self.result.certified else "not certified"
        return f"{verdict}: min. eigenvalue {self.result.minEigenvalue:.0e}"
