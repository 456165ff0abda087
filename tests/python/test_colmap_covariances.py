"""Covariances of COLMAP's pairs: derivatives, Monte Carlo, and what they are worth on datasets."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
import rotavg.colmap
from benchmarks import colmap_pairs
from benchmarks.colmap_pairs import true_rotations
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.two_views import epipolar_equations, turn_equations
from rotavg.io import colmap_covariances

optimize = pytest.importorskip("scipy.optimize", reason="scipy is not installed")

PIXEL = 1e-3  # focal length 1

Array = NDArray[np.float64]


def scene(seed: int, k: int, n: int, turned: bool = False) -> tuple[Array, Array, Array, Array]:
    """K pairs of views of n points each: R, t (zero where turned), rays without noise."""
    rng = np.random.default_rng(seed)
    R = matrices_from_rotvecs(rng.uniform(-0.4, 0.4, (k, 3)))
    t = np.zeros((k, 3)) if turned else rng.normal(size=(k, 3)) * [1, 1, 0.3]
    if not turned:
        t /= np.linalg.norm(t, axis=1, keepdims=True)
    rays_i = np.concatenate([rng.uniform(-0.5, 0.5, (k, n, 2)), np.ones((k, n, 1))], axis=2)
    moved = np.einsum("kab,knb->kna", R, rays_i * rng.uniform(3, 8, (k, n, 1))) + t[:, None]
    return R, t, rays_i.reshape(-1, 3), (moved / moved[..., 2:]).reshape(-1, 3)


def distances(R: Array, t: Array, rays_i: Array, rays_j: Array, pixels: Array) -> Array:
    """Sampson's, in pixels, from their definition."""
    t = t / np.linalg.norm(t)
    E = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]) @ R
    lines_j, lines_i = rays_i @ E.T, rays_j @ E
    slope = pixels[1] ** 2 * np.sum(lines_j[:, :2] ** 2, axis=1)
    slope += pixels[0] ** 2 * np.sum(lines_i[:, :2] ** 2, axis=1)
    return np.asarray(np.sum(rays_j * lines_j, axis=1) / np.sqrt(slope))


def transfers(R: Array, rays_i: Array, rays_j: Array, pixels: Array) -> Array:
    y = rays_i @ R.T
    return ((y / y[:, 2:] - rays_j)[:, :2] / np.hypot(*pixels)).ravel()


