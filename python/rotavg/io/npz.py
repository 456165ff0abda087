"""NumPy's npz: arrays as they are, pose family; nothing is unpickled.

A graph is `edges` (m, 2) and `rotations` (m, 3, 3), also known as `relative_rotations`, with
`weights` (m,), `nodes` (n,), `covariances` (m, 3, 3), and of a pose graph `translations` (m, 3)
with their `translation_information` and `cross_information` (m, 3, 3) and the `dimension` of space
(2 or 3), if need be. A solution says so in `kind` and holds
`nodes`, `edges`, `rotations` (n, 3, 3), `quaternions` (n, 4) xyzw, its figures, and, if they were
computed, `covariances` (n, 3, 3). A graph with known rotations has `ground_truth` (n, 3, 3), and if
need be `has_ground_truth` (n,), which rows of it are known.
"""

from __future__ import annotations

import enum
import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.ids import IdArray, as_edges, as_ids, unique_ids
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import nearest_rotation, orthogonality_errors
from rotavg.graph.translations import RelativeTranslations
from rotavg.io.absolute import AbsoluteRotations, RotationReader, distinct
from rotavg.io.registry import Format, ReadOptions, Writable, blame_line
from rotavg.io.rounding import MATRIX_TOLERANCE, matrix_notes

_FIGURES = (
    "objective", "gradient_norm", "status", "iterations", "component", "residual_angles",
    "edge_weights", "certificate.verdict", "certificate.lambda_min", "certificate.gap",
    "certificate.relative_gap", "certificate.method", "certificate.failure_probability",
    "positions", "chi2",
)  # fmt: skip
# RuntimeError: there is a password, or a compression that Python does not know.
_UNREADABLE = (
    ValueError, OSError, EOFError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error
)  # fmt: skip


