"""CSV: text with commas, and quotes around names that need them; pose family if not told otherwise.

The columns are those of `text`. A name with a blank, a comma, a semicolon, a quote or # in it
stands between double quotes, where "" is a quote (RFC 4180). Lines that begin with # are comments
where they are read; none is written, as most programs take the first line for the header.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from rotavg.base.errors import FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import AbsoluteRotations, RotationReader
from rotavg.io.fields import is_header, is_separator_line
from rotavg.io.lines import BYTE_ORDER_MARK, content_lines, is_number, not_utf8
from rotavg.io.registry import Format, ReadOptions, Writable
from rotavg.io.text import (
    SOLUTION_HEADER,
    is_edge,
    read_edges,
    read_nodes,
    read_text,
    read_text_rotations,
    write_rows,
)

_NEEDS_QUOTES = re.compile(r'[\s,;#"]')


def read_csv(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read edges from a CSV file."""
    if b'"' not in data:
        return read_text(path, data, options)
    return read_edges(path, data, csv_rows(path, data), options)


def read_csv_rotations(
    path: Path, data: bytes, columns: Sequence[str] | None = None
) -> AbsoluteRotations:
    """Read a solution."""
    if b'"' not in data:
        return read_text_rotations(path, data, columns)
    return read_nodes(path, data, csv_rows(path, data), columns)


def write_csv(path: Path, item: Writable) -> bytes:
    """The content of a CSV file of a graph or a solution."""
    _, header, rows = write_rows(path, item, ",", lambda name: _one_line(path, name))
    return f"{header}\n".encode() + rows


def csv_rows(path: Path, data: bytes) -> Iterator[tuple[int, list[bytes]]]:
    """(line number, fields) of every line that is neither blank nor a comment."""
    next(content_lines(path, data), None)  # refuses what is binary
    data = data.removeprefix(BYTE_ORDER_MARK)
    try:
        lines = data.decode().splitlines()
    except UnicodeDecodeError as error:
        number = len((data[: error.start] + b".").splitlines())
        raise not_utf8(path, data[max(0, error.start - 10) : error.start + 10], number) from None
    # Comments become blank lines, so that the reader counts them.
    content = ["" if line.lstrip().startswith("#") else line for line in lines]
    beginning = next((line for line in content if line.strip()), "")
    separator = ";" if beginning.count(";") > beginning.count(",") else ","
    reader = csv.reader(content, delimiter=separator, skipinitialspace=True, strict=True)
    try:
        for fields in reader:
            if any(fields):
                yield reader.line_num, [field.encode() for field in fields]
    except csv.Error as error:
        found = f"found no CSV: {error}"
        raise FormatError(found, path=path, line=max(1, reader.line_num)) from None


def quoted(name: str) -> str:
    """A name as it stands in a file, with quotes if it needs them."""
    return '"' + name.replace('"', '""') + '"' if _NEEDS_QUOTES.search(name) else name


def _one_line(path: Path, name: str) -> str:
    if not name or len(name.splitlines()) > 1 or name.strip("\r\n") != name:
        found = f"found a node of the name {name!r}"
        raise FormatError(f"{found}, expected one line of text", path=path)
    return quoted(name)


def _first_row(head: bytes) -> list[bytes]:
    """Fields of the first row; none where this is no CSV."""
    try:
        for _, fields in csv_rows(Path(), head[: head.rfind(b"\n") + 1] or head):
            if not is_separator_line(fields):
                return fields
    except FormatError:
        pass
    return []


def _looks_like_csv(head: bytes) -> bool:
    fields = _first_row(head)
    return len(fields) > 1 and is_edge(fields)


def _looks_like_rotations(head: bytes) -> bool:
    """Whether there are commas between five fields: no other format has both."""
    fields = _first_row(head)
    return is_header(fields, 1) or (
        len(fields) == len(SOLUTION_HEADER) and all(map(is_number, fields[1:]))
    )


CSV = Format(
    name="csv",
    suffixes=(".csv",),
    recognises=_looks_like_csv,
    read=read_csv,
    write=write_csv,
    has_isolated=False,
    any_convention=True,
    has_components=True,
    has_covariances=True,
    rotations=RotationReader((), read_csv_rotations, _looks_like_rotations, (".csv",)),
)
