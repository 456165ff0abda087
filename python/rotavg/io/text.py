"""Plain text: one edge per line, pose family if not told otherwise.

    i j qx qy qz qw [weight] [cxx cxy cxz cyy cyz czz]

The fields are separated by white space, commas or semicolons, # begins a comment, and the first
line may be a header of these words. R_ij = i_from_j, so that R_i R_ij = R_j with
R_i = world_from_i. Node ids are integers if all of them are, names otherwise ("007" is a name);
names that all look like integers therefore come back as integers. Names with blanks, commas,
semicolons or # need quotes and therefore a CSV file, see `csv_text`.
A solution is written as `id qx qy qz qw`, world_from_id, and of several components with the number
of the node's at the end of the line. Other columns and rotations: see `columns`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rotavg.base.errors import FormatError
from rotavg.graph.contents import Quaternions
from rotavg.graph.conventions import first_bad_quaternion, matrices_from_quaternions
from rotavg.graph.covariances import COVARIANCE
from rotavg.graph.ids import as_edges, edge_error
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import TOLERANCE, nearest_rotation
from rotavg.io import bulk
from rotavg.io.absolute import QUATERNION, AbsoluteRotations, RotationReader, distinct, labels_of
from rotavg.io.fields import Row, Rows, is_header, is_separator_line, split, title_words
from rotavg.io.lines import content_lines, is_number, plain_name
from rotavg.io.registry import (
    Format,
    ReadOptions,
    Writable,
    blame_line,
    components_to_tell,
)
from rotavg.io.rounding import MATRIX_TOLERANCE
from rotavg.io.table import read_table

HEADER = ("i", "j", *QUATERNION, "weight")
SOLUTION_HEADER = ("id", *QUATERNION)
COMPONENT = "component"
_CONVENTION = "pose family: R_i R_ij = R_j, R_i = world_from_i, R_ij = i_from_j; quaternions xyzw"


def read_text(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read edges from lines of text; every line has a weight or none has."""
    return read_edges(path, data, None, options)


def read_edges(
    path: Path, data: bytes, rows: Rows | None, options: ReadOptions
) -> MeasurementGraph:
    """Read edges from the rows of a table; without such, from the lines of the file."""
    table = read_table(
        path,
        content_lines(path, data) if rows is None else rows,
        (HEADER[:6], HEADER),
        num_ids=2,
        title=title_words(data),
        columns=options.columns,
        data=data if rows is None else None,
    )
    with blame_line(path, table.lines):
        ids = as_edges(table.ids(path))
        quaternions = table.layout.kind == "quaternion"
        if quaternions and (bad := first_bad_quaternion(table.numbers)):
            raise edge_error(ids, *bad)
        rotations, notes = table.rotations(path)
        if table.layout.unread:
            notes += (f"columns not read: {', '.join(table.layout.unread)}",)
        return MeasurementGraph(
            ids,
            Quaternions(rotations) if quaternions else rotations,
            None if options.unit_weights else table.weights,
            **options.of_graph,
            covariances=None if options.unit_weights else table.covariances,
            notes=notes,
            tolerance=MATRIX_TOLERANCE if table.layout.kind == "matrix" else TOLERANCE,
        )


def write_rows(
    path: Path, item: Writable, separator: str, name: Callable[[str], str]
) -> tuple[str, str, bytes]:
    """What it is, the header, and one line per edge or, of a solution, per node.

    `name` spells a name. Where a solution has several components, each node's stands in the end.
    """
    header: tuple[str, ...]
    component: list[int] = []
    if isinstance(item, MeasurementGraph):
        title, header = "measurement graph", HEADER
        columns = np.column_stack([item.quaternions, item.weights])
        if item.covariances is not None:
            header += COVARIANCE
            upper = item.covariances[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
            columns = np.column_stack([columns, upper])
        ids, nodes = item.edges, item.nodes
    else:
        title, header = "rotations", SOLUTION_HEADER
        columns = np.asarray(item.quaternions, dtype=np.float64)
        ids, nodes = item.graph.nodes[:, None], item.graph.nodes
        component = components_to_tell(item)
        if component:
            header += (COMPONENT,)
    title = f"rotavg {title}, {_CONVENTION}"
    if ids.dtype == np.int64 and not component:
        return title, separator.join(header), bulk.write_rows(ids, columns, separator=separator)
    spell = {node: name(str(node)) for node in nodes.tolist()}
    nothing = np.empty((len(ids), 0), dtype=np.int64)
    numbers = bulk.write_rows(nothing, columns, separator=separator).decode().splitlines()
    lines = []
    for k, (row, text) in enumerate(zip(ids.tolist(), numbers)):
        label = [str(component[k])] if component else []
        lines.append(separator.join([*(spell[node] for node in row), text, *label]) + "\n")
    return title, separator.join(header), "".join(lines).encode()


def write_text(path: Path, item: Writable) -> bytes:
    """The content of a text file of a graph or a solution."""
    title, header, rows = write_rows(
        path, item, " ", lambda name: plain_name(path, name, in_row=True)
    )
    return f"# {title}\n# {header}\n".encode() + rows


def read_text_rotations(
    path: Path, data: bytes, columns: Sequence[str] | None = None
) -> AbsoluteRotations:
    """Read a solution."""
    return read_nodes(path, data, None, columns)


def read_nodes(
    path: Path, data: bytes, rows: Rows | None, columns: Sequence[str] | None
) -> AbsoluteRotations:
    """Read absolute rotations from the rows of a table; without such, from the lines."""
    table = read_table(
        path,
        content_lines(path, data) if rows is None else rows,
        (SOLUTION_HEADER,),
        num_ids=1,
        title=title_words(data),
        columns=columns,
        data=data if rows is None else None,
    )
    bad = first_bad_quaternion(table.numbers) if table.layout.kind == "quaternion" else None
    if bad is not None:
        raise FormatError(bad[1], path=path, line=table.lines[bad[0]])
    rotations, notes = table.rotations(path)
    quaternions = table.layout.kind == "quaternion"
    return AbsoluteRotations(
        distinct(path, table.ids(path).ravel(), table.lines),
        matrices_from_quaternions(rotations) if quaternions else nearest_rotation(rotations),
        component=None if table.components is None else labels_of(table.components),
        notes=notes,
    )


def is_edge(row: Row) -> bool:
    """Whether this row is an edge, or a header of edges."""
    fields = split(row, (6, 7), named=False)
    return (len(fields) in (6, 7) and all(map(is_number, fields[2:]))) or is_header(row, 2)


def _looks_like_edges(head: bytes) -> bool:
    """Whether the first line with something in it is an edge or a header of edges."""
    if b"\0" in head:
        return False
    for _, text in content_lines(Path(), head):
        if not is_separator_line(text):
            return is_edge(text)
    return False


def _has_solution_header(head: bytes) -> bool:
    """Whether our words for a solution's columns stand above the first line, or names in it."""
    if b"\0" in head:
        return False
    if [word.lower() for word in title_words(head)[: len(SOLUTION_HEADER)]] == [*SOLUTION_HEADER]:
        return True
    for _, text in content_lines(Path(), head):
        if not is_separator_line(text):
            return is_header(text, 1)
    return False


TEXT = Format(
    name="text",
    suffixes=(".txt", ".text"),
    recognises=_looks_like_edges,
    read=read_text,
    write=write_text,
    has_isolated=False,
    any_convention=True,
    has_components=True,
    has_covariances=True,
    rotations=RotationReader(SOLUTION_HEADER, read_text_rotations, recognises=_has_solution_header),
)
