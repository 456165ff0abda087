"""Matrices that are a little off a rotation: how far, and the rotation nearest to each."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError
from rotavg.graph.ids import IdArray, edge_error

_IN_CACHE = 20_000  # matrices
TOLERANCE = 1e-3  # of the core: beyond it a matrix is no rotation unless more is asked for


def orthogonality_errors(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) largest entry of |M^T M - I| of matrices (m, 3, 3); infinite for NaN and det < 0."""
    errors = np.empty(len(matrices))
    for start in range(0, len(matrices), _IN_CACHE):
        some = slice(start, start + _IN_CACHE)
        errors[some] = _orthogonality_errors(matrices[some])
    return errors


def _orthogonality_errors(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    # Entry by entry: matrix products and determinants of many small matrices take much longer.
    M = np.ascontiguousarray(np.moveaxis(matrices, 0, 2))
    error = np.zeros(len(matrices))
    with np.errstate(all="ignore"):  # of huge and of denormal entries
        for a in range(3):
            for b in range(a, 3):
                inner = M[0, a] * M[0, b] + M[1, a] * M[1, b] + M[2, a] * M[2, b]
                np.maximum(error, np.abs(inner - (a == b)), out=error)  # a NaN stays
        volume = (
            M[0, 0] * (M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1])
            + M[0, 1] * (M[1, 2] * M[2, 0] - M[1, 0] * M[2, 2])
            + M[0, 2] * (M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0])
        )
    error[~np.isfinite(error) | (volume < 0)] = np.inf
    return error


def nearest_rotation(matrices: ArrayLike, *, tolerance: float = 0.1) -> NDArray[np.float64]:
    """Nearest rotations (..., 3, 3), in the Frobenius norm, to matrices that are a little off.

    Say, of matrices that were printed with three decimals. U diag(1, 1, det(U V^T)) V^T of the
    singular value decomposition (Arun, Huang and Blostein 1987; Umeyama 1991).

    Args:
        matrices: (..., 3, 3).
        tolerance: the largest entry of |M^T M - I| that is taken for a rotation's.

    Raises:
        GraphError: a matrix is further off, a reflection, or not finite; the message names the
            first such.
    """
    shape = np.shape(matrices)
    if len(shape) < 2 or shape[-2:] != (3, 3):
        raise GraphError(f"matrices have shape {shape}, expected (..., 3, 3)")
    given = as_floats(matrices, shape, "matrices").reshape(-1, 3, 3)
    errors = orthogonality_errors(given)
    good = errors <= tolerance
    if not good.all():
        row = int(np.argmin(good))
        raise GraphError(f"matrix {row} {why_no_rotation(given[row], errors[row], tolerance)}")
    return np.asarray(_core.nearest_rotation(given)).reshape(shape)


def why_no_rotation(matrix: NDArray[np.float64], error: float, tolerance: float) -> str:
    """What is wrong with a matrix (3, 3) of this orthogonality error, after "the matrix"."""
    if not np.isfinite(matrix).all():
        return "holds a NaN or an infinity"
    with np.errstate(over="ignore"):
        found = float(np.linalg.det(matrix))
    if np.isinf(error) and found < 0:
        return f"is not a rotation: its determinant is {found:.6g} (a reflection); expected +1"
    return (
        f"is not a rotation: R^T R differs from the identity by {error:.6g}; "
        f"expected at most {tolerance:g}"
    )


def why_row_is_no_rotation(matrices: NDArray[np.float64], row: int) -> str:
    """The same of one of several matrices (n, 3, 3) that are to be rotations as they are."""
    error = orthogonality_errors(matrices[row : row + 1])
    return why_no_rotation(matrices[row], float(error[0]), TOLERANCE)


def projected(
    edges: IdArray,
    rotations: NDArray[np.float64],
    number: NDArray[np.int64],
    tolerance: float,
) -> NDArray[np.float64]:
    """The rotations nearest to matrices that the core would find too far off."""
    errors = orthogonality_errors(rotations)
    bad = ~(errors <= tolerance)
    if bad.any():
        k = int(np.argmax(bad))
        reason = f"the matrix {why_no_rotation(rotations[k], errors[k], tolerance)}"
        raise edge_error(edges, int(number[k]), reason)
    off = errors > TOLERANCE
    if not off.any():
        return rotations
    result = rotations.copy()
    result[off] = _core.nearest_rotation(rotations[off])
    return result
