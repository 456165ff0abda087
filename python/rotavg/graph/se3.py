"""Rigid motions (R, t) and their logarithms, many at a time.

A tangent vector is (rho, phi), translation first as in g2o's files; T exp(xi) moves in the body's
own frame. Formulas: Barfoot, State Estimation for Robotics (2017), section 7.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.conventions import quaternions_from_matrices

Floats = NDArray[np.float64]

_SMALL = 0.05  # radians; below it series, which are then exact to rounding


def hat(vectors: Floats) -> Floats:
    """Matrices (m, 3, 3) of the cross products with vectors (m, 3) from the left."""
    result = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    result[:, 0, 1], result[:, 0, 2], result[:, 1, 2] = -z, y, -x
    result[:, 1, 0], result[:, 2, 0], result[:, 2, 1] = z, -y, x
    return result


def log_so3(rotations: Floats) -> Floats:
    """Rotation vectors (m, 3), at most pi long, of rotations (m, 3, 3)."""
    q = quaternions_from_matrices(rotations)
    length = np.linalg.norm(q[:, :3], axis=1)
    angle = 2 * np.arctan2(length, q[:, 3])
    small = length < 1e-8  # angle / sin(angle / 2) is 2 to rounding
    factor = np.where(small, 2.0, angle / np.where(small, 1.0, length))
    return np.asarray(factor[:, None] * q[:, :3])


def inverse_left_jacobian_so3(phi: Floats) -> Floats:
    """J_l(phi)^-1 (m, 3, 3): I - [phi] / 2 + (1 - (a / 2) cot(a / 2)) / a^2 [phi]^2, a = |phi|."""
    square = np.einsum("ma,ma->m", phi, phi)
    half = np.sqrt(np.maximum(square, _SMALL**2)) / 2
    exact = (1 - half / np.tan(half)) / (4 * half**2)
    series = 1 / 12 + square / 720 + square**2 / 30240
    factor = np.where(square < _SMALL**2, series, exact)
    P = hat(phi)
    return np.asarray(np.eye(3) - P / 2 + factor[:, None, None] * (P @ P))


def log_se3(rotations: Floats, translations: Floats) -> Floats:
    """(rho, phi) (m, 6) of motions: phi = log R, rho = J_l(phi)^-1 t."""
    phi = log_so3(rotations)
    rho = np.einsum("mab,mb->ma", inverse_left_jacobian_so3(phi), translations)
    return np.hstack([rho, phi])


def inverse_right_jacobian_se3(xi: Floats) -> Floats:
    """J_r(xi)^-1 (m, 6, 6): log(T exp(d)) = log T + J_r^-1 d to first order; J_r(xi) = J_l(-xi)."""
    rho, phi = -xi[:, :3], -xi[:, 3:]
    inverse = inverse_left_jacobian_so3(phi)
    result = np.zeros((len(xi), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = inverse
    result[:, :3, 3:] = -inverse @ _mixed(rho, phi) @ inverse
    return result


def adjoint(rotations: Floats, translations: Floats) -> Floats:
    """Ad(T) (m, 6, 6): T exp(xi) = exp(Ad(T) xi) T."""
    result = np.zeros((len(rotations), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = rotations
    result[:, :3, 3:] = hat(translations) @ rotations
    return result


def _mixed(rho: Floats, phi: Floats) -> Floats:
    """Q(rho, phi), the upper right block of the left Jacobian, Barfoot's (7.86b)."""
    square = np.einsum("ma,ma->m", phi, phi)
    small = square < _SMALL**2
    a = np.sqrt(np.where(small, 1.0, square))
    sin, cos = np.sin(a), np.cos(a)
    first = np.where(small, 1 / 6 - square / 120 + square**2 / 5040, (a - sin) / a**3)
    second = np.where(
        small, 1 / 24 - square / 720 + square**2 / 40320, (a**2 + 2 * cos - 2) / (2 * a**4)
    )
    third = np.where(
        small,
        1 / 120 - square / 2520 + square**2 / 120960,
        (2 * a - 3 * sin + a * cos) / (2 * a**5),
    )
    R, P = hat(rho), hat(phi)
    PR, RP = P @ R, R @ P
    PRP = PR @ P
    return np.asarray(
        R / 2
        + first[:, None, None] * (PR + RP + PRP)
        + second[:, None, None] * (P @ PR + RP @ P - 3 * PRP)
        + third[:, None, None] * (PRP @ P + P @ PRP)
    )
