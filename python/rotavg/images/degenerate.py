"""Where a homography explains the matches: a plane, or a camera that only turned."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.images.epipolar import Array


def magsac(max_error: float, seed: int) -> Any:
    """Settings of OpenCV's robust estimators: MAGSAC++, deterministic."""
    cv2 = require("cv2", "images")
    settings = cv2.UsacParams()
    settings.randomGeneratorState = seed
    settings.isParallel = False  # the same bits each time
    settings.confidence = 0.9999
    settings.maxIterations = 10000
    settings.threshold = max_error
    settings.sampler = cv2.SAMPLING_UNIFORM
    settings.score = cv2.SCORE_METHOD_MAGSAC
    settings.loMethod = cv2.LOCAL_OPTIM_SIGMA
    settings.loIterations = 10
    settings.loSampleSize = 14
    settings.final_polisher = cv2.MAGSAC
    settings.final_polisher_iterations = 20
    return settings


def homography(rays_i: Array, rays_j: Array, max_error: float, seed: int) -> Array | None:
    """The homography (3, 3) that explains the most matches, x_j ~ H x_i; None if there is none."""
    cv2 = require("cv2", "images")
    # As one of pixels: OpenCV's degeneracy checks are made for them.
    unit = 1 / max_error
    points_i, points_j = (np.ascontiguousarray(rays[:, :2]) * unit for rays in (rays_i, rays_j))
    try:
        H, _ = cv2.findHomography(points_i, points_j, magsac(1.0, seed))
    except cv2.error:
        return None
    if H is None or not np.isfinite(H).all() or np.linalg.det(H) == 0:
        return None
    scale = np.diag([unit, unit, 1.0])
    return np.asarray(np.linalg.inv(scale) @ H @ scale)


def transfer_errors(H: Array, rays_i: Array, rays_j: Array) -> Array:
    """Distance (p,) from H x_i to x_j, in units of the focal length; infinite behind the camera."""
    moved = rays_i @ (H / np.cbrt(np.linalg.det(H))).T
    ahead = moved[:, 2] > 1e-9
    points = moved[:, :2] / np.where(ahead, moved[:, 2], 1.0)[:, None]
    distances = np.linalg.norm(points - rays_j[:, :2], axis=1)
    return np.where(ahead, distances, np.inf)


def pure_rotation(
    H: Array, inliers: NDArray[np.bool_], rays_i: Array, rays_j: Array, max_error: float
) -> tuple[Array, NDArray[np.bool_]]:
    """The rotation (3, 3) nearest to what a homography's inliers show, and its own inliers (p,)."""
    R = _nearest_rotation(H / np.cbrt(np.linalg.det(H)))
    units_i, units_j = (r / np.linalg.norm(r, axis=1, keepdims=True) for r in (rays_i, rays_j))
    for _ in range(3):
        if inliers.sum() >= 2:
            R = _nearest_rotation(units_j[inliers].T @ units_i[inliers])  # Wahba's problem
        inliers = transfer_errors(R, rays_i, rays_j) < max_error
    return R, inliers


def decompose(H: Array) -> list[tuple[Array, Array]]:
    """The poses (R, t), t of length 1, that a plane with this homography allows: up to four."""
    cv2 = require("cv2", "images")
    _, rotations, translations, _ = cv2.decomposeHomographyMat(H, np.eye(3))
    lengths = [np.linalg.norm(t) for t in translations]
    return [
        (R, t.ravel() / length)
        for R, t, length in zip(rotations, translations, lengths)
        if length > 1e-9
    ]


def _nearest_rotation(M: Array) -> Array:
    U, _, Vt = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
