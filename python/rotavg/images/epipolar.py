"""The geometry of two calibrated views: x_j ~ R x_i + t, the vision family as OpenCV has it.

Rays (k, 3) have their third entry 1; R is camera_j_from_camera_i; t has length 1, for its length
cannot be seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.two_views import epipolar_equations, turn_equations

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


def rotation_covariance(R: Array, t: Array | None, rays_i: Array, rays_j: Array) -> Array | None:
    """Covariance (3, 3), radians^2, of e in R exp([e]), to first order; None where R is not fixed.

    That of the least squares of Sampson distances over R and the direction t, of which R's part is
    taken, with the variance of a distance as these inliers show it. Where t is None, the camera
    only turned: then of distances in the image of j.
    """
    sides = rays_i, rays_j, np.array([len(rays_i)])
    if t is None:
        found = turn_equations(R[None], *sides)
    else:
        found = epipolar_equations(R[None], t[None], *sides)
    variance = np.maximum(found.squares / np.maximum(found.freedom, 1), 1e-18)
    covariance = found.rotation_covariances(variance)[0]
    return covariance if np.isfinite(covariance).all() else None
