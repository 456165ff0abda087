"""GTSAM's linear method fastSyncRot3, alone or followed by least squares; pose family.

FrobeniusBetweenFactorRot3 has the residual R_j - R_i R_ij: the objective of rotavg.
"""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import NDArray

from benchmarks.problem import Problem


class FastSync:
    """`variant` is "lm" for Levenberg-Marquardt after the linear method."""

    def __init__(self, problem: Problem, variant: str) -> None:
        self.graph = gtsam.NonlinearFactorGraph()
        for (i, j), rotation, weight in zip(
            problem.indices.tolist(), problem.rotations, problem.weights
        ):
            model = gtsam.noiseModel.Isotropic.Precision(9, weight)
            self.graph.add(gtsam.FrobeniusBetweenFactorRot3(i, j, gtsam.Rot3(rotation), model))
        self.refine = variant == "lm"
        self.num_nodes = problem.num_nodes
        self.said = ""

    def solve(self) -> None:
        self.values = gtsam.fastSyncRot3(self.graph)
        if self.refine:
            # The common rotation is held where the linear method has put node 0.
            self.graph.add(gtsam.FrobeniusPriorRot3(0, self.values.atRot3(0).matrix()))
            optimizer = gtsam.LevenbergMarquardtOptimizer(
                self.graph, self.values, gtsam.LevenbergMarquardtParams.CeresDefaults()
            )
            self.values = optimizer.optimize()
            self.said = f"{optimizer.iterations()} its"

    def rotations(self) -> NDArray[np.float64]:
        return np.array([self.values.atRot3(k).matrix() for k in range(self.num_nodes)])

    def claim(self) -> str:
        return self.said
