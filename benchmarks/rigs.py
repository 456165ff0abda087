"""Rigs whose sensors are not known: beside pycolmap, and beside separate cameras.

    python -m benchmarks.rigs [--seeds 20] [--frames 5 25] [--only pycolmap | simulated]

Datasets are those of `pycolmap.synthesize_dataset`, the places of sensors in their rigs taken away,
with noise and wrong rotations in the pose graph, which its own noise does not reach. Errors are
mean angles between relative rotations and the truth; seconds are CPU seconds, one thread, medians.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices

# Standard deviation per axis, degrees, and share of wrong rotations.
_KINDS = ((0.0, 0.0), (0.5, 0.0), (0.5, 0.1), (0.5, 0.3), (2.0, 0.3))
_RIGS, _CAMERAS = 2, 3


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--frames", type=int, nargs="+", default=[5, 25], help="of each rig")
    parser.add_argument("--only", choices=["pycolmap", "simulated"])
    arguments = parser.parse_args()
    if arguments.only != "simulated":
        _beside_pycolmap(arguments.seeds, arguments.frames)
    if arguments.only != "pycolmap":
        _beside_separate_cameras(arguments.seeds)


def _beside_pycolmap(seeds: int, frames: list[int]) -> None:
    print(
        "| images / pairs | noise, wrong | error: pycolmap, rotavg (deg) | worse / better seeds |"
    )
    print("| CPU ms: pycolmap, rotavg, of which the solver |")
    for count in frames:
        for noise, wrong in _KINDS:
            rows = [_one(count, noise, wrong, seed) for seed in range(seeds)]
            errors = np.array([row[0] for row in rows])
            seconds = np.median([row[1] for row in rows], axis=0) * 1e3
            images = _RIGS * _CAMERAS * count
            print(
                f"| {images} / {rows[0][2]} | {noise:g} deg, {wrong:.0%} | "
                f"{errors[:, 0].mean():.4g}, {errors[:, 1].mean():.4g} | "
                f"{int((errors[:, 1] > errors[:, 0] + 1e-4).sum())} / "
                f"{int((errors[:, 1] < errors[:, 0] - 1e-4).sum())} | "
                f"{seconds[0]:.3g}, {seconds[1]:.3g}, {seconds[2]:.3g} |",
                flush=True,
            )


def _one(
    frames: int, noise: float, wrong: float, seed: int
) -> tuple[list[float], list[float], int]:
    """Errors of pycolmap and rotavg, their seconds and those of our solver alone, pairs."""
    import pycolmap

    from rotavg.colmap import from_pose_graph, run_rotation_averaging

    pycolmap.logging.minloglevel = 3
    pycolmap.set_random_seed(seed)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=_RIGS, num_cameras_per_rig=_CAMERAS, num_frames_per_rig=frames, num_points3D=60,
        sensor_from_rig_rotation_stddev=20.0, two_view_geometry_has_relative_pose=True,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        database = pycolmap.Database.open(str(Path(folder) / "database.db"))
        truth = pycolmap.synthesize_dataset(options, database)
        cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
        database.close()
    errors, seconds, pairs = [], [], 0
    for average in (pycolmap.run_rotation_averaging, run_rotation_averaging):
        graph = _pose_graph(pycolmap, cache, np.radians(noise), wrong, seed)
        pairs = graph.num_edges
        target = pycolmap.Reconstruction(truth)
        for frame in list(target.reg_frame_ids()):
            target.deregister_frame(frame)
        for rig in target.rigs:
            for sensor in list(target.rig(rig).non_ref_sensors):
                target.rig(rig).reset_sensor_from_rig(sensor)
        more = {} if average is pycolmap.run_rotation_averaging else {"num_threads": 1}
        start = time.process_time()
        done = average(pycolmap.RotationEstimatorOptions(random_seed=0), graph, target, [], **more)
        seconds.append(time.process_time() - start)
        assert done
        errors.append(_error(truth, target))
    graph = from_pose_graph(
        _pose_graph(pycolmap, cache, np.radians(noise), wrong, seed), unit_weights=True
    )
    pictures = {k: (i.frame_id, int(i.camera_id)) for k, i in truth.images.items()}
    known = {rig.ref_sensor_id.id: np.eye(3) for rig in truth.rigs.values()}
    priors = rotavg.Priors(rigs=rotavg.Rigs(pictures, known))
    start = time.process_time()
    rotavg.solve(
        graph, priors=priors, loss="geman_mcclure", loss_scale=np.radians(5), certify=False,
        num_threads=1,
    )  # fmt: skip
    seconds.append(time.process_time() - start)
    return errors, seconds, pairs


def _pose_graph(pycolmap: Any, cache: Any, noise: float, wrong: float, seed: int) -> Any:
    graph = pycolmap.PoseGraph()
    graph.load(cache.correspondence_graph)
    rng = np.random.default_rng(seed)
    for pair, edge in sorted(graph.edges.items()):
        v = rng.normal(size=3) * (3.0 if rng.random() < wrong else noise)
        turn = pycolmap.Rotation3d(quaternions_from_matrices(matrices_from_rotvecs(v)))
        pose = edge.cam2_from_cam1
        moved = pycolmap.PoseGraphEdge(
            cam2_from_cam1=pycolmap.Rigid3d(turn * pose.rotation, pose.translation),
            num_matches=edge.num_matches,
        )
        graph.update_edge(*pycolmap.pair_id_to_image_pair(pair), moved)
    return graph


def _error(truth: Any, found: Any) -> float:
    """Mean angle, degrees, between relative rotations of all pairs of registered images."""
    ids = [k for k, image in found.images.items() if image.has_pose]
    ours, right = (
        np.array([r.image(k).cam_from_world().rotation.matrix() for k in ids])
        for r in (found, truth)
    )
    # R_b R_a^T and T_b T_a^T are as far apart as D_a and D_b, with D_k = R_k^T T_k.
    D = np.swapaxes(ours, 1, 2) @ right
    i, j = np.triu_indices(len(ids), 1)
    chords = np.linalg.norm(D[i] - D[j], axis=(1, 2)) / 8**0.5
    return float(np.degrees(2 * np.arcsin(np.minimum(1, chords))).mean())


def _beside_separate_cameras(seeds: int) -> None:
    """4 cameras in 100 frames of a trajectory; each image sees those of the next frames."""
    print("\n| noise, wrong | error (deg, RMS): separate cameras, unknown rig, known rig | ratio |")
    for noise, wrong in ((0.5, 0.0), (2.0, 0.0), (2.0, 0.2)):
        errors = np.array([_simulated(np.radians(noise), wrong, seed) for seed in range(seeds)])
        mean = errors.mean(axis=0)
        print(
            f"| {noise:g} deg, {wrong:.0%} | {mean[0]:.3g}, {mean[1]:.3g}, {mean[2]:.3g} | "
            f"{mean[0] / mean[1]:.2f} (least {np.min(errors[:, 0] / errors[:, 1]):.2f}) |"
        )


def _simulated(noise: float, wrong: float, seed: int) -> list[float]:
    rng = np.random.default_rng(seed)
    frames, cameras, reach, seen = 100, 4, 5, 0.5
    C = np.concatenate([np.eye(3)[None], matrices_from_rotvecs(rng.normal(size=(cameras - 1, 3)))])
    steps = matrices_from_rotvecs(0.1 * rng.normal(size=(frames, 3)))
    Q = [np.eye(3)]
    for step in steps[1:]:
        Q.append(Q[-1] @ step)
    truth = {f * cameras + s: Q[f] @ C[s] for f in range(frames) for s in range(cameras)}
    edges, R = [], []
    for f in range(frames):
        for g in range(f + 1, min(frames, f + reach + 1)):
            for s in range(cameras):
                for t in range(cameras):
                    # A camera sees what it saw before, and now and then what another one saw.
                    if rng.random() < (seen if s == t else 0.2 * seen):
                        v = rng.normal(size=3) * (3.0 if rng.random() < wrong else noise)
                        i, j = f * cameras + s, g * cameras + t
                        edges.append((i, j))
                        R.append(truth[i].T @ truth[j] @ matrices_from_rotvecs(v))
    graph = rotavg.MeasurementGraph(edges, np.array(R)).largest_component()
    pictures = {k: divmod(k, cameras) for k in graph.nodes.tolist()}
    loss = "auto" if wrong else "l2"
    found = []
    for rigs in (
        None,
        rotavg.Rigs(pictures, {0: C[0]}),
        {k: (f, C[s]) for k, (f, s) in pictures.items()},
    ):
        priors = None if rigs is None else rotavg.Priors(rigs=rigs)
        solution = rotavg.solve(graph, loss=loss, priors=priors, certify=False)
        found.append(float(np.degrees(rotavg.compare(solution, truth).rms)))
    return found


if __name__ == "__main__":
    main()
