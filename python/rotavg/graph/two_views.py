"""How well two calibrated views know their relative rotation: covariances from matching points.

x_j ~ R x_i + t, the vision family: R is j_from_i, t has length 1. Rays (p, 3) have their third
entry 1. Many pairs of views at once: the points of pair 0 come first, then those of pair 1, ...
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.covariances import symmetric

Array = NDArray[np.float64]


class Equations(NamedTuple):
    """Gauss-Newton normal equations of k pairs of views, each of residuals with one variance.

    Attributes:
        information: (k, d, d), J^T J; the first three unknowns are e in R exp([e]), in the frame
            of i, the other two, if d is 5, move t on its sphere.
        squares: (k,) sum of the squared residuals.
        freedom: (k,) how many residuals there are more than unknowns.
    """

    information: Array
    squares: Array
    freedom: NDArray[np.int64]

    def rotation_covariances(self, variance: Array) -> Array:
        """(k, 3, 3) covariance of e, NaN where the points do not fix it; the others marginalised.

        Args:
            variance: (k,) of a residual.
        """
        information = self.information
        with np.errstate(all="ignore"):
            scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
            outer = scale[:, :, None] * scale[:, None, :]
            unit = information / outer
            known = np.isfinite(unit).all(axis=(1, 2)) & (scale > 0).all(axis=1)
            known &= self.freedom >= 1
            unit = np.where(known[:, None, None], unit, np.eye(information.shape[1]))
            values, vectors = np.linalg.eigh(unit)
            known &= values[:, 0] >= 1e-10
            inverse = (vectors / values[:, None]) @ np.swapaxes(vectors, 1, 2) / outer
            inverse = inverse[:, :3, :3] * np.asarray(variance)[:, None, None]
        inverse = symmetric(inverse)
        return np.where(known[:, None, None], inverse, np.nan)


def epipolar_equations(
    R: Array,
    t: Array,
    rays_i: Array,
    rays_j: Array,
    counts: NDArray[np.int64],
    pixels: Array | None = None,
) -> Equations:
    """Of the least squares of Sampson's distances over R and the direction of t.

    A distance is N / sqrt(S), N = x_j^T E x_i with E = [t] R, and S the squared slope of N in the
    two images (Sampson 1982): its variance is that of an image coordinate.

    Args:
        R: (k, 3, 3) j_from_i.
        t: (k, 3) of length 1.
        rays_i: (p, 3) of the points in the first views.
        rays_j: the same in the second ones.
        counts: (k,) points of every pair, p together.
        pixels: (k, 2) sizes of a pixel in the images of i and j, focal length 1; then distances are
            in pixels. By default 1.
    """
    k, pair = len(counts), np.repeat(np.arange(len(counts)), counts)
    E = np.cross(t[:, :, None], R, axisa=1, axisb=1, axisc=1)  # [t] R, column by column
    lines_j = np.einsum("pab,pb->pa", E[pair], rays_i)
    lines_i = np.einsum("pab,pa->pb", E[pair], rays_j)
    square = np.ones((k, 2)) if pixels is None else pixels**2
    at_i, at_j = square[pair, 0, None], square[pair, 1, None]
    value = np.sum(rays_j * lines_j, axis=1)
    slope = np.sum(at_j * lines_j[:, :2] ** 2 + at_i * lines_i[:, :2] ** 2, axis=1)
    root = np.sqrt(np.maximum(slope, 1e-300))
    # What the lines are multiplied by in half the derivative of the slope.
    by_j, by_i = np.zeros_like(lines_j), np.zeros_like(lines_i)
    by_j[:, :2], by_i[:, :2] = at_j * lines_j[:, :2], at_i * lines_i[:, :2]
    # d lines_j = E (e x x_i), d lines_i = lines_i x e, d value = e . (x_i x lines_i)
    back = np.einsum("pab,pa->pb", E[pair], by_j)
    slopes = np.cross(rays_i, back) + np.cross(by_i, lines_i)
    J = np.empty((len(pair), 5))
    J[:, :3] = np.cross(rays_i, lines_i) - (value / root**2)[:, None] * slopes
    # t + b: d lines_j = b x y, d lines_i = R^T (x_j x b), d value = b . (y x x_j), y = R x_i
    y = np.einsum("pab,pb->pa", R[pair], rays_i)
    turned = np.einsum("pab,pb->pa", R[pair], by_i)
    slopes = np.cross(y, by_j) + np.cross(turned, rays_j)
    along = np.cross(y, rays_j) - (value / root**2)[:, None] * slopes
    J[:, 3:] = np.einsum("pa,pab->pb", along, _tangents(t)[pair])
    return _equations(J / root[:, None], value / root, counts, counts)


def turn_equations(
    R: Array,
    rays_i: Array,
    rays_j: Array,
    counts: NDArray[np.int64],
    pixels: Array | None = None,
) -> Equations:
    """The same of cameras that only turned: distances of R x_i and x_j in the image of j.

    The variance of a residual is again that of an image coordinate, of which there are two.
    """
    k, pair = len(counts), np.repeat(np.arange(len(counts)), counts)
    size = np.ones((k, 2)) if pixels is None else pixels
    spread = np.sqrt(np.sum(size**2, axis=1))[pair]
    y = np.einsum("pab,pb->pa", R[pair], rays_i)
    with np.errstate(all="ignore"):
        image = y / y[:, 2:]
        residuals = (image - rays_j)[:, :2] / spread[:, None]
        # d (R exp([e]) x) = R (e x x) = -R [x] e; of the image y / y_z.
        turned = -np.cross(rays_i[:, None, :], R[pair])  # rows of -R [x]
        d = turned[:, :2] - image[:, :2, None] * turned[:, 2:]
        J = d / (y[:, 2] * spread)[:, None, None]
    return _equations(J.reshape(-1, 3), residuals.ravel(), counts, 2 * counts)


def _equations(
    J: Array, residuals: Array, counts: NDArray[np.int64], rows: NDArray[np.int64]
) -> Equations:
    """Sums over each pair's rows of J."""
    d = J.shape[1]
    upper = np.triu_indices(d)
    products = np.concatenate([J[:, upper[0]] * J[:, upper[1]], residuals[:, None] ** 2], axis=1)
    sums = np.zeros((len(counts), products.shape[1]))
    filled = rows > 0  # reduceat has no empty sums
    starts = np.cumsum(rows) - rows
    if filled.any():
        sums[filled] = np.add.reduceat(products, starts[filled], axis=0)
    information = np.empty((len(counts), d, d))
    information[:, upper[0], upper[1]] = information[:, upper[1], upper[0]] = sums[:, :-1]
    return Equations(information, sums[:, -1], np.asarray(rows - d))


def _tangents(t: Array) -> Array:
    """(k, 3, 2) two orthonormal columns at right angles to each t (k, 3)."""
    axis = np.eye(3)[np.argmin(np.abs(t), axis=1)]
    first = np.cross(t, axis)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-300)
    return np.stack([first, np.cross(t, first)], axis=2)
