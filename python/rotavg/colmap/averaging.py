"""A drop-in for `pycolmap.run_rotation_averaging`, on the same objects."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, OptionError, require
from rotavg.colmap.pose_graph import from_pose_graph
from rotavg.graph.conventions import convert_family
from rotavg.graph.ids import rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_database import pair_id_of
from rotavg.solving.solve import solve


def run_rotation_averaging(
    options: Any,
    pose_graph: Any,
    reconstruction: Any,
    pose_priors: Sequence[Any] = (),
    **solve_options: Any,
) -> bool:
    """Average rotations as `pycolmap.run_rotation_averaging` does, by `rotavg.solve`.

    The frames of the largest connected component get `rig_from_world` with the rotation found and
    no position (NaN), and are registered; others are not. Edges that the rotations contradict by
    more than `max_rotation_error_deg`, and edges of other frames, become invalid.

    Args:
        options: `pycolmap.RotationEstimatorOptions`. Of these count `max_rotation_error_deg` (0
            for no limit), `reweighting` (UNIFORM: every edge weighs 1, else its number of matches)
            and `skip_initialization` (start from the frames' rotations). The others set up COLMAP's
            own solver.
        pose_graph: `pycolmap.PoseGraph`; edges become invalid.
        reconstruction: `pycolmap.Reconstruction` with the images; rigs are calibrated.
        pose_priors: not used.
        **solve_options: of `rotavg.solve`, such as `loss`, `method` and `num_threads`.

    Returns:
        Whether there was anything to average.

    Raises:
        OptionError: `use_gravity` is set.
        GraphError: an edge's image is not in the reconstruction, or a sensor's place in its rig is
            not known.
        MissingExtraError: pycolmap is not installed.
    """
    pycolmap = require("pycolmap", "colmap")
    if options.use_gravity:
        raise OptionError("use_gravity is set, expected False: gravity is not used")
    del pose_priors
    uniform = options.reweighting == pycolmap.RotationAveragingReweighting.UNIFORM
    try:
        images = from_pose_graph(pose_graph, unit_weights=uniform)
        graph, rig_from_camera = _between_frames(reconstruction, images)
        graph = graph.largest_component()
    except GraphError as error:
        if error.edge is not None:
            raise
        return False
    if "init" not in solve_options and options.skip_initialization:
        solve_options["init"] = _current(reconstruction, graph)
    if "loss" in inspect.signature(solve).parameters:
        solve_options.setdefault("loss", "auto")
    solution = solve(graph, **{"certify": False, **solve_options})

    rotations = dict(zip(graph.nodes.tolist(), solution.rotations))
    frame_of = {k: _frame(reconstruction, k).frame_id for k in images.nodes.tolist()}
    world_from_camera = {
        k: rotations[frame_of[k]] @ rig_from_camera[k] for k in frame_of if frame_of[k] in rotations
    }
    _invalidate(pose_graph, images, world_from_camera, options.max_rotation_error_deg)
    active = _active(pose_graph, frame_of, set(world_from_camera))
    pose_graph.invalidate_pairs_outside_active_image_ids(active)
    _register(pycolmap, reconstruction, rotations, {frame_of[k] for k in active})
    return True


def _frame(reconstruction: Any, image_id: int) -> Any:
    if not reconstruction.exists_image(image_id):
        raise GraphError(f"image {image_id} is not in the reconstruction", edge=0)
    return reconstruction.frame(reconstruction.image(image_id).frame_id)


def _between_frames(
    reconstruction: Any, images: MeasurementGraph
) -> tuple[MeasurementGraph, dict[int, NDArray[np.float64]]]:
    """The graph on frames instead of images, and rig_from_camera of every image."""
    turn: dict[int, NDArray[np.float64]] = {}
    frames: dict[int, int] = {}
    for image_id in images.nodes.tolist():
        frame = _frame(reconstruction, image_id)
        sensor = reconstruction.image(image_id).camera.sensor_id
        frames[image_id] = frame.frame_id
        if frame.rig.is_ref_sensor(sensor):
            turn[image_id] = np.eye(3)
        elif frame.rig.has_sensor_from_rig(sensor):
            camera_from_rig = frame.rig.sensor_from_rig(sensor).rotation.matrix()
            turn[image_id] = convert_family(camera_from_rig, "vision")
        else:
            found = f"the place of camera {sensor.id} in rig {frame.rig_id} is not known"
            raise GraphError(f"{found}, expected a calibrated rig", edge=0)
    i, j = images.edges.T.tolist()
    ends = np.array([[frames[a], frames[b]] for a, b in zip(i, j)])
    apart = ends[:, 0] != ends[:, 1]
    rig_from_i = np.array([turn[a] for a in i])
    j_from_rig = np.array([turn[b].T for b in j])
    rotations = rig_from_i @ images.rotations @ j_from_rig
    return MeasurementGraph(ends[apart], rotations[apart], images.weights[apart]), turn


def _current(reconstruction: Any, graph: MeasurementGraph) -> Any:
    """Rotations (n, 3, 3) of the frames as they are; "auto" where one has none."""
    frames = [reconstruction.frame(k) for k in graph.nodes.tolist()]
    if not all(frame.has_pose() for frame in frames):
        return "auto"
    rig_from_world = np.array([frame.rig_from_world.rotation.matrix() for frame in frames])
    return convert_family(rig_from_world, "vision")


def _invalidate(
    pose_graph: Any,
    images: MeasurementGraph,
    world_from_camera: dict[int, NDArray[np.float64]],
    limit_deg: float,
) -> None:
    """Mark the edges that are further than the limit from what was found."""
    if not limit_deg > 0:
        return
    for (i, j), R in zip(images.edges.tolist(), images.rotations):
        if i in world_from_camera and j in world_from_camera:
            error = world_from_camera[j].T @ world_from_camera[i] @ R
            cosine = np.clip((np.trace(error) - 1) / 2, -1, 1)
            if np.degrees(np.arccos(cosine)) > limit_deg:
                pose_graph.set_invalid_edge(pair_id_of(i, j))


def _active(pose_graph: Any, frame_of: dict[int, int], solved: set[int]) -> set[int]:
    """Images of the largest set of solved frames that valid edges still hold together."""
    if not any(edge.valid for edge in pose_graph.edges.values()):
        return set()
    left = from_pose_graph(pose_graph)
    ends = np.vectorize(frame_of.__getitem__)(left.edges)
    inside = np.isin(left.edges, list(solved)).all(axis=1) & (ends[:, 0] != ends[:, 1])
    if not inside.any():
        return set()
    R = np.broadcast_to(np.eye(3), (int(inside.sum()), 3, 3))
    frames = MeasurementGraph(ends[inside], R).largest_component().nodes
    return {k for k in solved if (rows_of(np.array([frame_of[k]]), frames) >= 0).all()}


def _register(
    pycolmap: Any,
    reconstruction: Any,
    rotations: dict[int, NDArray[np.float64]],
    active: set[int],
) -> None:
    for frame_id in list(reconstruction.frames):
        frame = reconstruction.frame(frame_id)
        if frame_id not in active:
            if frame.has_pose():
                reconstruction.deregister_frame(frame_id)
            continue
        rig_from_world = np.ascontiguousarray(convert_family(rotations[frame_id], "vision"))
        nowhere = np.full(3, np.nan)
        frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(rig_from_world), nowhere)
        reconstruction.register_frame(frame_id)
