"""A drop-in for `pycolmap.run_gravity_refinement`, on the same objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, require
from rotavg.colmap.frames import Frames, frames_of
from rotavg.colmap.pose_graph import from_pose_graph
from rotavg.graph.measurement_graph import MeasurementGraph


def run_gravity_refinement(
    options: Any, pose_graph: Any, reconstruction: Any, pose_priors: Sequence[Any]
) -> None:
    """Replace the gravity of frames that most of their neighbours contradict, in `pose_priors`.

    As COLMAP does it: where `min_num_neighbors` edges or more join a frame to images with gravity,
    and a share of `max_outlier_ratio` or more contradicts its own by more than `max_gravity_error`
    degrees, it becomes the median of what the neighbours say, if fewer than that share are further
    than twice as much from it. Gravity counts of images of reference sensors.

    Args:
        options: `pycolmap.GravityRefinerOptions`.
        pose_graph: `pycolmap.PoseGraph`.
        reconstruction: `pycolmap.Reconstruction` with the images.
        pose_priors: `pycolmap.PosePrior`s; their `gravity` is changed.

    Raises:
        GraphError: an edge's image is not in the reconstruction.
        MissingExtraError: pycolmap is not installed.
    """
    pycolmap = require("pycolmap", "colmap")
    try:
        graph = from_pose_graph(pose_graph, unit_weights=True)
    except GraphError:
        return  # no valid edge
    frames = frames_of(reconstruction, graph.nodes.tolist(), True)
    priors: dict[int, Any] = {}
    for prior in pose_priors:
        of_camera = prior.corr_data_id.sensor_id.type == pycolmap.SensorType.CAMERA
        image_id = int(prior.corr_data_id.id)
        if of_camera and prior.has_gravity() and reconstruction.exists_image(image_id):
            image = reconstruction.image(image_id)
            if image.is_ref_in_frame():
                priors[int(image.frame_id)] = prior
    limit = float(np.radians(options.max_gravity_error))
    said = _what_neighbours_say(graph, frames, priors)
    refined = {}
    for frame, directions in said.items():
        own = _unit(np.asarray(priors[frame].gravity, dtype=np.float64))
        if len(directions) < options.min_num_neighbors:
            continue
        if np.mean(_angles(directions, own) > limit) < options.max_outlier_ratio:
            continue
        median = _median(directions)
        if np.mean(_angles(directions, median) > 2 * limit) < options.max_outlier_ratio:
            refined[frame] = median
    for frame, median in refined.items():
        priors[frame].gravity = median


def _what_neighbours_say(
    graph: MeasurementGraph, frames: Frames, priors: dict[int, Any]
) -> dict[int, NDArray[np.float64]]:
    """Down (k, 3) in the rig of every frame with gravity, as edges from other frames have it."""
    down = {f: _unit(np.asarray(p.gravity, dtype=np.float64)) for f, p in priors.items()}
    said: dict[int, list[NDArray[np.float64]]] = {}
    for (i, j), R in zip(graph.edges.tolist(), graph.rotations):
        a, b = frames.frame_of[i], frames.frame_of[j]
        C_i = frames.rotation_of.get(frames.sensor_of[i])
        C_j = frames.rotation_of.get(frames.sensor_of[j])
        if a == b or a not in down or b not in down or C_i is None or C_j is None:
            continue
        a_from_b = C_i @ R @ C_j.T
        said.setdefault(a, []).append(a_from_b @ down[b])
        said.setdefault(b, []).append(a_from_b.T @ down[a])
    return {frame: np.array(directions) for frame, directions in said.items()}


def _median(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The unit vector with the least sum of distances (Weiszfeld 1937)."""
    apart = np.linalg.norm(directions[:, None] - directions, axis=2)
    median = directions[int(np.argmin(apart.sum(axis=1)))]
    for _ in range(50):
        weights = 1 / np.maximum(1e-3, np.linalg.norm(directions - median, axis=1))
        median = _unit(weights @ directions)
    return np.asarray(median)


def _angles(directions: NDArray[np.float64], to: NDArray[np.float64]) -> NDArray[np.float64]:
    chords = np.linalg.norm(directions - to, axis=1)
    return np.asarray(2 * np.arcsin(np.minimum(1, chords / 2)))


def _unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(v / np.linalg.norm(v))
