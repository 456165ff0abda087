"""Databases of pycolmap's synthetic datasets, with noise in the relative rotations."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np

from rotavg.graph.conventions import (
    matrices_from_quaternions,
    matrices_from_rotvecs,
    quaternions_from_matrices,
)


class Scene:
    """A database of two rigs with ten frames each, by default, and what is true of it.

    Attributes:
        path: the database.
        reconstruction: pycolmap's, the truth.
        truth: world_from_image (3, 3) by the images' names.
    """

    def __init__(
        self,
        path: Path,
        seed: int,
        *,
        noise: float = 0.0,
        wrong: float = 0.0,
        rigs: int = 2,
        cameras: int = 3,
        frames: int = 10,
        **options: Any,
    ) -> None:
        """Noise in degrees per axis, and the share of pairs that are wrong; `options`: gravity."""
        import pycolmap

        pycolmap.logging.minloglevel = 3
        pycolmap.set_random_seed(seed)
        settings = pycolmap.SyntheticDatasetOptions(
            num_rigs=rigs, num_cameras_per_rig=cameras, num_frames_per_rig=frames, num_points3D=50,
            sensor_from_rig_rotation_stddev=20.0, two_view_geometry_has_relative_pose=True,
            prior_gravity=options.get("gravity", False),
        )  # fmt: skip
        database = pycolmap.Database.open(str(path))
        self.path = path
        self.reconstruction = pycolmap.synthesize_dataset(settings, database)
        database.close()
        self.truth = rotations_of(self.reconstruction)
        if noise or wrong:
            _disturb(path, np.radians(noise), wrong, seed)


def rotations_of(reconstruction: Any) -> dict[str, Any]:
    """World_from_image (3, 3) of the images that have a pose, by their names."""
    return {
        image.name: image.cam_from_world().rotation.matrix().T
        for image in reconstruction.images.values()
        if image.has_pose
    }


def _disturb(path: Path, noise: float, wrong: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    with sqlite3.connect(path) as connection:
        rows = connection.execute("SELECT pair_id, qvec FROM two_view_geometries").fetchall()
        for pair, blob in rows:
            R = matrices_from_quaternions(np.frombuffer(blob)[[1, 2, 3, 0]])
            turn = rng.normal(size=3) * (3 if rng.random() < wrong else noise)
            q = quaternions_from_matrices(R @ matrices_from_rotvecs(turn))
            connection.execute(
                "UPDATE two_view_geometries SET qvec = ? WHERE pair_id = ?",
                (q[[3, 0, 1, 2]].tobytes(), pair),
            )
    connection.close()