@pytest.mark.parametrize("turned", [False, True])
def test_the_equations_are_those_of_numerical_derivatives(turned: bool) -> None:
    R, t, rays_i, rays_j = scene(1, 3, 20, turned)
    rng = np.random.default_rng(2)
    rays_j[:, :2] += 0.01 * rng.normal(size=(60, 2))
    keep = np.r_[0:20, 40:47]  # the second pair has no point
    counts, pixels = np.array([20, 0, 7]), np.array([[1e-3, 2e-3], [1, 1], [3e-3, 1e-3]])
    rays_i, rays_j = rays_i[keep], rays_j[keep]
    if turned:
        found = turn_equations(R, rays_i, rays_j, counts, pixels)
    else:
        found = epipolar_equations(R, t, rays_i, rays_j, counts, pixels)
    assert found.freedom.tolist() == ([37, -3, 11] if turned else [15, -5, 2])
    assert found.squares[1] == 0
    covariances = found.rotation_covariances(np.array([2.0, 2.0, 2.0]))
    assert np.isnan(covariances[1]).all()
    for k, part in ((0, slice(0, 20)), (2, slice(20, 27))):
        points = rays_i[part], rays_j[part], pixels[k]

        def residuals(step: Array, k: int = k, points: Any = points) -> Array:
            moved = R[k] @ matrices_from_rotvecs(step[:3])
            if turned:
                return transfers(moved, *points)
            across = np.linalg.svd(t[k][None])[2][1:]
            return distances(moved, t[k] + step[3:] @ across, *points)

        h = 1e-6
        steps = h * np.eye(3 if turned else 5)
        J = np.stack([(residuals(s) - residuals(-s)) / (2 * h) for s in steps], axis=1)
        expected = 2.0 * np.linalg.inv(J.T @ J)[:3, :3]
        np.testing.assert_allclose(covariances[k], expected, atol=1e-6 * np.trace(expected))
        assert found.squares[k] == pytest.approx(
            float(residuals(steps[0] * 0) @ residuals(steps[0] * 0))
        )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_predicted_covariances_are_those_of_monte_carlo(seed: int) -> None:
    runs, n = 1500, 60
    R, t, rays_i, rays_j = scene(seed, 1, n)
    rng = np.random.default_rng(100 + seed)
    pixels = np.array([PIXEL, 2 * PIXEL])  # two cameras
    across = np.linalg.svd(t)[2][1:]
    errors, predicted = np.empty((runs, 3)), np.zeros((3, 3))
    for run in range(runs):
        x_i, x_j = rays_i.copy(), rays_j.copy()
        x_i[:, :2] += 0.5 * pixels[0] * rng.normal(size=(n, 2))
        x_j[:, :2] += 0.5 * pixels[1] * rng.normal(size=(n, 2))
        step = np.zeros(5)
        for _ in range(3):  # Gauss and Newton, by numerical derivatives

            def residuals(s: Array, x_i: Array = x_i, x_j: Array = x_j) -> Array:
                moved = R[0] @ matrices_from_rotvecs(s[:3])
                return distances(moved, t[0] + s[3:] @ across, x_i, x_j, pixels)

            h = 1e-6
            J = np.stack(
                [(residuals(step + s) - residuals(step - s)) / (2 * h) for s in h * np.eye(5)], 1
            )
            step = step - np.linalg.lstsq(J, residuals(step), rcond=None)[0]
        errors[run] = step[:3]
        moved = R @ matrices_from_rotvecs(step[:3])
        direction = t + step[3:] @ across
        direction /= np.linalg.norm(direction)
        found = epipolar_equations(moved, direction, x_i, x_j, np.array([n]), pixels[None])
        variance = found.squares / found.freedom
        assert found.squares[0] == pytest.approx(float(residuals(step) @ residuals(step)))
        predicted += found.rotation_covariances(variance)[0] / runs
    scatter = errors.T @ errors / runs
    assert np.linalg.cond(scatter) > 2
    ratios = np.linalg.eigvals(np.linalg.solve(predicted, scatter)).real
    np.testing.assert_allclose(ratios, 1, atol=0.15)


# With COLMAP's own databases.


def dataset(path: Path, seed: int, **options: Any) -> Any:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    return colmap_pairs.dataset(path, seed, **options)


def mean_error(solution: rotavg.Solution, R: Array) -> float:
    return float(rotavg.compare(solution.rotations, R).angles.mean())


def test_covariances_beat_numbers_of_matches(tmp_path: Path) -> None:
    plain, full, squares = [], [], []
    for seed in range(5):
        path = tmp_path / f"{seed}.db"
        truth = dataset(path, seed)
        assert rotavg.read(path).covariances is None
        graph = rotavg.read(path, covariances=True)
        np.testing.assert_array_equal(graph.weights, rotavg.read(path).weights)
        R = true_rotations(truth, graph.nodes.tolist())
        plain.append(mean_error(rotavg.solve(graph), R))
        solution = rotavg.solve(graph, anisotropic=True)
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved"
        full.append(mean_error(solution, R))
        assert graph.covariances is not None
        exact = rotavg.MeasurementGraph(
            graph.edges, np.swapaxes(R[graph.indices[:, 0]], 1, 2) @ R[graph.indices[:, 1]],
            nodes=graph.nodes,
        )  # fmt: skip
        E = np.swapaxes(exact.rotations, 1, 2) @ graph.rotations
        e = np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], 1)
        e /= 2
        squares.append(np.einsum("ka,kab,kb->k", e, np.linalg.inv(graph.covariances), e))
    assert np.mean(full) < 0.6 * np.mean(plain)
    # In units of what is predicted an error has the mean square 3.
    assert 2.2 < np.concatenate(squares).mean() < 4.5


