"""NumPy's npz: arrays as they are, pose family; nothing is unpickled.

A graph is `edges` (m, 2) and `rotations` (m, 3, 3), also known as `relative_rotations`, with
`weights` (m,), `nodes` (n,), and of a pose graph `translations` (m, 3) with their
`translation_information` (m, 3, 3), if need be. A solution says so in `kind` and holds `nodes`,
`edges`, `rotations` (n, 3, 3), `quaternions` (n, 4) xyzw, its figures, and, if they were computed,
`covariances` (n, 3, 3).
"""

from __future__ import annotations

import enum
import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from rotavg.errors import FormatError
from rotavg.graph import MeasurementGraph
from rotavg.io.registry import Format, ReadOptions, Writable, blame_line
from rotavg.translations import RelativeTranslations

_FIGURES = (
    "objective", "gradient_norm", "status", "iterations", "component", "residual_angles",
    "edge_weights", "certificate.verdict", "certificate.lambda_min", "certificate.gap",
    "certificate.relative_gap", "certificate.method",
)  # fmt: skip


def read_npz(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read a graph from an npz archive."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("it holds a single array")
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise FormatError(f"found no readable npz archive: {error}", path=path) from error
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
    notes = (f"arrays not read: {', '.join(arrays)}",) if arrays else ()
    with blame_line(path):
        translations = None if vectors is None else RelativeTranslations(vectors, information)
        if translations is not None and options.convention == "vision":
            raise FormatError("translations are read in the pose family only", path=path)
        return MeasurementGraph(
            edges,
            rotations,
            None if options.unit_weights else weights,
            nodes,
            convention=options.convention,
            translations=translations,
            notes=notes,
        )


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
    recognises=lambda head: head.startswith(b"PK\x03\x04"),
    read=read_npz,
    write=write_npz,
    any_convention=True,
)
