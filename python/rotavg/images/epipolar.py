"""The geometry of two calibrated views: x_j ~ R x_i + t, the vision family as OpenCV has it.

Rays (k, 3) have their third entry 1; R is camera_j_from_camera_i; t has length 1, for its length
cannot be seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.graph.conventions import matrices_from_rotvecs

Array = NDArray[np.float64]


def essential_matrix(R: Array, t: Array) -> Array:
    """E = [t]_x R, with x_j^T E x_i = 0."""
    return np.cross(np.eye(3), t) @ R


def sampson_distances(E: Array, rays_i: Array, rays_j: Array) -> Array:
    """Signed distance (k,) to the epipolar constraint, to first order (Sampson 1982), focal 1."""
    lines_j, lines_i = rays_i @ E.T, rays_j @ E
    slope = np.sum(lines_j[:, :2] ** 2, axis=1) + np.sum(lines_i[:, :2] ** 2, axis=1)
    value = np.sum(rays_j * lines_j, axis=1)
    return np.asarray(value / np.sqrt(np.maximum(slope, 1e-300)))


def in_front(R: Array, t: Array, rays_i: Array, rays_j: Array) -> NDArray[np.bool_]:
    """Whether the point (k,) where each pair of rays nearly meet is in front of both cameras.

    The depths solve depth_j x_j = depth_i R x_i + t in the plane of the two rays.
    """
    turned = rays_i @ R.T
    normal = np.cross(turned, rays_j)
    depth_i = np.sum(np.cross(rays_j, t) * normal, axis=1)
    depth_j = np.sum(np.cross(turned, t) * normal, axis=1)
    return np.asarray((depth_i > 0) & (depth_j > 0))


def refine(R: Array, t: Array, rays_i: Array, rays_j: Array, scale: float) -> tuple[Array, Array]:
    """The pose that minimises the Sampson distances nearby, those beyond `scale` counting less.

    Five unknowns: R <- exp(w) R, and t moves along its sphere.
    """
    optimize = require("scipy.optimize", "images")
    tangent = np.linalg.svd(t[None])[2][1:]  # (2, 3), orthogonal to t

    def moved(step: Array) -> tuple[Array, Array]:
        direction = t + step[3:] @ tangent
        return matrices_from_rotvecs(step[:3]) @ R, direction / np.linalg.norm(direction)

    def distances(step: Array) -> Array:
        return sampson_distances(essential_matrix(*moved(step)), rays_i, rays_j)

    found = optimize.least_squares(distances, np.zeros(5), loss="soft_l1", f_scale=scale)
    return moved(found.x)


def rotation_covariance(R: Array, t: Array, rays_i: Array, rays_j: Array) -> Array | None:
    """Covariance (3, 3), radians^2, of w in exp(w) R, to first order; None where R is not fixed.

    That of the least squares of Sampson distances over R and the direction t, of which R's part is
    taken, with the variance of a distance as these inliers show it.
    """
    tangent = np.linalg.svd(t[None])[2][1:]
    h = 1e-6
    columns = []
    for step in h * np.eye(5):
        ends = []
        for sign in (1.0, -1.0):
            turned = matrices_from_rotvecs(sign * step[None, :3])[0] @ R
            moved = t + sign * step[3:] @ tangent
            E = essential_matrix(turned, moved / np.linalg.norm(moved))
            ends.append(sampson_distances(E, rays_i, rays_j))
        columns.append((ends[0] - ends[1]) / (2 * h))
    J = np.stack(columns, axis=1)
    residuals = sampson_distances(essential_matrix(R, t), rays_i, rays_j)
    return _covariance(J, residuals)


def turn_covariance(R: Array, rays_i: Array, rays_j: Array) -> Array | None:
    """The same of a camera that only turned, from the distances of R x_i and x_j in the image."""
    turned = rays_i @ R.T
    depth = turned[:, 2:]
    residuals = (turned / depth - rays_j)[:, :2]
    # d (exp(w) y) = w x y; of the image x = y / y_z.
    columns = []
    for axis in np.eye(3):
        d = np.cross(axis, turned)
        columns.append(((d - turned / depth * d[:, 2:]) / depth)[:, :2].ravel())
    return _covariance(np.stack(columns, axis=1), residuals.ravel())


def _covariance(J: Array, residuals: Array) -> Array | None:
    """Of the first three unknowns of least squares; their information must be there."""
    freedom = len(residuals) - J.shape[1]
    if freedom < 1:
        return None
    information = J.T @ J
    scale = np.sqrt(np.diag(information))
    if not (scale > 0).all():
        return None
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if values[0] < 1e-10:
        return None
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    variance = max(float(residuals @ residuals) / freedom, 1e-18)
    return np.asarray(variance * inverse[:3, :3])
