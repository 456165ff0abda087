"""The front door to absolute rotations in files: solutions, references, starting points."""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError, IncompleteWarning
from rotavg.graph.conventions import Convention, convert_family
from rotavg.graph.ids import IdArray
from rotavg.io import registry
from rotavg.io.absolute import AbsoluteRotations
from rotavg.io.csv_text import read_csv_rotations
from rotavg.io.formats import FORMATS, TABLES, table_format, words_of
from rotavg.io.lines import content_lines
from rotavg.io.registry import HEAD_SIZE, Format

FORMATS_OF_ROTATIONS = tuple(form for form in FORMATS if form.rotations)


class FileRotations(NamedTuple):
    """What `read_rotations` found; it unpacks as (nodes, rotations).

    Attributes:
        nodes: (n,) ids, in the order of the file.
        rotations: (n, 3, 3) world_from_node.
    """

    nodes: IdArray
    rotations: NDArray[np.float64]


def read_rotations(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    convention: Convention | None = None,
    image_ids: bool = False,
    columns: str | Sequence[str] | None = None,
) -> FileRotations:
    """Read absolute rotations.

    Args:
        path: a file in one of the formats of docs/formats.md that hold rotations; told by its
            content or, failing that, by its name. Where two formats fit, none is guessed. Or the
            folder of a COLMAP model, whose images.bin is read, or else its images.txt.
        format: the name of a format, to leave nothing to be told.
        convention: the family of the rotations, "pose" or "vision", where the format leaves that
            open: text, csv and npz, "pose" by default.
        image_ids: of COLMAP's images.txt or images.bin take IMAGE_ID for ids, not NAME.
        columns: what the columns of a text or CSV file are that has no header to say so, such as
            "id,qw,qx,qy,qz", as in `rotavg.read`.

    Returns:
        `nodes` (n,) and `rotations` (n, 3, 3), world_from_node, as a named tuple.

    Warns:
        IncompleteWarning: quaternions were not of length 1, or matrices a little off.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds no rotations, or may be in several formats; the message names the
            line and the reason.
    """
    found = read_absolute(
        path, format=format, convention=convention, image_ids=image_ids, columns=columns
    )
    for note in found.notes:
        warnings.warn(f"{path}: {note}", IncompleteWarning, stacklevel=2)
    return FileRotations(found.nodes, found.rotations)


def read_absolute(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    convention: Convention | None = None,
    image_ids: bool = False,
    columns: str | Sequence[str] | None = None,
) -> AbsoluteRotations:
    """Rotations world_from_node with all that the file says of their nodes; see above."""
    path = registry.in_folder(FORMATS, Path(path))
    data = registry.read_bytes(FORMATS, path, "absolute rotations")
    if columns is not None and format is None:
        form = table_format(path, data)
    else:
        form = _told(path, data) if format is None else registry.named(FORMATS_OF_ROTATIONS, format)
    assert form.rotations is not None
    family = form.family(path, convention)
    if columns is None:
        found = form.rotations.read(path, data)
    elif form in TABLES:
        found = read_csv_rotations(path, data, words_of(columns))
    else:
        message = f"columns are given, and {form.name} has its own: expected them for text or csv"
        raise FormatError(message, path=path)
    nodes = found.image_ids if image_ids else found.nodes
    if nodes is None:
        raise FormatError(f"{form.name} has no image ids, COLMAP's models alone have", path=path)
    return dataclasses.replace(
        found, nodes=nodes, rotations=convert_family(found.rotations, family)
    )


def _told(path: Path, data: bytes) -> Format:
    """The format that the content tells beyond doubt, or failing that the name."""
    for form in FORMATS_OF_ROTATIONS:
        if form.rotations and form.rotations.recognises(data[:HEAD_SIZE]):
            return form
    for form in FORMATS_OF_ROTATIONS:
        if form.rotations and registry.is_named(path, form.rotations.suffixes):
            return form
    for line, text in content_lines(path, data):
        raise _untold(path, line, len(text.split()))
    raise FormatError("the file has no rotations", path=path)


def _untold(path: Path, line: int, count: int) -> FormatError:
    """What to say of a first line of so many fields that could be anything."""
    readings = {
        form.name: " ".join(form.rotations.columns)
        for form in FORMATS_OF_ROTATIONS
        if form.rotations
    }
    found = f"found {count} fields" if count > 1 else "found 1 field"
    fitting = {name: words for name, words in readings.items() if len(words.split()) == count}
    shown = [
        f"{name} ({words})" if words else name for name, words in (fitting or readings).items()
    ]
    if not fitting:
        message = f"{found}, expected absolute rotations: {', '.join(shown)}"
        return FormatError(message, path=path, line=line)
    header = f'begin with the line "# {readings["text"]}", or ' if "text" in fitting else ""
    return FormatError(
        f"{found}, which may be {' or '.join(shown)}, but nothing tells: {header}say the format "
        "(rotavg compare: --format, --reference-format; Python: format=)",
        path=path,
        line=line,
    )
