"""COLMAP's rotation averaging (GLOMAP's), vision family.

A pair of nodes has one edge, and all edges count alike.
"""

from __future__ import annotations

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.problem import Problem, kept_edges


class Colmap:
    def __init__(self, problem: Problem, variant: str) -> None:
        pycolmap.logging.minloglevel = pycolmap.logging.WARNING.value
        self.num_nodes = problem.num_nodes
        # Image ids start from 1. Each image is a rig of its own, so that each has a free rotation.
        self.reconstruction = pycolmap.Reconstruction()
        camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE", width=2, height=2, params=[1, 1, 1], camera_id=1
        )
        self.reconstruction.add_camera_with_trivial_rig(camera)
        for k in range(self.num_nodes):
            self.reconstruction.add_image_with_trivial_frame(
                pycolmap.Image(name=str(k), camera_id=1, image_id=k + 1)
            )
        kept = kept_edges(problem)
        self.pose_graph = pycolmap.PoseGraph()
        j_from_i = Rotation.from_matrix(problem.rotations[kept]).inv().as_quat()
        for (i, j), xyzw in zip(problem.indices[kept].tolist(), j_from_i):
            edge = pycolmap.PoseGraphEdge(
                cam2_from_cam1=pycolmap.Rigid3d(pycolmap.Rotation3d(xyzw), np.zeros(3)),
                num_matches=1,
            )
            self.pose_graph.add_edge(i + 1, j + 1, edge)

    def solve(self) -> None:
        options = pycolmap.RotationEstimatorOptions(random_seed=0)
        self.succeeded = pycolmap.run_rotation_averaging(
            options, self.pose_graph, self.reconstruction, []
        )

    def rotations(self) -> NDArray[np.float64]:
        images = [self.reconstruction.images[k + 1] for k in range(self.num_nodes)]
        without = sum(not image.has_pose for image in images)
        if without:
            raise RuntimeError(f"{without} of {self.num_nodes} nodes got no rotation")
        return np.array([image.cam_from_world().rotation.matrix().T for image in images])

    def claim(self) -> str:
        return "success" if self.succeeded else "failure"