def test_the_drop_in_takes_them_from_a_database(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    errors: dict[bool, list[float]] = {False: [], True: []}
    for seed in range(4):
        path = tmp_path / f"{seed}.db"
        truth = dataset(path, seed)
        with pycolmap.Database.open(str(path)) as database:
            cache = pycolmap.DatabaseCache.create(database, pycolmap.DatabaseCacheOptions())
        for full in (False, True):
            pose_graph = pycolmap.PoseGraph()
            pose_graph.load(cache.correspondence_graph)
            scene = pycolmap.Reconstruction()
            scene.load(cache)
            options = pycolmap.RotationEstimatorOptions()
            source = {"database": path} if full else {}
            assert rotavg.colmap.run_rotation_averaging(options, pose_graph, scene, **source)
            images = list(truth.images.values())
            R = np.array([image.cam_from_world().rotation.matrix().T for image in images])
            found = np.array([
                scene.image(image.image_id).frame.rig_from_world.rotation.matrix().T
                for image in images
            ])  # fmt: skip
            errors[full].append(float(rotavg.compare(found, R).angles.mean()))
    assert np.mean(errors[True]) < 0.7 * np.mean(errors[False])


def test_the_command_takes_them(tmp_path: Path) -> None:
    path = tmp_path / "pairs.db"
    dataset(path, 3)

    def run(*arguments: str) -> dict[str, Any]:
        done = subprocess.run(
            [sys.executable, "-m", "rotavg", *arguments, "--json"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        found: dict[str, Any] = json.loads(done.stdout)
        return found

    assert run("solve", str(path), "--anisotropic")["anisotropic"] == "chordal"
    assert "covariances" not in run("info", str(path))
    spread = run("info", str(path), "--pair-covariances")["covariances"]
    assert 0 < spread["rms_median_deg"] < 1
    assert spread["axes_ratio_median"] > 1
    run("convert", str(path), str(tmp_path / "graph.csv"), "--pair-covariances")
    written = rotavg.read(tmp_path / "graph.csv").covariances
    read = rotavg.read(path, covariances=True).covariances
    assert written is not None
    np.testing.assert_allclose(written, read, rtol=1e-9, atol=1e-18)


def test_small_chunks_give_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "pairs.db"
    dataset(path, 4)
    whole = rotavg.read(path, covariances=True).covariances
    monkeypatch.setattr(colmap_covariances, "_AT_ONCE", 1)
    monkeypatch.setattr(colmap_covariances, "_KEPT", 1)
    apart = rotavg.read(path, covariances=True).covariances
    np.testing.assert_allclose(apart, whole, rtol=1e-9, atol=1e-18)


def test_pairs_without_points_get_what_is_usual(tmp_path: Path) -> None:
    path = tmp_path / "pairs.db"
    dataset(path, 5)
    whole = rotavg.read(path, covariances=True)
    with closing(sqlite3.connect(path)) as connection:
        (first, *_), *_ = connection.execute("SELECT pair_id FROM two_view_geometries").fetchall()
        connection.execute("UPDATE two_view_geometries SET data = NULL WHERE pair_id = ?", (first,))
        connection.commit()
    graph = rotavg.read(path, covariances=True)
    assert any("1 pairs" in note and "usual" in note for note in graph.notes)
    assert graph.covariances is not None
    assert whole.covariances is not None
    np.testing.assert_allclose(graph.covariances[1:], whole.covariances[1:], rtol=0.3)
    C = graph.covariances[0]
    np.testing.assert_allclose(C, C[0, 0] * np.eye(3), atol=1e-12 * C[0, 0])
    assert 0 < C[0, 0] <= 1
    assert rotavg.solve(graph, anisotropic=True).certificate is not None
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("DROP TABLE keypoints")
        connection.commit()
    with pytest.raises(rotavg.FormatError, match="keypoints"):
        rotavg.read(path, covariances=True)
    assert rotavg.read(path).num_edges == graph.num_edges
