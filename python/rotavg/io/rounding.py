"""Rotations as files have them: rounded, not normalised, or no rotations at all.

What is off by more than rounding is told, and refused beyond what any rounding explains: then it is
likely that other columns were taken for the rotation.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.nearest import TOLERANCE, orthogonality_errors, why_no_rotation

_LENGTH_WORTH_A_NOTE = 1e-3
# The length of a quaternion may be off by so much: of one decimal. Directions beside a quaternion,
# taken for it, are off by up to .41, and positions by anything.
_LENGTH_TOLERANCE = 0.1
# As `orthogonality_errors` has it: of matrices with two decimals, and three times that.
MATRIX_TOLERANCE = 0.05


def quaternion_notes(
    path: Path, quaternions: NDArray[np.float64], lines: Sequence[int]
) -> tuple[str, ...]:
    """What to tell of finite quaternions (m, 4) whose length is not 1; zero ones are passed over.

    Raises FormatError, which names the line, for the first that is too far off.
    """
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(quaternions, axis=1)
    off = np.where((quaternions == 0).all(axis=1), 0.0, np.abs(lengths - 1))
    if (off > _LENGTH_TOLERANCE).any():
        row = int(np.argmax(off > _LENGTH_TOLERANCE))
        found = f"found a quaternion of length {lengths[row]:.6g}"
        expected = "expected length 1 (are the columns in another order?)"
        raise FormatError(f"{found}, {expected}", path=path, line=lines[row])
    names = ("quaternion", "quaternions")
    return _told(off, _LENGTH_WORTH_A_NOTE, lines, names, "normalised whose length was not 1")


def is_unit(quaternion: NDArray[np.float64]) -> bool:
    """Whether this one (4,) is a rotation, but for rounding."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(abs(np.linalg.norm(quaternion) - 1) <= _LENGTH_TOLERANCE)


def matrix_notes(
    path: Path, matrices: NDArray[np.float64], lines: Sequence[int] | None
) -> tuple[str, ...]:
    """What to tell of matrices (m, 3, 3) that are replaced by the nearest rotations.

    Raises FormatError for the first that is too far off: it names the line, or where there are no
    lines, the row.
    """
    errors = orthogonality_errors(matrices)
    good = errors <= MATRIX_TOLERANCE
    if not good.all():
        row = int(np.argmin(good))
        which = "the matrix" if lines is not None else f"the matrix in row {row}"
        found = f"{which} {why_no_rotation(matrices[row], errors[row], MATRIX_TOLERANCE)}"
        raise FormatError(found, path=path, line=None if lines is None else lines[row])
    what = "replaced by the nearest rotation, as R^T R was not the identity"
    return _told(errors, TOLERANCE, lines, ("matrix", "matrices"), what)


def _told(
    off: NDArray[np.float64],
    limit: float,
    lines: Sequence[int] | None,
    names: tuple[str, str],
    what: str,
) -> tuple[str, ...]:
    """A note of how many are off by more than a limit, by how much, and where first."""
    far = off > limit
    count = int(np.count_nonzero(far))
    if not count:
        return ()
    row = int(np.argmax(far))
    place = f"in row {row}" if lines is None else f"in line {lines[row]}"
    first = "first " if count > 1 else ""
    return (f"{count} {names[count > 1]} {what} (off by up to {off.max():.3g}, {first}{place})",)
