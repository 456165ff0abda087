"""Measurement graphs as pandas frames, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, require
from rotavg.graph import conventions
from rotavg.graph.covariances import COVARIANCE
from rotavg.graph.ids import IdArray, as_edges, edge_error
from rotavg.graph.units import note_of_degrees

_QUATERNION = tuple(f"q{axis}" for axis in "xyzw")
_ROTVEC = tuple(f"r{axis}" for axis in "xyz")
_ROTVEC_DEG = tuple(f"r{axis}_deg" for axis in "xyz")
_MATRIX = tuple(f"r{row}{column}" for row in range(3) for column in range(3))


def arrays_from_frame(frame: Any) -> dict[str, Any]:
    """What a frame says, as the constructor of MeasurementGraph takes it."""
    if not hasattr(frame, "columns"):
        raise GraphError(f"found a {type(frame).__name__}, expected a pandas.DataFrame")
    columns = {str(column) for column in frame.columns}
    if not {"i", "j"} <= columns:
        raise GraphError(f"the frame has the columns {_list(columns)}, expected i and j among them")
    edges = as_edges([list(pair) for pair in zip(frame["i"].tolist(), frame["j"].tolist())])

    def numbers(names: tuple[str, ...]) -> NDArray[np.float64]:
        try:
            return np.stack([np.asarray(frame[name], dtype=np.float64) for name in names], axis=1)
        except (TypeError, ValueError) as error:
            raise GraphError(f"the columns {_list(names)} are no numbers: {error}") from None

    notes: tuple[str, ...] = ()
    if set(_QUATERNION) <= columns:
        quaternions = numbers(_QUATERNION)
        bad = conventions.first_bad_quaternion(quaternions)
        if bad is not None:
            raise edge_error(edges, *bad)
        rotations = conventions.matrices_from_quaternions(quaternions)
    elif set(_ROTVEC) <= columns or set(_ROTVEC_DEG) <= columns:
        degrees = not set(_ROTVEC) <= columns
        rotvecs = numbers(_ROTVEC_DEG if degrees else _ROTVEC)
        finite = np.isfinite(rotvecs).all(axis=1)
        if not finite.all():
            k = int(np.argmin(finite))
            found = f"the rotation vector is {rotvecs[k].tolist()}, expected finite numbers"
            raise edge_error(edges, k, found)
        notes = () if degrees else note_of_degrees(edges, rotvecs)
        rotations = conventions.matrices_from_rotvecs(np.radians(rotvecs) if degrees else rotvecs)
    elif set(_MATRIX) <= columns:
        rotations = numbers(_MATRIX).reshape(-1, 3, 3)
    else:
        expected = f"{_list(_QUATERNION)}, {_list(_ROTVEC)} (rx_deg ...) or r00 to r22"
        raise GraphError(f"the frame has the columns {_list(columns)}, expected {expected}")
    weights = numbers(("weight",))[:, 0] if "weight" in columns else None
    covariances = None
    if set(COVARIANCE) & columns:
        if not set(COVARIANCE) <= columns:
            found = _list(set(COVARIANCE) & columns)
            raise GraphError(f"the frame has {found}, expected all of {_list(COVARIANCE)} or none")
        covariances = np.empty((len(edges), 3, 3))
        rows, others = np.triu_indices(3)
        covariances[:, rows, others] = covariances[:, others, rows] = numbers(COVARIANCE)
    return {
        "edges": edges,
        "rotations": rotations,
        "weights": weights,
        "covariances": covariances,
        "notes": notes,
    }


def columns_of_covariances(covariances: NDArray[np.float64] | None) -> dict[str, Any]:
    """The columns of a frame that say them (m, 3, 3); none where there are none."""
    if covariances is None:
        return {}
    return dict(zip(COVARIANCE, covariances[(slice(None), *np.triu_indices(3))].T))


def frame_of_edges(
    edges: IdArray, rotations: NDArray[np.float64], further: Mapping[str, Any]
) -> Any:
    """A pandas frame of edges (m, 2), their rotations (m, 3, 3) and further columns (m,)."""
    quaternions = conventions.quaternions_from_matrices(rotations)
    columns: dict[str, Any] = {"i": edges[:, 0], "j": edges[:, 1]}
    columns.update((name, quaternions[:, k]) for k, name in enumerate(_QUATERNION))
    columns.update((name, np.array(values)) for name, values in further.items())
    return require("pandas", "pandas").DataFrame(columns)


def _list(names: Any) -> str:
    return " ".join(sorted(names)) if isinstance(names, set) else " ".join(names)
