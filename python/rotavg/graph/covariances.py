"""Noise that is not the same in all directions: covariances of measurements."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

COVARIANCE = ("cxx", "cxy", "cxz", "cyy", "cyz", "czz")  # the upper triangle, in columns


def first_bad_covariance(covariances: NDArray[np.float64]) -> tuple[int, str] | None:
    """Row and defect of the first (m, 3, 3) that is no covariance; None if all are."""
    finite = np.asarray(np.isfinite(covariances).all(axis=(1, 2)))
    safe = covariances
    if not finite.all():
        safe = covariances.copy()
        safe[~finite] = np.eye(3)
    size = np.abs(safe).max(axis=(1, 2))
    off = np.abs(safe - np.swapaxes(safe, 1, 2)).max(axis=(1, 2))
    good = finite & (off <= 1e-9 * size)
    doubtful = ~surely_definite(safe, size)
    good[doubtful] &= np.linalg.eigvalsh(safe[doubtful])[:, 0] > 1e-13 * size[doubtful]
    if good.all():
        return None
    row = int(np.argmin(good))
    if not finite[row]:
        return row, "the covariance holds a NaN or an infinity"
    if off[row] > 1e-9 * size[row]:
        return row, f"the covariance is not symmetric: entries differ by {off[row]:.3g}"
    low, _, high = np.linalg.eigvalsh(safe[row]).tolist()
    found = f"the covariance is not positive definite: its eigenvalues are {low:.3g} to {high:.3g}"
    return row, f"{found}, expected the least above 1e-13 of the largest entry"


def of_information(
    omega: NDArray[np.float64], used: NDArray[np.bool_]
) -> tuple[NDArray[np.float64] | None, int | None]:
    """(m, 3, 3) inverse information; or None, and the first row of which rounding leaves none.

    Of edges that are not `used` (m,) it is the identity.
    """
    known = np.where(used[:, None, None], omega, np.eye(3))
    with np.errstate(all="ignore"):
        covariances = _inverses(known)
    bad = first_bad_covariance(covariances)
    return (covariances, None) if bad is None else (None, bad[0])


NOT_USED = "covariances not used"


def not_used(place: str) -> str:
    """The note that the covariances are not used, for what stands at a place."""
    why = "is too uneven about its axes to be inverted"
    return f"{NOT_USED}: the information about the rotation {place} {why}"


def information_to_write(
    covariances: NDArray[np.float64],
    weights: NDArray[np.float64],
    cross: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """(m, 3, 3) information about rotations as files have it, and with translations, if there is.

    Information Omega reads back as the weight 3 / (2 tr Omega^-1). It is scaled so that the weights
    are those of the graph; but where these are the constructor's default, 3 / tr of the
    covariances, the covariances stay as they are, and the weights come back halved.

    Args:
        covariances: (m, 3, 3).
        weights: (m,).
        cross: (m, 3, 3) information about translations and rotations together.
    """
    share = weights * np.trace(covariances, axis1=1, axis2=2) / 1.5
    used = weights > 0
    if np.allclose(share[used], 2.0, rtol=1e-9, atol=0.0):
        share = np.where(used, 1.0, 0.0)
    scaled = None if cross is None else cross * np.sqrt(share)[:, None, None]
    return information(covariances, share), scaled  # together still definite


def symmetric(matrices: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """The symmetric parts of (..., 3, 3), of entries up to the largest that there are."""
    result: NDArray[np.float64] = 0.5 * matrices + 0.5 * np.swapaxes(matrices, -1, -2)
    return result


def surely_definite(matrices: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(m,) whether symmetric matrices (m, 3, 3) are positive definite beyond doubt.

    By their leading minors: the least eigenvalue is at least 4 det / tr^2, and so more than 1e-13
    `size` (m,), which is that of the largest entry.
    """
    with np.errstate(all="ignore"):
        a, b, d, c, e, f = (
            matrices[:, i, j] / size for i, j in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
        )
        minor = a * d - b * b
        det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
        return np.asarray((a > 1e-12) & (minor > 1e-12) & (det > 1e-12))


def pose_family(
    covariances: NDArray[np.float64], rotations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Covariances of measurements R_ji = R_ij^T (vision family), in the frame of i, for R_ij.

    R_ji exp([e]) is the transpose of exp([-e]) R_ij = R_ij exp([-R_ij^T e]).
    """
    return np.asarray(np.swapaxes(rotations, 1, 2) @ covariances @ rotations)


def isotropic_weights(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) 3 / tr: one over the mean variance about an axis."""
    with np.errstate(over="ignore", divide="ignore"):  # a weight of 0 or inf is refused
        return np.asarray(3 / np.trace(covariances, axis1=1, axis2=2))


def precision_of_weight_one(
    covariances: NDArray[np.float64], weights: NDArray[np.float64]
) -> float:
    """About an axis, radians^-2, of a prior of weight 1: that of an edge of weight 1, typically.

    One over the mean variance of an edge, divided by its weight: 1 where the weights (m,) come from
    the covariances.
    """
    return float(np.median(isotropic_weights(covariances) / weights))


def information(
    covariances: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(m, 3, 3) inverse covariances, times `share` (m,): what is left of their weights."""
    omega = _inverses(covariances)
    omega *= share[:, None, None]
    return omega


def _inverses(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of symmetric positive definite (m, 3, 3), symmetric.

    By cofactors of the correlations, which lose the square of their condition, where that costs
    three digits at most.
    """
    scale = 1 / np.sqrt(np.einsum("maa->ma", matrices))
    x, y, z = (matrices[:, i, j] * (scale[:, i] * scale[:, j]) for i, j in ((1, 0), (2, 0), (2, 1)))
    result = np.empty(matrices.shape)
    result[:, 0, 0] = 1 - z * z
    result[:, 1, 1] = 1 - y * y
    result[:, 2, 2] = 1 - x * x
    result[:, 0, 1] = result[:, 1, 0] = y * z - x
    result[:, 0, 2] = result[:, 2, 0] = x * z - y
    result[:, 1, 2] = result[:, 2, 1] = x * y - z
    det = result[:, 0, 0] + x * result[:, 0, 1] + y * result[:, 0, 2]
    poor = ~(det > 1e-3)
    det[poor] = 1.0
    result *= scale[:, :, None] * scale[:, None, :]
    result /= det[:, None, None]
    if poor.any():
        result[poor] = symmetric(np.linalg.inv(matrices[poor]))
    return result
