"""COLMAP databases of synthetic scenes whose points are noisy, by pycolmap, and their truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.conventions import convert_family


def dataset(path: Path, seed: int, noise: float = 1.0, **options: Any) -> Any:
    """Write a database whose pairs COLMAP has verified again from the noisy points.

    Args:
        path: of the database, to be made.
        seed: of everything.
        noise: of the points, pixels.
        options: of pycolmap's `SyntheticDatasetOptions`.

    Returns:
        The truth, a `pycolmap.Reconstruction`.
    """
    import pycolmap

    pycolmap.logging.minloglevel = 3
    pycolmap.set_random_seed(seed)
    settings = {"num_rigs": 1, "num_frames_per_rig": 8, "num_points3D": 200, **options}
    with pycolmap.Database.open(str(path)) as database:
        truth = pycolmap.synthesize_dataset(pycolmap.SyntheticDatasetOptions(**settings), database)
        of_points = pycolmap.SyntheticNoiseOptions(point2D_stddev=noise)
        pycolmap.synthesize_noise(of_points, truth, database)
        cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}
        for camera in cameras.values():
            camera.has_prior_focal_length = True  # calibrated
        camera_of = {image.image_id: image.camera_id for image in database.read_all_images()}
        points = {k: database.read_keypoints(k)[:, :2].astype(np.float64) for k in camera_of}
        verify = pycolmap.TwoViewGeometryOptions(compute_relative_pose=True)
        verify.ransac.random_seed = seed
        for pair in database.read_two_view_geometries()[0]:
            i, j = pycolmap.pair_id_to_image_pair(pair)
            sides = cameras[camera_of[i]], points[i], cameras[camera_of[j]], points[j]
            found = pycolmap.estimate_two_view_geometry(*sides, database.read_matches(i, j), verify)
            database.update_two_view_geometry(i, j, found)
    return truth


def true_rotations(truth: Any, names: list[str]) -> NDArray[np.float64]:
    """World_from_image (n, 3, 3) of images by their names."""
    of = {image.name: image.cam_from_world().rotation.matrix() for image in truth.images.values()}
    return np.asarray(convert_family(np.array([of[name] for name in names]), "vision"))
