"""A graph of measured poses with information matrices, whatever file they are from; pose family."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.contents import Source
from rotavg.graph.conventions import first_bad_quaternion, matrices_from_quaternions
from rotavg.graph.covariances import not_used, of_information, symmetric
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.translations import RelativeTranslations, first_not_positive_definite
from rotavg.io.g2o_write import kappa
from rotavg.io.places import Places
from rotavg.io.registry import ReadOptions
from rotavg.io.rounding import MATRIX_TOLERANCE, quaternion_notes

Floats = NDArray[np.float64]


def turned(path: Path, places: Places, quaternions: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Rotations (m, 3, 3) of finite quaternions xyzw (m, 4), and what to tell of these.

    FormatError for the first that is no rotation.
    """
    bad = first_bad_quaternion(quaternions)
    if bad is not None:
        raise places.error(path, *bad)
    try:
        notes = quaternion_notes(path, quaternions, places.lines or range(1, len(quaternions) + 1))
    except FormatError as error:
        if places.lines:
            raise
        row = (error.line or 1) - 1
        with np.errstate(over="ignore"):
            length = float(np.linalg.norm(quaternions[row]))
        reason = f"found a quaternion of length {length:.6g}, expected length 1"
        raise places.error(path, row, reason) from None
    return matrices_from_quaternions(quaternions), notes


def inverse(path: Path, covariances: Floats, places: Places) -> Floats:
    """Information (m, d, d) of covariances; FormatError for the first that is none."""
    scale = np.sqrt(np.abs(np.einsum("maa->ma", covariances)))
    scale[scale == 0] = 1  # units of length must not matter
    unit = covariances / (scale[:, :, None] * scale[:, None, :])
    asymmetry = np.abs(unit - np.swapaxes(unit, 1, 2)).max(axis=(1, 2))
    bad = (np.linalg.eigvalsh(unit)[:, 0] <= 1e-13) | (asymmetry > 1e-6)
    if bad.any():
        row = int(np.argmax(bad))
        reason = "the covariance is not positive definite"
        if asymmetry[row] > 1e-6:
            reason = "the covariance is not symmetric"
        raise places.error(path, row, reason)
    with np.errstate(over="ignore", divide="ignore"):
        found = np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :])
    finite = np.isfinite(found).all(axis=(1, 2))
    if not finite.all():
        raise places.error(path, int(np.argmin(finite)), "the covariance is too small to invert")
    return symmetric(found)


def in_space(information: Floats) -> Floats:
    """Information (m, 6, 6), translation first, of that about poses in the plane (m, 3, 3).

    Of what the plane does not know, z counts like x and y, and all turns like that about z.
    """
    result = np.zeros((len(information), 6, 6))
    plane = np.array([0, 1, 5])
    result[:, plane[:, None], plane] = information
    result[:, 2, 2] = (information[:, 0, 0] + information[:, 1, 1]) / 2
    result[:, 3, 3] = result[:, 4, 4] = information[:, 2, 2]
    return result


def measured_poses(
    path: Path,
    places: Places,
    edges: Sequence[tuple[Any, Any]],
    rotations: Floats,
    vectors: Floats,
    information: Floats,
    options: ReadOptions,
    *,
    dimension: int = 3,
    nodes: ArrayLike | None = None,
    notes: tuple[str, ...] = (),
    source: Source | None = None,
) -> MeasurementGraph:
    """The graph of measured poses i_from_j.

    Args:
        path: the file, for errors.
        places: of the measurements in it.
        edges: m pairs of ids.
        rotations: (m, 3, 3).
        vectors: (m, 3).
        information: (m, 6, 6), translation first. Where there is none about a rotation, the edge is
            not used.
        options: what the user asks for.
        dimension: 2 where all is in the plane.
        nodes: (n,) ids; None for those in the edges.
        notes: what is known so far to tell.
        source: what is kept of the file.
    """
    about = information[:, 3:, 3:]
    nothing = (about == 0).all(axis=(1, 2))
    weights = np.where(nothing, 0.0, kappa(np.where(nothing[:, None, None], np.eye(3), about)))
    covariances: Floats | None = None
    if options.unit_weights:
        weights = np.ones(len(edges))
    elif np.isnan(weights).any():
        row = int(np.argmax(np.isnan(weights)))
        raise places.error(
            path, row, "the rotation part of the information matrix is not positive definite"
        )
    elif dimension == 3:
        covariances, bad_row = of_information(about, ~nothing)
        if bad_row is not None:
            notes += (not_used(places.name(bad_row)),)
    translations = None
    if vectors.any():
        omega = information[:, :3, :3]
        bad = first_not_positive_definite(omega)
        if bad is None:
            cross = information[:, :3, 3:]
            translations = RelativeTranslations(
                vectors, omega, cross=cross if cross.any() else None, dimension=dimension
            )
        else:
            why = "the information about them is not positive definite"
            notes += (f"translations not used: {why} (edge {bad})",)
    try:
        return MeasurementGraph(
            edges,
            rotations,
            weights,
            nodes,
            covariances=covariances,
            translations=translations,
            source=source,
            notes=notes,
            tolerance=MATRIX_TOLERANCE,
            **options.of_graph,
        )
    except GraphError as error:
        if error.edge is None:
            raise FormatError(str(error), path=path) from error
        raise places.error(path, error.edge, str(error)) from error
