"""Relative poses from matching rays, on scenes of which everything is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("cv2", reason="needs rotavg[images]")
pytest.importorskip("scipy", reason="needs rotavg[images]")

from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.images import NoGeometryError, epipolar
from rotavg.images.two_view import estimate
from rotavg.reproduce.photographs import angles_deg

PIXEL = 1e-3  # in units of the focal length


class Views(NamedTuple):
    R: NDArray[np.float64]
    t: NDArray[np.float64]
    rays_i: NDArray[np.float64]
    rays_j: NDArray[np.float64]


def two_views(
    seed: int, *, depth: str = "general", noise: float = 0.0, outliers: float = 0.0, n: int = 200
) -> Views:
    """x_j ~ R x_i + t for points in front of both; `depth` is general, plane or infinite."""
    rng = np.random.default_rng(seed)
    R = matrices_from_rotvecs(rng.uniform(-0.4, 0.4, 3))
    t = rng.standard_normal(3) * [1, 1, 0.3]
    t /= np.linalg.norm(t)
    rays_i = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.ones(n)])
    if depth == "general":
        points = rays_i * rng.uniform(3, 8, (n, 1))
    elif depth == "plane":
        points = rays_i * (3 / (rays_i @ [0.3, -0.2, 1]))[:, None]
    else:
        points, t = rays_i, 0 * t
    moved = points @ R.T + t
    rays_j = moved / moved[:, 2:]
    assert (moved[:, 2] > 0).all()
    for rays in (rays_i, rays_j):
        rays[:, :2] += noise * rng.standard_normal((n, 2))
    wrong = rng.random(n) < outliers
    rays_j[wrong, :2] = rng.uniform(-0.5, 0.5, (wrong.sum(), 2))
    return Views(R, t, rays_i, rays_j)


@pytest.mark.parametrize("seed", range(5))
def test_without_noise_the_pose_is_exact(seed: int) -> None:
    views = two_views(seed)
    found = estimate(views.rays_i, views.rays_j, max_error=PIXEL)
    assert found.kind == "general"
    assert found.inliers.all()
    np.testing.assert_allclose(found.j_from_i, views.R, atol=1e-7)
    np.testing.assert_allclose(found.translation, views.t, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_outliers(seed: int) -> None:
    views = two_views(seed, noise=0.3 * PIXEL, outliers=0.4)
    found = estimate(views.rays_i, views.rays_j, max_error=PIXEL)
    assert angles_deg(found.j_from_i, views.R) < 0.3
    true = epipolar.sampson_distances(epipolar.essential_matrix(views.R, views.t), *views[2:])
    assert np.mean(found.inliers == (np.abs(true) < PIXEL)) > 0.95


def test_the_same_seed_gives_the_same_bits() -> None:
    views = two_views(7, noise=PIXEL, outliers=0.5)
    a, b = (estimate(views.rays_i, views.rays_j, max_error=PIXEL, seed=3) for _ in range(2))
    assert a.j_from_i.tobytes() == b.j_from_i.tobytes()
    assert (a.inliers == b.inliers).all()


@pytest.mark.parametrize("seed", range(10))
def test_a_camera_that_only_turned(seed: int) -> None:
    views = two_views(seed, depth="infinite", noise=0.3 * PIXEL, outliers=0.3)
    found = estimate(views.rays_i, views.rays_j, max_error=PIXEL)
    assert found.kind == "rotation"
    assert angles_deg(found.j_from_i, views.R) < 0.05


def test_a_plane_gives_the_right_rotation_or_none() -> None:
    # A plane has a second interpretation (Longuet-Higgins 1986), which is often possible as well.
    kinds = []
    for seed in range(30):
        views = two_views(seed, depth="plane", noise=0.2 * PIXEL)
        try:
            found = estimate(views.rays_i, views.rays_j, max_error=PIXEL)
        except NoGeometryError as error:
            kinds.append("ambiguous" if "plane and two rotations" in str(error) else str(error))
        else:
            kinds.append(found.kind)
            assert angles_deg(found.j_from_i, views.R) < 5
    assert {"planar", "ambiguous"} == set(kinds)


@pytest.mark.parametrize("n", [0, 1, 4, 5, 14])
def test_too_few_matches(n: int) -> None:
    views = two_views(1, n=n)
    with pytest.raises(NoGeometryError, match=rf"too few matches \({n}\)"):
        estimate(views.rays_i, views.rays_j, max_error=PIXEL)


def test_matches_at_random_are_no_evidence() -> None:
    for seed in range(5):
        views = two_views(seed, outliers=1.0, n=60)
        with pytest.raises(NoGeometryError, match="too few inliers"):
            estimate(views.rays_i, views.rays_j, max_error=0.2 * PIXEL)


def test_matches_that_are_all_one_point_are_no_evidence() -> None:
    rays = np.tile([0.1, 0.2, 1.0], (50, 1))
    try:
        found = estimate(rays, rays, max_error=PIXEL)
    except NoGeometryError:
        return
    assert found.kind == "rotation"  # all that can be said; it must be a rotation
    np.testing.assert_allclose(found.j_from_i @ found.j_from_i.T, np.eye(3), atol=1e-12)


def test_essential_matrix_and_sampson_distance_against_their_definitions() -> None:
    views = two_views(2, noise=0.01)
    E = epipolar.essential_matrix(views.R, views.t)
    x, y, z = views.t
    np.testing.assert_allclose(E, np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ views.R)
    distances = epipolar.sampson_distances(E, views.rays_i, views.rays_j)

    def constraint(v: NDArray[np.float64]) -> float:
        return float(np.append(v[2:], 1) @ E @ np.append(v[:2], 1))

    for ray_i, ray_j, distance in zip(views.rays_i[:10], views.rays_j[:10], distances):
        v, h = np.concatenate([ray_i[:2], ray_j[:2]]), 1e-6
        slope = [(constraint(v + h * e) - constraint(v - h * e)) / (2 * h) for e in np.eye(4)]
        assert distance == pytest.approx(constraint(v) / np.linalg.norm(slope), rel=1e-6)


def test_in_front_tells_the_signs_of_the_depths() -> None:
    rng = np.random.default_rng(5)
    R, t = two_views(3)[:2]
    depth_i = rng.uniform(1, 5, 500) * rng.choice([-1, 1], 500)
    rays_i = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.ones(500)])
    moved = (rays_i * depth_i[:, None]) @ R.T + t
    expected = (depth_i > 0) & (moved[:, 2] > 0)
    assert 0.2 < expected.mean() < 0.8
    np.testing.assert_array_equal(epipolar.in_front(R, t, rays_i, moved / moved[:, 2:]), expected)


def test_refining_comes_back_to_the_truth() -> None:
    views = two_views(4)
    R = matrices_from_rotvecs(np.array([0.02, -0.01, 0.03])) @ views.R
    t = views.t + np.array([0.05, -0.1, 0.08])
    R, t = epipolar.refine(R, t / np.linalg.norm(t), views.rays_i, views.rays_j, PIXEL)
    np.testing.assert_allclose(R, views.R, atol=1e-7)
    np.testing.assert_allclose(t, views.t, atol=1e-6)


@pytest.mark.parametrize("depth", ["general", "infinite"])
def test_the_covariance_of_the_rotation_is_that_of_its_scatter(depth: str) -> None:
    runs = 300
    views = two_views(3, depth=depth, n=60)
    rng = np.random.default_rng(1)
    errors, predicted = np.empty((runs, 3)), np.zeros((3, 3))
    for k in range(runs):
        rays_i, rays_j = views.rays_i.copy(), views.rays_j.copy()
        for rays in (rays_i, rays_j):
            rays[:, :2] += 0.3 * PIXEL * rng.standard_normal((60, 2))
        if depth == "general":
            start = matrices_from_rotvecs(1e-3 * rng.standard_normal(3)) @ views.R
            R, t = epipolar.refine(start, views.t, rays_i, rays_j, 10 * PIXEL)
            spread = epipolar.rotation_covariance(R, t, rays_i, rays_j)
        else:  # Horn's, of directions: as good as least squares where all are near the axis
            U, _, Vt = np.linalg.svd(rays_j.T @ rays_i)
            R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
            spread = epipolar.rotation_covariance(R, None, rays_i, rays_j)
        assert spread is not None
        predicted += spread / runs
        d = views.R.T @ R
        errors[k] = [d[2, 1], d[0, 2], d[1, 0]]
    scatter = errors.T @ errors / runs
    ratios = np.linalg.eigvals(np.linalg.solve(predicted, scatter)).real
    np.testing.assert_allclose(ratios, 1, atol=0.35)
    assert np.linalg.cond(scatter) > 2


def test_without_enough_points_there_is_no_covariance() -> None:
    views = two_views(0, n=5)
    assert epipolar.rotation_covariance(*views) is None
    assert epipolar.rotation_covariance(views.R, None, views.rays_i[:1], views.rays_j[:1]) is None


def test_a_pair_tells_it_of_its_inliers_alone() -> None:
    views = two_views(2, noise=0.3 * PIXEL, outliers=0.2)
    found = estimate(views.rays_i, views.rays_j, max_error=3 * PIXEL)
    assert 0 < found.inliers.sum() < len(views.rays_i)
    spread = found.covariance(views.rays_i, views.rays_j)
    alone = epipolar.rotation_covariance(
        found.j_from_i, found.translation, views.rays_i[found.inliers], views.rays_j[found.inliers]
    )
    np.testing.assert_array_equal(spread, alone)
