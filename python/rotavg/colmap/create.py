"""A COLMAP database of what was measured in a folder of photographs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from rotavg.base.errors import require
from rotavg.colmap.new_database import new_database
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.images import Measurement, Pair, Photograph
from rotavg.images.epipolar import essential_matrix


def create_database(path: str | os.PathLike[str], measured: Measurement) -> None:
    """Write a COLMAP database: cameras, images, features, matches and two-view geometries.

    Image k is the k-th photograph, from 1. Photographs of equal size and focal length share a
    camera, SIMPLE_RADIAL with no distortion yet. Raises FileAccessError if there is a file
    already or it cannot be written, MissingExtraError without pycolmap.
    """
    pycolmap = require("pycolmap", "colmap")
    with new_database(Path(path)) as temporary:
        database = pycolmap.Database.open(temporary)
        _write_images(pycolmap, database, measured.photographs)
        image_id = {photo.name: k for k, photo in enumerate(measured.photographs, 1)}
        photographs = {photo.name: photo for photo in measured.photographs}
        for pair in measured.pairs:
            ids = image_id[pair.i], image_id[pair.j]
            database.write_matches(*ids, pair.matches.astype(np.uint32))
            geometry = _geometry(pycolmap, pair, photographs[pair.i], photographs[pair.j])
            database.write_two_view_geometry(*ids, geometry)
        database.close()


def _write_images(pycolmap: Any, database: Any, photographs: list[Photograph]) -> None:
    cameras: dict[tuple[int, int, float], tuple[Any, int]] = {}
    for k, photo in enumerate(photographs, 1):
        kind = photo.width, photo.height, photo.focal
        if kind not in cameras:
            camera = pycolmap.Camera.create_from_model_name(
                0, "SIMPLE_RADIAL", photo.focal, photo.width, photo.height
            )
            camera.has_prior_focal_length = True
            camera.camera_id = database.write_camera(camera)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(camera.sensor_id)
            cameras[kind] = camera, database.write_rig(rig)
        camera, rig_id = cameras[kind]
        image = pycolmap.Image(name=photo.name, camera_id=camera.camera_id, image_id=k)
        database.write_image(image, True)
        frame = pycolmap.Frame()
        frame.rig_id = rig_id
        frame.add_data_id(image.data_id)
        database.write_frame(frame)
        database.write_keypoints(k, photo.points.astype(np.float32))
        descriptors = pycolmap.FeatureDescriptors(
            pycolmap.FeatureExtractorType.SIFT, photo.descriptors
        )
        database.write_descriptors(k, descriptors)


def _geometry(pycolmap: Any, pair: Pair, first: Photograph, second: Photograph) -> Any:
    geometry = pycolmap.TwoViewGeometry()
    pose = pair.two_view
    if pose is None:
        geometry.config = pycolmap.TwoViewGeometryConfiguration.DEGENERATE
        return geometry
    configuration = pycolmap.TwoViewGeometryConfiguration
    geometry.config = {
        "general": configuration.CALIBRATED,
        "planar": configuration.PLANAR,
        "rotation": configuration.PANORAMIC,
    }[pose.kind]
    rotation = pycolmap.Rotation3d(quaternions_from_matrices(pose.j_from_i))
    geometry.cam2_from_cam1 = pycolmap.Rigid3d(rotation, pose.translation)
    geometry.E = essential_matrix(pose.j_from_i, pose.translation)
    inverse = [np.linalg.inv(_calibration(photo)) for photo in (first, second)]
    geometry.F = inverse[1].T @ geometry.E @ inverse[0]
    geometry.inlier_matches = pair.matches[pose.inliers].astype(np.uint32)
    return geometry


def _calibration(photo: Photograph) -> Any:
    f, x, y = photo.focal, photo.width / 2, photo.height / 2
    return np.array([[f, 0, x], [0, f, y], [0, 0, 1]])
