"""The few conversions of our own, against SciPy and against the definitions."""

from __future__ import annotations

import numpy as np
import pytest

from rotavg.base.errors import Error, GraphError
from rotavg.graph import conventions


def random_quaternions(seed: int, count: int = 1000) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, 4))


def test_hamilton_quaternion_by_hand() -> None:
    # A quarter turn about z takes x to y.
    quarter = conventions.matrices_from_quaternions([0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(quarter @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(conventions.matrices_from_rotvecs([0, 0, np.pi / 2]), quarter)


def test_orders_are_inverse_of_each_other() -> None:
    assert conventions.wxyz_from_xyzw([1, 2, 3, 4]).tolist() == [4, 1, 2, 3]
    assert conventions.xyzw_from_wxyz([4, 1, 2, 3]).tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize("seed", [1, 2])
def test_agrees_with_scipy(seed: int) -> None:
    transform = pytest.importorskip("scipy.spatial.transform")
    q = random_quaternions(seed)
    matrices = conventions.matrices_from_quaternions(q)
    np.testing.assert_allclose(matrices, transform.Rotation.from_quat(q).as_matrix(), atol=1e-14)
    v = np.random.default_rng(seed).standard_normal((1000, 3)) * 4
    expected = transform.Rotation.from_rotvec(v).as_matrix()
    np.testing.assert_allclose(conventions.matrices_from_rotvecs(v), expected, atol=1e-14)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 3.0, np.pi - 1e-4, np.pi - 1e-9, np.pi])
def test_round_trip_at_every_angle(seed: int, angle: float) -> None:
    axes = np.concatenate([np.eye(3), -np.eye(3), random_quaternions(seed, 200)[:, :3]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    matrices = conventions.matrices_from_rotvecs(angle * axes)
    q = conventions.quaternions_from_matrices(matrices)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-15)
    assert (q[:, 3] >= 0).all()
    np.testing.assert_allclose(conventions.matrices_from_quaternions(q), matrices, atol=1e-14)
    direction = np.sum(q[:, :3] * axes, axis=1)
    if angle < 3.1:
        np.testing.assert_allclose(direction, np.sin(angle / 2), atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_half_turn_has_one_sign(axis: int) -> None:
    half_turn = 2 * np.outer(np.eye(3)[axis], np.eye(3)[axis]) - np.eye(3)
    q = conventions.quaternions_from_matrices(half_turn)
    assert q.tolist() == np.eye(4)[axis].tolist()
    assert not np.signbit(q).any()


def test_any_length_and_any_scale() -> None:
    q = random_quaternions(3, 50)
    expected = conventions.matrices_from_quaternions(q)
    for scale in (1e-200, 1e-3, 1e200):
        found = conventions.matrices_from_quaternions(scale * q)
        np.testing.assert_allclose(found, expected, atol=1e-14)


def test_shapes_are_kept() -> None:
    q = random_quaternions(4, 6).reshape(2, 3, 4)
    matrices = conventions.matrices_from_quaternions(q)
    assert matrices.shape == (2, 3, 3, 3)
    assert conventions.quaternions_from_matrices(matrices).shape == (2, 3, 4)
    assert conventions.quaternions_from_matrices(np.eye(3)).tolist() == [0, 0, 0, 1]
    assert conventions.matrices_from_rotvecs(np.zeros((2, 5, 3))).shape == (2, 5, 3, 3)


def test_families_are_transposes() -> None:
    rotations = conventions.matrices_from_quaternions(random_quaternions(5, 4))
    vision = conventions.convert_family(rotations, "vision")
    np.testing.assert_array_equal(vision, np.swapaxes(rotations, 1, 2))
    assert conventions.convert_family(rotations, "pose") is rotations
    # Vision: R_ij = R_j R_i^T with R_i = camera_from_world, becomes R_i R_ij = R_j.
    r_i, r_j = rotations[:2]
    pose_i, pose_j, pose_ij = conventions.convert_family(
        np.stack([r_i, r_j, r_j @ r_i.T]), "vision"
    )
    np.testing.assert_allclose(pose_i @ pose_ij, pose_j, atol=1e-15)


def test_bad_arguments() -> None:
    with pytest.raises(GraphError, match="expected 'pose' or 'vision'"):
        conventions.convert_family(np.eye(3), "camera")  # type: ignore[arg-type]
    for bad in ([0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 1]):
        with pytest.raises(Error, match="quaternion 1: "):
            conventions.matrices_from_quaternions([[0, 0, 0, 1], bad])
