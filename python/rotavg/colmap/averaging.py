"""A drop-in for `pycolmap.run_rotation_averaging`, on the same objects."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.errors import GraphError, require
from rotavg.colmap.frames import Frames, Matrix, frames_of, largest_component
from rotavg.colmap.pose_graph import from_pose_graph
from rotavg.graph.conventions import convert_family
from rotavg.graph.ids import IdArray
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_sqlite import pair_id_of
from rotavg.priors.priors import Priors, Rigs
from rotavg.solving.headings import frame_headings, trusted_weight
from rotavg.solving.solve import solve


def run_rotation_averaging(
    options: Any,
    pose_graph: Any,
    reconstruction: Any,
    pose_priors: Sequence[Any] = (),
    *,
    database: str | os.PathLike[str] | None = None,
    **solve_options: Any,
) -> bool:
    """Average rotations as `pycolmap.run_rotation_averaging` does, by `rotavg.solve`.

    The frames of the largest connected component get `rig_from_world` with the rotation found and
    no position (NaN), and are registered; others are not. Sensors whose place in their rig is not
    known get `sensor_from_rig`, likewise. Edges that the rotations contradict by more than
    `max_rotation_error_deg`, and edges of other frames, become invalid.

    Args:
        options: `pycolmap.RotationEstimatorOptions` (docs/partners.md has a table of them). Those
            that set up COLMAP's own solver (numbers of iterations, thresholds, seed, ridge,
            `use_stratified`) have no effect, as the optimum does not depend on them. The loss is
            that of `weight_type` and `irls_loss_parameter_sigma`; pass loss="auto" for ours.
        pose_graph: `pycolmap.PoseGraph`; edges become invalid.
        reconstruction: `pycolmap.Reconstruction` with the images.
        pose_priors: `pycolmap.PosePrior`s, whose gravity counts with `use_gravity`, of images of
            reference sensors, as it does for COLMAP: there only the heading is free.
        database: COLMAP's, of these images: then the covariances of the relative rotations are
            estimated from its inliers and honoured (`anisotropic=True`, docs/covariances.md), but
            where gravity leaves but the headings.
        **solve_options: of `rotavg.solve`, such as `loss`, `method` and `num_threads`.

    Returns:
        Whether there was anything to average, and something is left of it.

    Raises:
        GraphError: an edge's image is not in the reconstruction, or a sensor's place in its rig is
            not known and `refine_sensor_from_rig` is off.
        MissingExtraError: pycolmap is not installed.
    """
    pycolmap = require("pycolmap", "colmap")
    uniform = options.reweighting == pycolmap.RotationAveragingReweighting.UNIFORM
    try:
        images = from_pose_graph(pose_graph, unit_weights=uniform, database=database)
    except GraphError:
        return False  # no valid edge
    frames = frames_of(reconstruction, images.nodes.tolist(), bool(options.refine_sensor_from_rig))
    graph = _active(pose_graph, frames, images, bool(options.filter_unregistered))
    if graph is None:
        return False
    if "loss" not in solve_options:
        for name, value in _of_loss(pycolmap, options).items():
            solve_options.setdefault(name, value)
    if "init" not in solve_options and options.skip_initialization:
        solve_options["init"] = _current(reconstruction, frames, graph)
    gravity = _gravity(pycolmap, options, reconstruction, pose_priors)
    solve_options.setdefault("certify", False)
    found, sensors = _solve(graph, frames, gravity, options, solve_options)
    _register(pycolmap, reconstruction, found)
    _place(pycolmap, reconstruction, frames, sensors)
    limit = float(options.max_rotation_error_deg)
    return not limit > 0 or _filter(
        pose_graph, reconstruction, graph, frames, found, sensors, limit
    )


def _active(
    pose_graph: Any, frames: Frames, images: MeasurementGraph, only_posed: bool
) -> MeasurementGraph | None:
    """The edges of the largest component of frames; others become invalid."""
    inside = np.ones(images.num_edges, dtype=bool)
    if frames.without_place:
        # First with sensors that are not known as frames by themselves, as COLMAP has it.
        inside &= _keep_largest(pose_graph, frames.bodies(images.nodes), images, inside)
    elif only_posed:
        posed = np.isin(frames.rows(images.nodes), list(frames.poses))
        inside &= posed[images.indices].all(axis=1)
    if not inside.any():
        return None
    inside &= _keep_largest(pose_graph, frames.rows(images.nodes), images, inside)
    i, R, w = images.edges[inside], images.rotations[inside], images.weights[inside]
    C = None if images.covariances is None else images.covariances[inside]
    return images if inside.all() else MeasurementGraph(i, R, w, covariances=C)


def _keep_largest(
    pose_graph: Any, label: IdArray, images: MeasurementGraph, inside: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which edges (m,) are in the largest component of labels (n,); other pairs become invalid."""
    kept = np.isin(label, list(largest_component(label, images.indices[inside])))
    active = images.nodes[kept]
    if len(active) < images.num_nodes or not inside.all():
        pose_graph.invalidate_pairs_outside_active_image_ids(set(active.tolist()))
    return np.asarray(kept[images.indices].all(axis=1))


