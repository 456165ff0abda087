"""GTSAM's Shonan averaging (Dellaert et al. 2020), pose family, with GTSAM's default parameters."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import NDArray

from benchmarks.problem import Problem

P_MIN, P_MAX = 3, 10  # GTSAM's defaults


class Shonan:
    """`variant` is "random", the start that GTSAM makes, or "tree", the given one."""

    def __init__(self, problem: Problem, variant: str) -> None:
        measurements = [
            gtsam.BinaryMeasurementRot3(
                i, j, gtsam.Rot3(rotation), gtsam.noiseModel.Isotropic.Precision(3, weight)
            )
            for (i, j), rotation, weight in zip(
                problem.indices.tolist(), problem.rotations, problem.weights
            )
        ]
        parameters = gtsam.ShonanAveragingParameters3(
            gtsam.LevenbergMarquardtParams.CeresDefaults()
        )
        self.threshold = parameters.getOptimalityThreshold()
        self.averaging = gtsam.ShonanAveraging3(measurements, parameters)
        self.start = None
        if variant == "tree":
            self.start = gtsam.Values()
            for k, rotation in enumerate(problem.start):
                self.start.insert(k, gtsam.Rot3(rotation))
        self.num_nodes = problem.num_nodes

    def solve(self) -> None:
        start = self.averaging.initializeRandomly() if self.start is None else self.start
        # Raises where no level p gives an answer that GTSAM accepts.
        self.values, self.lambda_min = self.averaging.run(start, P_MIN, P_MAX)

    def rotations(self) -> NDArray[np.float64]:
        return np.array([self.values.atRot3(k).matrix() for k in range(self.num_nodes)])

    def claim(self) -> str:
        return f"accepted: min. eigenvalue {self.lambda_min:.0e} > {self.threshold:.0e}"