def read_npz(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read a graph from an npz archive."""
    arrays = _arrays(path, data)
    if str(arrays.pop("kind", "graph")) == "solution":
        expected = "expected a graph: arrays edges and rotations (m, 3, 3)"
        raise FormatError(f"the archive holds a solution, {expected}", path=path)
    found = ", ".join(arrays) or "none"
    edges = arrays.pop("edges", None)
    rotations = arrays.pop("relative_rotations", None)
    if rotations is None:
        rotations = arrays.pop("rotations", None)
    if edges is None or rotations is None:
        expected = "expected edges and rotations (or relative_rotations)"
        raise FormatError(f"found the arrays {found}, {expected}", path=path)
    weights, nodes = arrays.pop("weights", None), arrays.pop("nodes", None)
    vectors = arrays.pop("translations", None)
    information = arrays.pop("translation_information", None)
    covariances = arrays.pop("covariances", None)
    cross, dimension = arrays.pop("cross_information", None), arrays.pop("dimension", 3)
    notes: tuple[str, ...] = ()
    if arrays:
        notes += (f"arrays not read: {', '.join(arrays)}",)
    with blame_line(path):
        translations = None
        if vectors is not None:
            translations = RelativeTranslations(
                vectors, information, cross=cross, dimension=_dimension(dimension)
            )
        ids = as_edges(edges)
        matrices = as_floats(rotations, (len(ids), 3, 3), "rotations")
        notes += matrix_notes(path, matrices, None)
        if translations is not None and options.convention == "vision":
            raise FormatError("translations are read in the pose family only", path=path)
        return MeasurementGraph(
            ids,
            matrices,
            None if options.unit_weights else weights,
            nodes,
            **options.of_graph,
            covariances=None if options.unit_weights else covariances,
            translations=translations,
            notes=notes,
            tolerance=MATRIX_TOLERANCE,
        )


def _dimension(value: Any) -> int:
    """The number in an array of one; RelativeTranslations refuses any but 2 and 3."""
    array = np.asarray(value)
    return int(array) if array.shape == () and array.dtype.kind in "iu" else 0


def read_npz_rotations(path: Path, data: bytes) -> AbsoluteRotations:
    """Read a solution, or what a graph's archive holds as `ground_truth`."""
    arrays = _arrays(path, data)
    is_solution = str(arrays.get("kind", "graph")) == "solution"
    if not is_solution and "ground_truth" in arrays:
        return _ground_truth(path, arrays)
    if not {"nodes", "rotations"} <= arrays.keys():
        found = f"found the arrays {', '.join(arrays) or 'none'}"
        expected = "expected nodes (n,) and rotations (n, 3, 3), or ground_truth (n, 3, 3)"
        raise FormatError(f"{found}, {expected}", path=path)
    if "edges" in arrays and not is_solution:
        raise FormatError("found a graph, expected absolute rotations", path=path)
    nodes = distinct(path, arrays["nodes"])
    component = arrays.get("component")
    if component is not None and component.shape != nodes.shape:
        found = f"component has shape {component.shape}"
        raise FormatError(f"{found}, expected a label for each node", path=path)
    rotations, notes = _of_nodes(path, nodes, "rotations", arrays["rotations"])
    return AbsoluteRotations(nodes, rotations, component, notes=notes)


def _ground_truth(path: Path, arrays: dict[str, Any]) -> AbsoluteRotations:
    """The rows that are known, of the nodes as `read_npz` has them."""
    nodes = arrays.get("nodes")
    if nodes is None and "edges" in arrays:
        with blame_line(path):
            nodes = unique_ids(as_ids(arrays["edges"], "edges"))
    if nodes is None:
        nodes = np.arange(len(np.atleast_1d(arrays["ground_truth"])))
    nodes = distinct(path, nodes)
    known = arrays.get("has_ground_truth", np.ones(len(nodes), dtype=np.bool_))
    if known.dtype != np.bool_ or known.shape != nodes.shape:
        found = f"has_ground_truth is {known.dtype} of shape {known.shape}"
        raise FormatError(f"{found}, expected a bool for each of {len(nodes)} nodes", path=path)
    truth = arrays["ground_truth"]
    if truth.shape[:1] == nodes.shape:  # what is not known may be NaN
        truth, nodes = truth[known], nodes[known]
    rotations, notes = _of_nodes(path, nodes, "ground_truth", truth)
    return AbsoluteRotations(nodes, rotations, notes=notes)


def _of_nodes(
    path: Path, nodes: IdArray, name: str, values: Any
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """The array of this name as a rotation of each node, and what to tell of it."""
    try:
        rotations = as_floats(values, (len(nodes), 3, 3), name)
    except GraphError as error:
        raise FormatError(f"{error}, one for each node", path=path) from None
    good = orthogonality_errors(rotations) <= MATRIX_TOLERANCE
    if not good.all():
        node = nodes[int(np.argmin(good))].item()
        found = f"{name} of node {node!r} is no rotation"
        expected = f"expected a matrix that is one to {MATRIX_TOLERANCE:g}"
        raise FormatError(f"{found}, {expected}", path=path)
    notes = matrix_notes(path, rotations, None)
    return (nearest_rotation(rotations) if notes else rotations), notes


def _arrays(path: Path, data: bytes) -> dict[str, Any]:
    """All arrays by name; FormatError if this is no archive."""
    if not _is_archive(data):  # NumPy would read a single array, and offer to unpickle the rest
        raise FormatError("found no npz archive, expected one as numpy.savez makes it", path=path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except _UNREADABLE as error:
        raise FormatError(f"found no readable npz archive: {error}", path=path) from error


def _is_archive(head: bytes) -> bool:
    return head.startswith((b"PK\x03\x04", b"PK\x05\x06"))  # the latter without arrays


def write_npz(path: Path, item: Writable) -> bytes:
    """The content of an npz archive of a graph or a solution."""
    arrays: dict[str, Any]
    if isinstance(item, MeasurementGraph):
        arrays = {
            "edges": item.edges,
            "rotations": item.rotations,
            "weights": item.weights,
            "nodes": item.nodes,
        }
        if item.translations is not None:
            arrays["translations"] = item.translations.vectors
            arrays["translation_information"] = item.translations.information
            if item.translations.cross is not None:
                arrays["cross_information"] = item.translations.cross
            if item.translations.dimension == 2:
                arrays["dimension"] = np.array(2)
        if item.covariances is not None:
            arrays["covariances"] = item.covariances
    else:
        arrays = {
            "kind": "solution",
            "nodes": item.graph.nodes,
            "edges": item.graph.edges,
            "rotations": item.rotations,
            "quaternions": item.quaternions,
        }
        for name in _FIGURES:
            value = _figure(item, name)
            if value is not None:
                arrays[name.replace(".", "_")] = value
        covariances = _figure(item, "known_covariances")
        if covariances is not None:
            arrays["covariances"] = covariances
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _figure(solution: Any, name: str) -> Any:
    """A figure of a solution as an array or number or str; None if it has none such."""
    value = solution
    for part in name.split("."):
        value = getattr(value, part, None)
    if isinstance(value, enum.Enum):
        value = value.name.lower()
    simple = np.asarray(value) if value is not None else None
    return simple if simple is not None and simple.dtype.kind in "biufU" else None


NPZ = Format(
    name="npz",
    suffixes=(".npz",),
    recognises=_is_archive,
    read=read_npz,
    write=write_npz,
    any_convention=True,
    has_components=True,
    has_covariances=True,
    has_translations=True,
    rotations=RotationReader((), read_npz_rotations, _is_archive, (".npz",)),
)