def _of_loss(pycolmap: Any, options: Any) -> dict[str, Any]:
    """COLMAP's loss, as ours."""
    if options.weight_type == pycolmap.RotationWeightType.HALF_NORM:
        return {"loss": "l_half"}
    sigma = float(np.radians(options.irls_loss_parameter_sigma))
    return {"loss": "geman_mcclure", "loss_scale": min(max(sigma, 1e-6), np.pi)}


def _current(reconstruction: Any, frames: Frames, graph: MeasurementGraph) -> Any:
    """Rotations (n, 3, 3) of the images as they are; "auto" where one has none."""
    R = []
    for image in graph.nodes.tolist():
        frame, sensor = frames.frame_of[image], frames.sensor_of[image]
        if frame not in frames.poses or sensor not in frames.rotation_of:
            return "auto"
        rig_from_world = reconstruction.frame(frame).rig_from_world.rotation.matrix()
        R.append(convert_family(rig_from_world, "vision") @ frames.rotation_of[sensor])
    return np.array(R)


def _gravity(
    pycolmap: Any, options: Any, reconstruction: Any, pose_priors: Sequence[Any]
) -> dict[int, Matrix]:
    """Down in the rig of every frame that has it from its reference sensor, by frame."""
    found: dict[int, Matrix] = {}
    if not options.use_gravity:
        return found
    for prior in pose_priors:
        of_camera = prior.corr_data_id.sensor_id.type == pycolmap.SensorType.CAMERA
        if not of_camera or not prior.has_gravity():
            continue
        image_id = int(prior.corr_data_id.id)
        if reconstruction.exists_image(image_id):
            image = reconstruction.image(image_id)
            if image.is_ref_in_frame():
                found[int(image.frame_id)] = np.array(prior.gravity, dtype=np.float64)
    return found


def _solve(
    graph: MeasurementGraph,
    frames: Frames,
    gravity: dict[int, Matrix],
    options: Any,
    settings: dict[str, Any],
) -> tuple[dict[int, Matrix], dict[int, Matrix]]:
    """World_from_rig of every frame, and rig_from_sensor of the sensors that were not known."""
    ids = graph.nodes.tolist()
    pictures = frames.pictures(ids)
    of_frames = {frame for frame, _ in pictures.values()}
    gravity = {frame: down for frame, down in gravity.items() if frame in of_frames}
    if len(of_frames) == 1 and len(ids) > 1:
        return _one_frame(graph, frames, gravity, options, settings)
    down = np.asarray(options.gravity_dir, dtype=np.float64)
    known = {s: C for s, C in frames.rotation_of.items() if s not in frames.unknown}
    if gravity and gravity.keys() == of_frames and not frames.unknown:
        rigs = {k: (frame, known[s]) for k, (frame, s) in pictures.items()}
        return frame_headings(graph, rigs, gravity, down, **settings), {}
    priors = Priors(down=down, gravity=_of_images(graph, frames, pictures, gravity))
    if frames.unknown:
        priors = replace(priors, rigs=Rigs(pictures, known))
    elif not frames.are_trivial:
        priors = replace(priors, rigs={k: (f, known[s]) for k, (f, s) in pictures.items()})
    nothing = not priors.rigs and not priors.gravity
    if graph.covariances is not None:
        settings.setdefault("anisotropic", True)
    solution = solve(
        graph, priors=None if nothing else priors, **{"robust_priors": False, **settings}
    )
    sensors = {}
    if solution.rigs is not None:
        fit = solution.rigs
        known = fit.rotation_of
        sensors = {s: known[s] for s in frames.unknown if s in known}
    found: dict[int, Matrix] = {}
    for k, (frame, sensor) in pictures.items():
        found.setdefault(frame, solution[k] @ known[sensor].T)
    return found, sensors


