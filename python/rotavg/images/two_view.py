"""The relative pose of two photographs from their matches, robustly, or why there is none.

An essential matrix from MAGSAC++ (Barath et al. 2020) in OpenCV, decomposed, the pose that has the
most points in front of both cameras, and its refinement. Two cases in which epipolar geometry
says too little are told apart: a camera that only turned, and a plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.images import degenerate
from rotavg.images.epipolar import (
    Array,
    essential_matrix,
    in_front,
    refine,
    rotation_covariance,
    sampson_distances,
)

Kind = Literal["general", "planar", "rotation"]

# A homography that explains this share of an essential matrix's inliers makes the pair degenerate.
_HOMOGRAPHY_SHARE = 0.8
# Poses apart by more than this of which the worse has this share of the better's inliers leave
# open which of them is right.
_SAME_POSE_DEG = 5.0
_AMBIGUOUS_SHARE = 0.9


class NoGeometryError(Exception):
    """Two photographs have no relative rotation that could be relied on; the message says why."""


@dataclass(frozen=True, eq=False)
class TwoView:
    """A relative pose, vision family: x_j = R x_i + t.

    Attributes:
        j_from_i: (3, 3) rotation from camera i's to camera j's frame.
        translation: (3,) of length 1; without meaning where `kind` is "rotation".
        inliers: (p,) which of the matches agree.
        kind: "general"; "planar" where the points lie in a plane; "rotation" where the camera
            turned and (nearly) did not move.
    """

    j_from_i: Array
    translation: Array
    inliers: NDArray[np.bool_]
    kind: Kind

    def covariance(self, rays_i: Array, rays_j: Array) -> Array | None:
        """Covariance (3, 3), radians^2, of e in j_from_i = truth exp([e]); None where not known.

        Args:
            rays_i: (p, 3) of all matches, as they were given to `estimate`.
            rays_j: the same in camera j's frame.
        """
        t = None if self.kind == "rotation" else self.translation
        return rotation_covariance(self.j_from_i, t, rays_i[self.inliers], rays_j[self.inliers])


def estimate(
    rays_i: Array, rays_j: Array, *, max_error: float, min_inliers: int = 15, seed: int = 0
) -> TwoView:
    """Relative pose of two cameras from matching rays (p, 3), of which many may be wrong.

    Args:
        rays_i: directions of matching points in camera i's frame, third entry 1.
        rays_j: the same points in camera j's frame.
        max_error: of an inlier, distance to the epipolar line in units of the focal length.
        min_inliers: fewer are no evidence.
        seed: the same seed gives the same pose.

    Raises:
        NoGeometryError: too few matches or inliers, or a plane that two rotations explain.
    """
    if len(rays_i) < max(min_inliers, 5):
        raise NoGeometryError(f"too few matches ({len(rays_i)})")
    E = _essential_matrix(rays_i, rays_j, max_error, seed)
    if E is None:
        raise NoGeometryError("no essential matrix fits the matches")
    support = int((np.abs(sampson_distances(E, rays_i, rays_j)) < max_error).sum())
    H = degenerate.homography(rays_i, rays_j, max_error, seed)
    if H is not None:
        flat = degenerate.transfer_errors(H, rays_i, rays_j) < max_error
        if flat.sum() < _HOMOGRAPHY_SHARE * support:
            H = None
        else:
            # Before anything else, as without a baseline no point has a depth.
            R, agree = degenerate.pure_rotation(H, flat, rays_i, rays_j, max_error)
            if agree.sum() >= max(min_inliers, _HOMOGRAPHY_SHARE * support):
                return TwoView(R, np.array([0.0, 0.0, 1.0]), agree, "rotation")
    best = _best_pose(_decompose(E), rays_i, rays_j, max_error)
    if H is not None:
        best = _planar(best, H, rays_i, rays_j, max_error)
    if best.inliers.sum() < min_inliers:
        reason = f"too few inliers ({best.inliers.sum()} of {len(rays_i)} matches)"
        raise NoGeometryError(reason)
    return best


def _planar(best: TwoView, H: Array, rays_i: Array, rays_j: Array, max_error: float) -> TwoView:
    """Of a plane two poses may be left, both with all points in front; then nothing decides.

    Source: Longuet-Higgins 1986. Raises NoGeometryError then.
    """
    poses = [best] + [
        _refined(R, t, rays_i, rays_j, max_error)
        for R, t in degenerate.decompose(H)
        if 2 * in_front(R, t, rays_i, rays_j)[best.inliers].sum() > best.inliers.sum()
    ]
    poses.sort(key=lambda pose: -int(pose.inliers.sum()))
    winner = poses[0]
    enough = _AMBIGUOUS_SHARE * winner.inliers.sum()
    for other in poses[1:]:
        apart = _angle_deg(winner.j_from_i, other.j_from_i)
        if apart > _SAME_POSE_DEG and other.inliers.sum() >= enough:
            reason = f"the points lie in a plane and two rotations, {apart:.0f} deg apart, fit"
            raise NoGeometryError(reason)
    return TwoView(winner.j_from_i, winner.translation, winner.inliers, "planar")


def _essential_matrix(rays_i: Array, rays_j: Array, max_error: float, seed: int) -> Array | None:
    cv2 = require("cv2", "images")
    settings = degenerate.magsac(max_error, seed)
    K, no_distortion = np.eye(3), np.zeros(4)
    points_i, points_j = (np.ascontiguousarray(rays[:, :2]) for rays in (rays_i, rays_j))
    try:
        E, _ = cv2.findEssentialMat(
            points_i, points_j, K, K, no_distortion, no_distortion, settings
        )
    except cv2.error:  # matches that are all one point, and the like
        return None
    return None if E is None or E.shape != (3, 3) or not np.isfinite(E).all() else np.asarray(E)


def _decompose(E: Array) -> list[tuple[Array, Array]]:
    cv2 = require("cv2", "images")
    R1, R2, t = cv2.decomposeEssentialMat(E)
    return [(R, sign * t.ravel()) for R in (R1, R2) for sign in (1.0, -1.0)]


def _best_pose(
    poses: list[tuple[Array, Array]], rays_i: Array, rays_j: Array, max_error: float
) -> TwoView:
    """The pose with the most inliers in front of both cameras, refined."""
    counts = [_inliers(R, t, rays_i, rays_j, max_error).sum() for R, t in poses]
    return _refined(*poses[int(np.argmax(counts))], rays_i, rays_j, max_error)


def _refined(R: Array, t: Array, rays_i: Array, rays_j: Array, max_error: float) -> TwoView:
    inliers = _inliers(R, t, rays_i, rays_j, max_error)
    for _ in range(2):  # with the inliers of the first refinement again
        if inliers.sum() < 6:
            break
        R, t = refine(R, t, rays_i[inliers], rays_j[inliers], max_error)
        inliers = _inliers(R, t, rays_i, rays_j, max_error)
    return TwoView(R, t, inliers, "general")


def _inliers(
    R: Array, t: Array, rays_i: Array, rays_j: Array, max_error: float
) -> NDArray[np.bool_]:
    distances = sampson_distances(essential_matrix(R, t), rays_i, rays_j)
    return (np.abs(distances) < max_error) & in_front(R, t, rays_i, rays_j)


def _angle_deg(R1: Any, R2: Any) -> float:
    # From the chord: exact near 0, where the trace is not.
    return float(np.degrees(2 * np.arcsin(min(1.0, np.linalg.norm(R1 - R2) / np.sqrt(8)))))
