"""Covariances of the relative rotations in COLMAP's database, from the inliers of every pair.

That of the least squares of epipolar distances in pixels, at the pose that is there: over the
rotation and the direction of the translation, of which the rotation's part is taken
(`graph.two_views`). The cameras' models are pycolmap's (the extra [colmap]).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.graph.conventions import matrices_from_quaternions, xyzw_from_wxyz
from rotavg.graph.covariances import first_bad_covariance
from rotavg.graph.two_views import epipolar_equations, turn_equations
from rotavg.io.colmap_poses import cameras_of, inliers_of, keypoints_of

if TYPE_CHECKING:
    import sqlite3

Array = NDArray[np.float64]

# Points of pairs that are taken together, and that are kept of images: some 100 MB each.
_AT_ONCE, _KEPT = 2**17, 2**21
# A pair's own noise counts as so many residuals of the noise of all pairs.
_PRIOR_RESIDUALS = 20.0
# A noise that is less has been rounded away, pixels: features are stored as floats.
_LEAST_NOISE = 1e-3
# The largest standard deviation about an axis, radians: no more is to be known of a rotation.
_LARGEST = 1.0


class PairPose(NamedTuple):
    """A pair of images (ids, the smaller one first) and the pose of the second from the first."""

    pair_id: int
    first: int
    second: int
    wxyz: Array
    translation: Array  # (3,), of any length; zero where the camera only turned


def covariances_of_pairs(
    connection: sqlite3.Connection, poses: Sequence[PairPose]
) -> tuple[Array, int]:
    """Covariances (m, 3, 3), radians^2, of e in second_from_first = truth exp([e]).

    The frame of e is that of the first image. Pairs whose points do not tell get the same variance
    about all axes: by their number of inliers, what is usual among the others.

    Returns them and the number of those. Raises MissingExtraError where pycolmap is not installed.
    """
    m = len(poses)
    unit, squares, freedom = np.full((m, 3, 3), np.nan), np.zeros(m), np.zeros(m)
    counts = np.zeros(m)
    for rows, rays_i, rays_j, number, pixels in _chunks(connection, poses):
        R = matrices_from_quaternions(xyzw_from_wxyz(np.array([poses[k].wxyz for k in rows])))
        t = np.array([poses[k].translation for k in rows])
        length = np.linalg.norm(t, axis=1, keepdims=True)
        t /= np.where(length > 0, length, 1.0)
        for kind in (True, False):  # whether the camera moved
            chosen = (length[:, 0] > 0) == kind
            if not chosen.any():
                continue
            points = np.repeat(chosen, number)
            sides = rays_i[points], rays_j[points], number[chosen], pixels[chosen]
            found = (
                epipolar_equations(R[chosen], t[chosen], *sides)
                if kind
                else turn_equations(R[chosen], *sides)
            )
            unit[rows[chosen]] = found.rotation_covariances(np.ones(len(found.squares)))
            squares[rows[chosen]], freedom[rows[chosen]] = found.squares, found.freedom
        counts[rows] = number
    return _completed(unit * _variances(squares, freedom)[:, None, None], counts)


def _variances(squares: Array, freedom: Array) -> Array:
    """(m,) of a residual, pixels^2: what a pair's own say, drawn to what all pairs say."""
    told = freedom > 0
    if not told.any():
        return np.ones(len(squares))
    usual = max(float(np.median(squares[told] / freedom[told])), _LEAST_NOISE**2)
    own = np.where(told, squares, 0.0), np.where(told, freedom, 0.0)
    return np.asarray((own[0] + _PRIOR_RESIDUALS * usual) / (own[1] + _PRIOR_RESIDUALS))


def _completed(covariances: Array, counts: Array) -> tuple[Array, int]:
    """With those that are not known, or no covariances, filled in; and how many these are."""
    known = np.isfinite(covariances).all(axis=(1, 2))
    trace = np.trace(covariances, axis1=1, axis2=2)
    known &= (trace > 0) & (trace <= 3 * _LARGEST**2)
    while known.any() and (bad := first_bad_covariance(covariances[known])) is not None:
        known[np.flatnonzero(known)[bad[0]]] = False
    usual = float(np.median((trace * counts)[known])) / 3 if known.any() else _LARGEST**2
    variance = np.minimum(usual / np.maximum(counts[~known], 1.0), _LARGEST**2)
    covariances[~known] = variance[:, None, None] * np.eye(3)
    return covariances, int((~known).sum())


def _chunks(
    connection: sqlite3.Connection, poses: Sequence[PairPose]
) -> Iterator[tuple[NDArray[np.int64], Array, Array, NDArray[np.int64], Array]]:
    """Some pairs at a time: their rows, rays (p, 3) of both images, counts, sizes of pixels."""
    images = _Rays(connection)
    rows: list[int] = []
    rays: list[tuple[Array, Array]] = []
    pixels: list[tuple[float, float]] = []
    points = 0
    for k, pose in enumerate(poses):
        first, second = images(pose.first), images(pose.second)
        matches = inliers_of(connection, pose.pair_id, len(first.rays), len(second.rays))
        x_i, x_j = first.rays[matches[:, 0]], second.rays[matches[:, 1]]
        fine = np.isfinite(x_i).all(axis=1) & np.isfinite(x_j).all(axis=1)
        rows.append(k)
        rays.append((x_i[fine], x_j[fine]))
        pixels.append((first.pixel, second.pixel))
        points += int(fine.sum())
        if points >= _AT_ONCE or k == len(poses) - 1:
            i, j = (np.concatenate(sides) for sides in zip(*rays))
            counts = np.array([len(pair[0]) for pair in rays])
            yield np.array(rows), _homogeneous(i), _homogeneous(j), counts, np.array(pixels)
            rows, rays, pixels, points = [], [], [], 0


def _homogeneous(points: Array) -> Array:
    return np.column_stack([points, np.ones(len(points))])


class _Image(NamedTuple):
    rays: Array  # (k, 2), third entry 1; NaN where the camera's model has none
    pixel: float  # its size, focal length 1


class _Rays:
    """The features of images as rays; those used last are kept."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        pycolmap = require("pycolmap", "colmap")
        self.connection = connection
        self.cameras = cameras_of(pycolmap, connection)
        self.kept: dict[int, _Image] = {}
        self.points = 0

    def __call__(self, image: int) -> _Image:
        if image not in self.kept:
            if self.points > _KEPT:
                self.kept, self.points = {}, 0
            self.kept[image] = self._read(image)
            self.points += len(self.kept[image].rays)
        return self.kept[image]

    def _read(self, image: int) -> _Image:
        camera = self.cameras.get(image)
        if camera is None:
            return _Image(np.empty((0, 2)), 1.0)
        points = keypoints_of(self.connection, image)
        rays = camera.cam_from_img(points) if len(points) else points
        return _Image(np.asarray(rays, dtype=np.float64), 1.0 / camera.mean_focal_length())