def _of_images(
    graph: MeasurementGraph,
    frames: Frames,
    pictures: dict[int, tuple[int, int]],
    gravity: dict[int, Matrix],
) -> dict[int, tuple[Matrix, float]]:
    """Down in one image of every frame that has it."""
    if not gravity:
        return {}
    weight = trusted_weight(graph)
    found, done = {}, set()
    for k, (frame, sensor) in pictures.items():
        if frame in gravity and frame not in done and sensor in frames.rotation_of:
            found[k] = frames.rotation_of[sensor].T @ gravity[frame], weight
            done.add(frame)
    return found


def _one_frame(
    graph: MeasurementGraph,
    frames: Frames,
    gravity: dict[int, Matrix],
    options: Any,
    settings: dict[str, Any],
) -> tuple[dict[int, Matrix], dict[int, Matrix]]:
    """A frame whose images see each other alone: it has the identity, or hangs down."""
    (frame,) = {frames.frame_of[k] for k in graph.nodes.tolist()}
    world_from_rig = np.eye(3)
    if frame in gravity:
        node = MeasurementGraph([[0, 1]], [np.eye(3)])
        down = (gravity[frame], 1.0)
        priors = Priors(down=options.gravity_dir, gravity={0: down})
        world_from_rig = np.array(solve(node, priors=priors)[0])
    sensors: dict[int, Matrix] = {}
    if frames.unknown:
        part = graph.largest_component()
        pictures = frames.pictures(part.nodes.tolist())
        solution = solve(part, **{k: v for k, v in settings.items() if k != "init"})
        known = {s: k for k, (_, s) in pictures.items() if s in frames.rotation_of}
        for sensor, image in known.items():
            rig_from_world = frames.rotation_of[sensor] @ solution[image].T
            sensors = {
                s: rig_from_world @ solution[k]
                for k, (_, s) in pictures.items()
                if s in frames.unknown
            }
            break
    return {frame: world_from_rig}, sensors


def _register(pycolmap: Any, reconstruction: Any, found: dict[int, Matrix]) -> None:
    nowhere = np.full(3, np.nan)
    for frame_id, R in found.items():
        rig_from_world = np.ascontiguousarray(convert_family(R, "vision"))
        reconstruction.frame(frame_id).rig_from_world = pycolmap.Rigid3d(
            pycolmap.Rotation3d(rig_from_world), nowhere
        )
        reconstruction.register_frame(frame_id)


def _place(pycolmap: Any, reconstruction: Any, frames: Frames, sensors: dict[int, Matrix]) -> None:
    nowhere = np.full(3, np.nan)
    for sensor, R in sensors.items():
        sensor_from_rig = np.ascontiguousarray(convert_family(R, "vision"))
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(sensor_from_rig), nowhere)
        sensor_id = pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=sensor)
        reconstruction.rig(frames.rig_of[sensor]).set_sensor_from_rig(sensor_id, pose)


def _filter(
    pose_graph: Any,
    reconstruction: Any,
    graph: MeasurementGraph,
    frames: Frames,
    found: dict[int, Matrix],
    sensors: dict[int, Matrix],
    limit_deg: float,
) -> bool:
    """Invalidate edges further off than the limit, and deregister frames that these held alone."""
    of_sensor = {**frames.rotation_of, **sensors}
    nodes = graph.nodes.tolist()
    known = np.array([frames.sensor_of[k] in of_sensor for k in nodes])
    world_from_image = np.array(
        [found[frames.frame_of[k]] @ of_sensor.get(frames.sensor_of[k], np.eye(3)) for k in nodes]
    )
    angles = np.asarray(_core.residual_angles(graph._core, world_from_image))
    wrong = (np.degrees(angles) > limit_deg) & known[graph.indices].all(axis=1)
    for i, j in graph.edges[wrong].tolist():
        pose_graph.set_invalid_edge(pair_id_of(i, j))
    kept = largest_component(frames.rows(graph.nodes), graph.indices[~wrong])
    if not kept:
        return False
    if len(kept) < len(found):
        pose_graph.invalidate_pairs_outside_active_image_ids(
            {k for k, frame in frames.frame_of.items() if frame in kept}
        )
    for frame_id in list(reconstruction.reg_frame_ids()):
        if frame_id not in kept:
            reconstruction.deregister_frame(frame_id)
    return True
