"""Plain text and CSV: one edge per line, pose family.

    i j qx qy qz qw [weight]

The fields are separated by white space or commas, # begins a comment, and the first line may be
a header of just these words. R_ij = i_from_j, so that R_i R_ij = R_j with R_i = world_from_i.
Node ids are integers if all of them are, names otherwise ("007" is a name);
names that all look like integers therefore come back as integers.
A solution is written as `id qx qy qz qw`, world_from_id.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rotavg.conventions import quaternions_from_matrices
from rotavg.errors import FormatError
from rotavg.graph import MeasurementGraph
from rotavg.ids import IdArray
from rotavg.io.lines import check_finite, content_lines, exactly, is_number, number_table, shown
from rotavg.io.registry import Format, Writable, blame_line

HEADER = ["i", "j", "qx", "qy", "qz", "qw", "weight"]
SOLUTION_HEADER = ["id", "qx", "qy", "qz", "qw"]
_EXPECTED = "i j qx qy qz qw [weight]"
_CONVENTION = "pose family: R_i R_ij = R_j, R_i = world_from_i, R_ij = i_from_j; quaternions xyzw"
_NOT_IN_A_NAME = re.compile(r"[\s,#]")


def read_text(path: Path, data: bytes, unit_weights: bool) -> MeasurementGraph:
    """Read edges from lines of text; every line has a weight or none has."""
    ids: list[bytes] = []
    rows: list[bytes] = []
    lines: list[int] = []
    columns = 0
    for line, text in content_lines(path, data.replace(b",", b" ")):
        fields = text.split(None, 2)
        if not columns:
            columns = _columns(path, line, text.split())
            if _is_header(text.split()):
                continue
        if len(fields) < 3:
            found = f"found {len(fields)} fields, expected {columns + 2}"
            raise FormatError(f"{found}: {_EXPECTED}", path=path, line=line)
        ids += fields[:2]
        rows.append(fields[2])
        lines.append(line)
    if not lines:
        raise FormatError(f"the file has no edges, expected {_EXPECTED}", path=path)

    table = number_table(path, rows, lines, columns)
    check_finite(path, table, lines)
    weights = table[:, 4] if columns == 5 and not unit_weights else None
    with blame_line(path, lines):
        return MeasurementGraph.from_quaternions(_ids(path, ids), table[:, :4], weights)


def _is_header(fields: list[bytes]) -> bool:
    words = [field.decode(errors="replace").lower() for field in fields]
    return len(words) >= 6 and words == HEADER[: len(words)]


def _columns(path: Path, line: int, fields: list[bytes]) -> int:
    """How many numbers follow the ids, going by the first line; FormatError if it is not ours."""
    if len(fields) == len(SOLUTION_HEADER):
        found = "found 5 fields: this looks like a solution (id qx qy qz qw)"
        raise FormatError(f"{found}, expected edges: {_EXPECTED}", path=path, line=line)
    if len(fields) not in (6, 7):
        found = f"found {len(fields)} fields, expected 6 or 7"
        raise FormatError(f"{found}: {_EXPECTED}", path=path, line=line)
    if not _is_header(fields) and not any(map(is_number, fields[2:])):
        found = " ".join(map(shown, fields))
        raise FormatError(f"found the header {found}, expected {_EXPECTED}", path=path, line=line)
    return len(fields) - 2


def _ids(path: Path, fields: list[bytes]) -> IdArray:
    ids: IdArray
    try:
        integers = list(map(int, fields))
        if b" ".join(fields) == " ".join(map(str, integers)).encode():
            ids = np.array(integers, dtype=object)
            return ids.reshape(-1, 2)
    except ValueError:
        pass
    try:
        ids = np.array([field.decode() for field in fields])
    except UnicodeDecodeError as error:
        raise FormatError(f"the names are not UTF-8: {error}", path=path) from None
    return ids.reshape(-1, 2)


def _write(path: Path, item: Writable, separator: str, header_line: bool) -> bytes:
    if isinstance(item, MeasurementGraph):
        title, header = "measurement graph", HEADER
        quaternions = quaternions_from_matrices(item.rotations)
        columns = np.column_stack([quaternions, item.weights])
        ids = item.edges.tolist()
        nodes = item.nodes
    else:
        title, header = "rotations", SOLUTION_HEADER
        columns = np.asarray(item.quaternions, dtype=np.float64)
        ids = [[node] for node in item.graph.nodes.tolist()]
        nodes = item.graph.nodes
    if nodes.dtype.kind == "U":
        for name in nodes.tolist():
            if not name or _NOT_IN_A_NAME.search(name):
                found = f"found a node of the name {name!r}"
                raise FormatError(f"{found}, expected no blank, comma or # in it", path=path)
    lines = [
        f"# rotavg {title}, {_CONVENTION}",
        ("" if header_line else "# ") + separator.join(header),
    ]
    lines += [separator.join([*map(str, row), *exactly(q)]) for row, q in zip(ids, columns)]
    return ("\n".join(lines) + "\n").encode()


def _looks_like_edges(head: bytes) -> bool:
    """Whether the first line with something in it is an edge or our header."""
    if b"\0" in head:
        return False
    for _, text in content_lines(Path(), head.replace(b",", b" ")):
        fields = text.split()
        return _is_header(fields) or (len(fields) in (6, 7) and all(map(is_number, fields[2:])))
    return False


def _has_commas(head: bytes) -> bool:
    return _looks_like_edges(head) and any(
        b"," in line.partition(b"#")[0] for line in head.splitlines()
    )


TEXT = Format(
    name="text",
    suffixes=(".txt", ".text"),
    recognises=_looks_like_edges,
    read=read_text,
    write=lambda path, item: _write(path, item, separator=" ", header_line=False),
)
CSV = Format(
    name="csv",
    suffixes=(".csv",),
    recognises=_has_commas,
    read=read_text,
    write=lambda path, item: _write(path, item, separator=",", header_line=True),
)
