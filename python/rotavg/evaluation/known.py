"""Absolute rotations in all the forms that people have them in: solutions, dicts, arrays, files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, IncompleteWarning
from rotavg.graph.conventions import first_no_rotation
from rotavg.graph.ids import IdArray, as_nodes
from rotavg.graph.nearest import why_row_is_no_rotation
from rotavg.graph.node_mapping import NodeMapping
from rotavg.io.absolute import AbsoluteRotations
from rotavg.io.colmap_models import is_reconstruction, of_reconstruction
from rotavg.io.rotations import read_absolute

Rotations = Union[
    ArrayLike,
    NodeMapping,
    AbsoluteRotations,
    Mapping[Any, ArrayLike],
    "tuple[Sequence[Any] | NDArray[Any], ArrayLike]",
    str,
    "os.PathLike[str]",
]


@dataclass(frozen=True, eq=False)
class Known:
    """Rotations (n, 3, 3) world_from_node.

    And where told, their ids (n,), labels of components, and COLMAP's ids of images.
    """

    rotations: NDArray[np.float64]
    nodes: IdArray | None = None
    component: NDArray[Any] | None = None
    image_ids: IdArray | None = None


def known(value: Rotations, what: str) -> Known:
    """The rotations in `value`, which errors call `what`.

    Args:
        value: a solution; a mapping from ids to matrices (3, 3); a tuple of ids and matrices
            (n, 3, 3); the path of a file that `rotavg.read_rotations` reads; a
            `pycolmap.Reconstruction`; matrices, or SciPy's `Rotation`, without ids.
        what: the name of the argument.

    Raises:
        GraphError: these are no rotations, or not as many as ids.
        FormatError: the file holds none.
    """
    if isinstance(value, (str, os.PathLike)):
        value = _of_file(value)
    elif is_reconstruction(value):
        value = of_reconstruction(value)
    if isinstance(value, AbsoluteRotations):
        found = Known(value.rotations, value.nodes, value.component, value.image_ids)
    elif isinstance(value, NodeMapping):
        label = getattr(value, "component", None)
        found = Known(value.rotations, value.graph.nodes, label)
    elif isinstance(value, Mapping):
        if not value:
            raise GraphError(f"{what}: there are no rotations to compare")
        nodes = as_nodes(list(value))
        matrices = [_matrix(matrix) for matrix in value.values()]
        found = Known(as_floats(matrices, (len(nodes), 3, 3), what), nodes)
    elif isinstance(value, tuple) and len(value) == 2 and _dimensions(value[0]) == 1:
        nodes = as_nodes(value[0])
        found = Known(as_floats(_matrix(value[1]), (len(nodes), 3, 3), what), nodes)
    else:
        matrices = _matrix(value)
        if _dimensions(matrices) == 0 or (isinstance(value, (tuple, list)) and _has_text(value)):
            raise GraphError(
                f"{what}: found {value!r:.60}, expected a solution, a mapping from ids to "
                "matrices, a pair of ids and matrices, matrices (n, 3, 3), or the path of a file"
            )
        n = len(np.atleast_1d(np.asarray(matrices, dtype=object)))
        if n == 0:
            raise GraphError(f"{what}: there are no rotations to compare")
        found = Known(as_floats(matrices, (n, 3, 3), what))
    if len(found.rotations) == 0:
        raise GraphError(f"{what}: there are no rotations to compare")
    bad = first_no_rotation(found.rotations)
    if bad is not None:
        where = f"in row {bad}" if found.nodes is None else f"of node {found.nodes[bad].item()!r}"
        raise GraphError(
            f"{what}: the matrix {where} {why_row_is_no_rotation(found.rotations, bad)}"
        )
    return found


def by_common_ids(first: Known, second: Known) -> tuple[Known, Known]:
    """The same; where one side has names of images and the other numbers, by ids of images."""
    if first.nodes is not None and second.nodes is not None:
        kinds = {first.nodes.dtype.kind == "U", second.nodes.dtype.kind == "U"}
        if len(kinds) == 2:
            return _by_image_ids(first), _by_image_ids(second)
    return first, second


def _by_image_ids(found: Known) -> Known:
    return found if found.image_ids is None else replace(found, nodes=found.image_ids)


def _of_file(path: str | os.PathLike[str]) -> AbsoluteRotations:
    found = read_absolute(path)
    for note in found.notes:
        warnings.warn(f"{os.fspath(path)}: {note}", IncompleteWarning, stacklevel=4)
    return found


def _matrix(value: Any) -> Any:
    """Matrices of SciPy's rotations; anything else as it is."""
    return value.as_matrix() if hasattr(value, "as_matrix") else value


def _has_text(value: Sequence[Any]) -> bool:
    return any(isinstance(item, str) for item in value)


def _dimensions(value: Any) -> int:
    try:
        return np.ndim(value)
    except ValueError:  # ragged
        return -1
