"""Theia's robust estimator (Chatterjee and Govindu 2013), vision family, rotation vectors.

Theia's other estimators change their argument in place, which does not reach Python. A pair of
nodes has one edge, and all edges count alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pytheia import sfm
from scipy.spatial.transform import Rotation

from benchmarks.problem import Problem, kept_edges


class Theia:
    def __init__(self, problem: Problem, variant: str) -> None:
        self.num_nodes = problem.num_nodes
        kept = kept_edges(problem)
        j_from_i = Rotation.from_matrix(problem.rotations[kept]).inv().as_rotvec()
        self.pairs = {}
        for (i, j), rotvec in zip(problem.indices[kept].tolist(), j_from_i):
            info = sfm.TwoViewInfo()
            info.rotation_2 = rotvec
            self.pairs[i, j] = info
        self.start = dict(enumerate(Rotation.from_matrix(problem.start).inv().as_rotvec()))
        self.estimator = sfm.RobustRotationEstimator(sfm.RobustRotationEstimatorOptions())

    def solve(self) -> None:
        self.node_from_world = self.estimator.EstimateRotations(self.pairs, self.start)

    def rotations(self) -> NDArray[np.float64]:
        rotvecs = np.array([np.ravel(self.node_from_world[k]) for k in range(self.num_nodes)])
        return Rotation.from_rotvec(rotvecs).inv().as_matrix()

    def claim(self) -> str:
        return ""
