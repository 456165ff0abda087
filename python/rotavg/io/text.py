"""Plain text: one edge per line, pose family if not told otherwise.

    i j qx qy qz qw [weight]

The fields are separated by white space or commas, # begins a comment, and the first line may be
a header of just these words. R_ij = i_from_j, so that R_i R_ij = R_j with R_i = world_from_i.
Node ids are integers if all of them are, names otherwise ("007" is a name);
names that all look like integers therefore come back as integers. Names with blanks, commas or #
need quotes and therefore a CSV file, see `csv_text`.
A solution is written as `id qx qy qz qw`, world_from_id.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import (
    QUATERNION,
    AbsoluteRotations,
    RotationReader,
    is_header,
    read_fields,
)
from rotavg.io.lines import (
    BYTE_ORDER_MARK,
    check_finite,
    content_lines,
    exactly,
    ids_of,
    is_number,
    number_table,
    plain_name,
    shown,
)
from rotavg.io.registry import Format, ReadOptions, Writable, blame_line
from rotavg.io.rounding import quaternion_notes

HEADER = ("i", "j", *QUATERNION, "weight")
SOLUTION_HEADER = ("id", *QUATERNION)
EXPECTED = "i j qx qy qz qw [weight]"
_CONVENTION = "pose family: R_i R_ij = R_j, R_i = world_from_i, R_ij = i_from_j; quaternions xyzw"


def read_text(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read edges from lines of text; every line has a weight or none has."""
    rows = ((line, text.split()) for line, text in content_lines(path, data.replace(b",", b" ")))
    return read_rows(path, rows, options)


def read_rows(
    path: Path, rows: Iterable[tuple[int, list[bytes]]], options: ReadOptions
) -> MeasurementGraph:
    """Read edges from (line number, fields) of every line that is neither blank nor a comment."""
    ids: list[bytes] = []
    numbers: list[bytes] = []
    lines: list[int] = []
    columns = 0
    for line, fields in rows:
        if not columns:
            columns = _columns(path, line, fields)
            if is_edge_header(fields):
                continue
        if len(fields) < 3:
            found = f"found {len(fields)} fields, expected {columns + 2}"
            raise FormatError(f"{found}: {EXPECTED}", path=path, line=line)
        ids += fields[:2]
        numbers.append(b" ".join(fields[2:]))
        lines.append(line)
    if not lines:
        raise FormatError(f"the file has no edges, expected {EXPECTED}", path=path)

    table = number_table(path, numbers, lines, columns)
    check_finite(path, table, lines)
    weights = table[:, 4] if columns == 5 and not options.unit_weights else None
    with blame_line(path, lines):
        return MeasurementGraph.from_quaternions(
            ids_of(path, ids).reshape(-1, 2),
            table[:, :4],
            weights,
            **options.of_graph,
            notes=quaternion_notes(path, table[:, :4], lines),
        )


def is_edge_header(fields: list[bytes]) -> bool:
    """Whether these are the words that name our columns."""
    return len(fields) in (6, 7) and is_header(fields, HEADER[: len(fields)])


def _columns(path: Path, line: int, fields: list[bytes]) -> int:
    """How many numbers follow the ids, going by the first line; FormatError if it is not ours."""
    if len(fields) == len(SOLUTION_HEADER):
        found = "found 5 fields: this looks like a solution (id qx qy qz qw)"
        raise FormatError(f"{found}, expected edges: {EXPECTED}", path=path, line=line)
    if len(fields) not in (6, 7):
        found = f"found {len(fields)} fields, expected 6 or 7"
        raise FormatError(f"{found}: {EXPECTED}", path=path, line=line)
    if not is_edge_header(fields) and not any(map(is_number, fields[2:])):
        found = " ".join(map(shown, fields))
        raise FormatError(f"found the header {found}, expected {EXPECTED}", path=path, line=line)
    return len(fields) - 2


def write_rows(path: Path, item: Writable, separator: str, name: Callable[[str], str]) -> list[str]:
    """Title, header and one line per edge or, of a solution, per node; `name` spells a name."""
    header: tuple[str, ...]
    if isinstance(item, MeasurementGraph):
        title, header = "measurement graph", HEADER
        quaternions = quaternions_from_matrices(item.rotations)
        columns = np.column_stack([quaternions, item.weights])
        ids, nodes = item.edges, item.nodes
    else:
        title, header = "rotations", SOLUTION_HEADER
        columns = np.asarray(item.quaternions, dtype=np.float64)
        ids, nodes = item.graph.nodes[:, None], item.graph.nodes
    spell = {node: name(str(node)) for node in nodes.tolist()}
    lines = [f"# rotavg {title}, {_CONVENTION}", separator.join(header)]
    for row, numbers in zip(ids.tolist(), columns):
        lines.append(separator.join([*(spell[node] for node in row), *exactly(numbers)]))
    return lines


def write_text(path: Path, item: Writable) -> bytes:
    """The content of a text file of a graph or a solution."""
    title, header, *rows = write_rows(path, item, " ", lambda name: plain_name(path, name))
    return "\n".join([title, f"# {header}", *rows, ""]).encode()


def read_text_rotations(path: Path, data: bytes) -> AbsoluteRotations:
    """Read a solution."""
    rows = ((line, text.split()) for line, text in content_lines(path, data.replace(b",", b" ")))
    return read_fields(path, rows, SOLUTION_HEADER, node="id")


def is_edge(fields: list[bytes]) -> bool:
    """Whether these are the fields of an edge, or our header."""
    return is_edge_header(fields) or (len(fields) in (6, 7) and all(map(is_number, fields[2:])))


def _looks_like_edges(head: bytes) -> bool:
    """Whether the first line with something in it is an edge or our header."""
    if b"\0" in head:
        return False
    for _, text in content_lines(Path(), head.replace(b",", b" ")):
        return is_edge(text.split())
    return False


def _has_solution_header(head: bytes) -> bool:
    """Whether our words for a solution's columns stand above the first line, or in it."""
    for text in head.removeprefix(BYTE_ORDER_MARK).replace(b",", b" ").splitlines():
        if is_header(text.lstrip(b"# \t").split(), SOLUTION_HEADER):
            return True
        if text.strip() and not text.lstrip().startswith(b"#"):
            return False
    return False


TEXT = Format(
    name="text",
    suffixes=(".txt", ".text"),
    recognises=_looks_like_edges,
    read=read_text,
    write=write_text,
    has_isolated=False,
    any_convention=True,
    rotations=RotationReader(SOLUTION_HEADER, read_text_rotations, recognises=_has_solution_header),
)
