"""The single place where conventions meet.

Inside the library there is one convention, the *pose family* (the paper, g2o, GTSAM, SE-Sync):
R_i is world_from_i, R_ij is i_from_j, and R_i R_ij = R_j. The *vision family* (COLMAP, GLOMAP,
Theia, OpenMVG, OpenCV) keeps R_i as camera_from_world and R_ij = R_j R_i^T: every R_i *and* every
R_ij is the transpose. Quaternions are Hamilton, stored (x, y, z, w), unless a name says otherwise.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import GraphError

Convention = Literal["pose", "vision"]
QuaternionOrder = Literal["xyzw", "wxyz"]


def convert_family(rotations: NDArray[np.float64], convention: Convention) -> NDArray[np.float64]:
    """Rotations (..., 3, 3) of the named family as pose family, or the other way round.

    The same transpose does both directions, for absolute and for relative rotations alike.
    Raises GraphError on an unknown family.
    """
    check_family(convention)
    return rotations if convention == "pose" else np.swapaxes(rotations, -1, -2)


def check_family(convention: Convention) -> None:
    """GraphError on an unknown family."""
    if convention not in ("pose", "vision"):
        raise GraphError(f"convention is {convention!r}, expected 'pose' or 'vision'")


def xyzw_from_wxyz(quaternions: ArrayLike) -> NDArray[np.float64]:
    """Reorder quaternions (..., 4) from w first to w last."""
    return np.roll(np.asarray(quaternions, dtype=np.float64), -1, axis=-1)


def wxyz_from_xyzw(quaternions: ArrayLike) -> NDArray[np.float64]:
    """Reorder quaternions (..., 4) from w last to w first."""
    return np.roll(np.asarray(quaternions, dtype=np.float64), 1, axis=-1)


def first_bad_quaternion(quaternions: NDArray[np.float64]) -> tuple[int, str] | None:
    """Row and defect of the first quaternion (m, 4) that gives no rotation; None if all do."""
    size = np.max(np.abs(quaternions), axis=1, initial=0.0)
    bad = ~((size > 0) & np.isfinite(size))
    if not bad.any():
        return None
    row = int(np.argmax(bad))
    if size[row] == 0:
        return row, "the quaternion is zero, expected one of length 1"
    return row, f"the quaternion is {quaternions[row].tolist()}, expected finite numbers"


def first_no_rotation(matrices: NDArray[np.float64]) -> int | None:
    """Row of the first matrix (m, 3, 3) that is further from a rotation than 1e-3, if any is."""
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(np.swapaxes(matrices, 1, 2) @ matrices - np.eye(3)).max(axis=(1, 2))
    bad = ~(error < 1e-3)
    bad[~bad] = np.linalg.det(matrices[~bad]) < 0
    return int(np.argmax(bad)) if bad.any() else None


def matrices_from_quaternions(quaternions: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) in xyzw order, of any length but 0.

    Raises GraphError for a zero or non-finite quaternion.
    """
    q = np.asarray(quaternions, dtype=np.float64)
    bad = first_bad_quaternion(q.reshape(-1, 4))
    if bad is not None:
        raise GraphError(f"quaternion {bad[0]}: {bad[1]}")
    # Scaling by the largest entry first keeps the squared length from over- and underflowing.
    q = q / np.max(np.abs(q), axis=-1, keepdims=True)
    x, y, z, w = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    matrices = np.empty((*q.shape[:-1], 3, 3))
    matrices[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrices[..., 0, 1] = 2 * (x * y - z * w)
    matrices[..., 0, 2] = 2 * (x * z + y * w)
    matrices[..., 1, 0] = 2 * (x * y + z * w)
    matrices[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrices[..., 1, 2] = 2 * (y * z - x * w)
    matrices[..., 2, 0] = 2 * (x * z - y * w)
    matrices[..., 2, 1] = 2 * (y * z + x * w)
    matrices[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrices


def quaternions_from_matrices(rotations: ArrayLike) -> NDArray[np.float64]:
    """Unit quaternions (..., 4), xyzw, of rotation matrices (..., 3, 3); any angle, pi included.

    Of the two signs the one with w > 0 is taken; where w = 0, the one whose first non-zero entry
    is positive.
    """
    r = np.asarray(rotations, dtype=np.float64)
    m = np.moveaxis(r.reshape(-1, 3, 3), 0, -1)
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    # Row k of K = 4 q q^T is 4 q_k q. The row with the largest diagonal entry (>= 1) has no
    # cancellation worth mentioning, at no angle.
    k = np.empty((4, 4, trace.size))
    for i in range(3):
        j, h = (i + 1) % 3, (i + 2) % 3
        k[i, i] = 1 + 2 * m[i, i] - trace
        k[i, j] = k[j, i] = m[i, j] + m[j, i]
        k[i, 3] = k[3, i] = m[h, j] - m[j, h]
    k[3, 3] = 1 + trace
    largest = np.argmax(np.einsum("iin->in", k), axis=0)
    q = k[largest, :, np.arange(trace.size)]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    wxyz = q[:, [3, 0, 1, 2]]
    first = np.argmax(wxyz != 0, axis=1)
    negative = wxyz[np.arange(len(q)), first] < 0
    q = np.where(negative[:, None], -q, q) + 0.0  # + 0.0 turns -0.0 into 0.0
    return q.reshape(*r.shape[:-2], 4)


def matrices_from_rotvecs(rotvecs: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3): axis times angle in radians."""
    return matrices_from_quaternions(quaternions_from_rotvecs(rotvecs))


def quaternions_from_rotvecs(rotvecs: ArrayLike) -> NDArray[np.float64]:
    """Quaternions (..., 4), xyzw, of rotation vectors (..., 3): axis times angle in radians."""
    v = np.asarray(rotvecs, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1)
    half_sinc = 0.5 * np.sinc(angle / (2 * np.pi))  # sin(angle / 2) / angle
    return np.concatenate([half_sinc[..., None] * v, np.cos(angle / 2)[..., None]], axis=-1)


def matrices_from_angles_about_z(angles: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrices (m, 3, 3) by angles (m, 1) in radians about z: poses in the plane."""
    angle = np.asarray(angles, dtype=np.float64)
    return _turns(2, angle[:, 0])


def angles_about_z(rotations: ArrayLike) -> NDArray[np.float64]:
    """Angles (m, 1), radians in [-pi, pi], of the rotations about z nearest to (m, 3, 3)."""
    r = np.asarray(rotations, dtype=np.float64)
    angle = np.arctan2(r[:, 1, 0] - r[:, 0, 1], r[:, 0, 0] + r[:, 1, 1])
    return np.asarray(angle[:, None])


def matrices_from_roll_pitch_yaw(angles: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrices R_z(yaw) R_y(pitch) R_x(roll) of roll, pitch, yaw (m, 3) in radians."""
    roll, pitch, yaw = np.asarray(angles, dtype=np.float64).T
    return np.asarray(_turns(2, yaw) @ _turns(1, pitch) @ _turns(0, roll))


def roll_pitch_yaw_from_matrices(rotations: ArrayLike) -> NDArray[np.float64]:
    """Roll, pitch, yaw (m, 3) in radians of rotations (m, 3, 3), exact at pitch = pi / 2, too.

    There yaw is what rounding leaves, and roll is measured once yaw is undone, so that both fit.
    """
    r = np.asarray(rotations, dtype=np.float64)
    pitch = np.arctan2(-r[:, 2, 0], np.hypot(r[:, 0, 0], r[:, 1, 0]))
    yaw = np.arctan2(r[:, 1, 0], r[:, 0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(s * r[:, 0, 2] - c * r[:, 1, 2], c * r[:, 1, 1] - s * r[:, 0, 1])
    return np.stack([roll, pitch, yaw], axis=1)


def _turns(axis: int, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices (m, 3, 3) about x (0), y (1) or z (2)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrices = np.zeros((len(angles), 3, 3))
    matrices[:, axis, axis] = 1
    matrices[:, j, j] = matrices[:, k, k] = np.cos(angles)
    matrices[:, k, j] = np.sin(angles)
    matrices[:, j, k] = -matrices[:, k, j]
    return matrices
