"""COLMAP and GLOMAP, on the scenes that pycolmap makes, by the drop-in and by priors."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from tests.peers.suite import case, holds, relative_degrees

PYCOLMAP = ("pycolmap",)


def _scene(noise: bool = False, seed: int = 1, **options: Any) -> tuple[Any, Any, Any, Any]:
    """The truth, a reconstruction without poses, its pose graph, and priors of poses."""
    import pycolmap

    pycolmap.logging.minloglevel = 3
    pycolmap.set_random_seed(seed)
    settings = pycolmap.SyntheticDatasetOptions(
        two_view_geometry_has_relative_pose=True, prior_gravity=True, **options
    )
    with tempfile.TemporaryDirectory() as folder:
        database = pycolmap.Database.open(str(Path(folder) / "scene.db"))
        truth = pycolmap.synthesize_dataset(settings, database)
        if noise:
            off = pycolmap.SyntheticNoiseOptions(point2D_stddev=1, prior_gravity_stddev=0.3)
            pycolmap.synthesize_noise(off, truth, database)
        cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
        priors = database.read_all_pose_priors()
        database.close()
    reconstruction = pycolmap.Reconstruction()
    reconstruction.load(cache)
    graph = pycolmap.PoseGraph()
    graph.load(cache.correspondence_graph)
    return truth, reconstruction, graph, priors


def _error(truth: Any, found: Any) -> float:
    """The largest error of the rotation between two images, degrees."""
    ids = sorted(found.reg_image_ids())
    assert len(ids) == truth.num_reg_images()
    rotations = [
        np.array([r.images[k].cam_from_world().rotation.matrix().T for k in ids])
        for r in (found, truth)
    ]
    return relative_degrees(*rotations)


def _averaged(scene: tuple[Any, Any, Any, Any], **settings: Any) -> float:
    import pycolmap

    import rotavg.colmap

    truth, reconstruction, graph, _ = scene
    options = pycolmap.RotationEstimatorOptions()
    assert rotavg.colmap.run_rotation_averaging(options, graph, reconstruction, **settings)
    return _error(truth, reconstruction)


_ONE = {"num_rigs": 1, "num_frames_per_rig": 5, "num_cameras_per_rig": 1, "num_points3D": 50}
_RIG = {"num_rigs": 1, "num_frames_per_rig": 4, "num_cameras_per_rig": 2, "num_points3D": 50}
_TWO = {"num_rigs": 2, "num_frames_per_rig": 7, "num_points3D": 100, "inlier_match_ratio": 0.6}
_TURNED = {"sensor_from_rig_rotation_stddev": 20.0}


@case(
    "COLMAP",
    "rotation_averaging_test (estimators, controllers): WithoutNoise",
    1e-2,
    "deg",
    PYCOLMAP,
)
def without_noise() -> float:
    return max(_averaged(_scene(**_ONE, **_TURNED, seed=seed)) for seed in range(1, 6))


@case(
    "COLMAP", "rotation_averaging_test: WithoutNoiseWithNonTrivialKnownRig", 1e-2, "deg", PYCOLMAP
)
def known_rig() -> float:
    return max(_averaged(_scene(**_RIG, **_TURNED, seed=seed)) for seed in range(1, 6))


@case("COLMAP", "rotation_averaging_test (both): WithNoiseAndOutliers", 3.0, "deg", PYCOLMAP)
def noise_and_outliers() -> float:
    scenes = (_scene(True, seed, num_cameras_per_rig=1, **_TWO) for seed in range(1, 6))
    return max(map(_averaged, scenes))


@case(
    "COLMAP",
    "rotation_averaging_test: WithNoiseAndOutliersWithNonTrivialKnownRigs",
    2.0,
    "deg",
    PYCOLMAP,
)
def known_rigs_with_noise() -> float:
    scenes = (_scene(True, seed, num_cameras_per_rig=2, **_TWO) for seed in range(1, 6))
    return max(map(_averaged, scenes))


@case(
    "COLMAP",
    "rotation_averaging_test: DeterministicRandomSeed, WithRandomSeedStability",
    0,
    "",
    PYCOLMAP,
)
def deterministic() -> float:
    found = []
    for threads in (1, 1, 3):
        scene = _scene(True, 1, num_cameras_per_rig=1, **_TWO)
        _averaged(scene, num_threads=threads)
        images = scene[1].images
        ids = sorted(scene[1].reg_image_ids())
        found.append(np.array([images[k].cam_from_world().rotation.quat for k in ids]))
    return holds((found[0] == found[1]).all() and (found[0] == found[2]).all())


@case("COLMAP", "rotation_averaging_test: EmptyPoseGraph (returns false)", 0, "", PYCOLMAP)
def empty_pose_graph() -> float:
    import pycolmap

    import rotavg.colmap

    _, reconstruction, graph, _ = _scene(**_ONE)
    for edge in graph.edges.values():
        edge.valid = False
    options = pycolmap.RotationEstimatorOptions()
    return holds(not rotavg.colmap.run_rotation_averaging(options, graph, reconstruction))


@case("COLMAP", "rotation_averaging_test: WeightedNoiseFreeMatchesInvariant", 1e-2, "deg", PYCOLMAP)
def weights_without_noise() -> float:
    import rotavg.colmap

    truth, _, graph, _ = _scene(**_ONE, **_TURNED)
    given = rotavg.colmap.from_pose_graph(graph)
    R = np.array(
        [truth.images[k].cam_from_world().rotation.matrix().T for k in given.nodes.tolist()]
    )
    weights = 10.0 * (np.arange(1, given.num_edges + 1) % 7) + 1
    answers = [rotavg.solve(given.with_weights(w)).rotations for w in (weights, weights * 0 + 1)]
    return max(relative_degrees(found, R) for found in answers)


@case(
    "COLMAP",
    "rotation_averaging_test: WeightedReducesErrorWithNoisyLowMatchEdges (1: as is)",
    1,
    "",
    PYCOLMAP,
)
def weights_help() -> float:
    """The error with halved weights of noisy edges over that without, over 20 draws."""
    from tests.peers.suite import noisy, turns

    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        R = turns(rng, 15, 1.0)
        pairs = [(i, j) for j in range(15) for i in range(j)]
        off = rng.uniform(0, 8, len(pairs))
        measured = noisy(rng, np.array([R[i].T @ R[j] for i, j in pairs]), off)
        weights = np.where(off > 5, 0.5, 1.0)
        errors.append(
            [
                relative_degrees(
                    rotavg.solve(rotavg.MeasurementGraph(pairs, measured, w)).rotations, R
                )
                for w in (weights, np.ones(len(pairs)))
            ]
        )
    weighted, plain = np.mean(errors, axis=0)
    return float(weighted / plain)


def _with_gravity(noise: bool, loss: str, **options: Any) -> float:
    """Plain graphs with the gravity of the database as priors, which hold the world."""
    import rotavg.colmap

    worst = 0.0
    for seed in range(1, 6):
        truth, _, graph, given = _scene(noise, seed, **options)
        averaged = rotavg.colmap.from_pose_graph(graph)
        known = {p.corr_data_id.id: (p.gravity, 1.0) for p in given if p.has_gravity()}
        known = {k: v for k, v in known.items() if k in set(averaged.nodes.tolist())}
        weight = float(np.median(averaged.weights))
        priors = rotavg.Priors(gravity={k: (down, weight) for k, (down, _) in known.items()})
        found = rotavg.solve(averaged, priors=priors, loss=loss)
        R = [truth.images[k].cam_from_world().rotation.matrix().T for k in averaged.nodes.tolist()]
        worst = max(worst, relative_degrees(found.rotations, np.array(R)))
    return worst


@case("COLMAP", "rotation_averaging_test: WithoutNoise (gravity)", 1e-2, "deg", PYCOLMAP)
def gravity_without_noise() -> float:
    return _with_gravity(False, "l2", **_ONE, **_TURNED)


@case("COLMAP", "rotation_averaging_test: WithNoiseAndOutliers (gravity)", 3.0, "deg", PYCOLMAP)
def gravity_with_noise() -> float:
    return _with_gravity(True, "auto", num_cameras_per_rig=1, **_TWO)


@case(
    "COLMAP",
    "gravity_refinement_test: RefineGravity, RefineGravityWithNonTrivialRigs",
    1e-2,
    "deg",
    PYCOLMAP,
)
def refined_gravity() -> float:
    import rotavg.colmap

    worst = 0.0
    for cameras in (1, 2):
        truth, _, graph, given = _scene(
            num_rigs=2, num_frames_per_rig=25, num_cameras_per_rig=cameras, num_points3D=100
        )
        averaged = rotavg.colmap.from_pose_graph(graph)
        rng = np.random.default_rng(cameras)
        known = {p.corr_data_id.id: np.array(p.gravity) for p in given if p.has_gravity()}
        known = {k: v for k, v in known.items() if k in set(averaged.nodes.tolist())}
        down = {
            k: truth.images[k].cam_from_world().rotation.matrix().T @ v for k, v in known.items()
        }
        world = np.mean(list(down.values()), axis=0)
        for k in known:
            if rng.random() < 0.3:
                known[k] = rng.normal(size=3)
        refined = rotavg.refined_gravity(averaged, known)
        for k, v in refined.items():
            seen = truth.images[k].cam_from_world().rotation.matrix() @ world
            cross = np.linalg.norm(np.cross(seen, v))
            worst = max(worst, float(np.degrees(np.arctan2(cross, seen @ v))))
    return worst
