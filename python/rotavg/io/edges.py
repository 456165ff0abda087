"""What a solution says of every edge, as CSV for spreadsheets and scripts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from rotavg.base.errors import FormatError, expect
from rotavg.graph.ids import IdArray
from rotavg.io import atomic, registry
from rotavg.io.csv_text import csv_rows, quoted
from rotavg.io.fields import is_separator_line
from rotavg.io.lines import content_lines
from rotavg.solving.solution import Solution

HEADER = ("i", "j", "residual_deg", "weight", "final_weight", "is_outlier", "verdict")


def write_edges(path: str | os.PathLike[str], solution: Solution) -> None:
    """Write one line for every edge, in the order of the graph, under a header.

    The columns: the ids; the residual angle in degrees; the weight as given and as it was in the
    end; 1 for an outlier, else 0; the verdict (`Solution.edge_verdicts`).

    Raises FileAccessError if the file cannot be written; what was there before is untouched.
    """
    expect(solution, Solution)
    rows = zip(
        *solution.graph.edges.T.tolist(),
        np.degrees(solution.residual_angles).tolist(),
        solution.graph.weights.tolist(),
        solution.edge_weights.tolist(),
        solution.is_outlier.astype(int).tolist(),
        solution.edge_verdicts.tolist(),
    )
    _write(path, HEADER, rows)


def write_edge_list(path: str | os.PathLike[str], edges: IdArray) -> None:
    """Write the ids (k, 2) of edges, a line each, under a header; errors as in `write_edges`."""
    _write(path, HEADER[:2], edges.tolist())


def read_edge_list(
    path: str | os.PathLike[str], column: str
) -> tuple[list[tuple[str, str]], list[int]]:
    """Read the ids, as text, of the edges in a file: I J on every line, or a table of edges.

    A table is CSV whose header names the columns i and j, as `write_edges` makes it. If it has the
    column `column`, those edges are taken which have 1, true or yes there. Names and comments are
    as in graphs of the format csv.

    Returns the ids of each edge, and the line of each.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds something else; the message names the line.
    """
    path = Path(path)
    edges: list[tuple[str, str]] = []
    lines: list[int] = []
    header: list[str] | None = None
    for line, fields in _fields(path, registry.read_bytes((), path, "a list of edges")):
        if header is None and not edges and is_separator_line([f.encode() for f in fields]):
            continue
        names = [field.lower() for field in fields]
        if header is None and not edges and {"i", "j"} <= set(names):
            header = names
            continue
        if header is not None and len(fields) != len(header):
            found = f"found {len(fields)} fields, expected {len(header)} as in the header"
            raise FormatError(found, path=path, line=line)
        if len(fields) < 2:
            raise FormatError(f"found {fields[0]!r}, expected I J", path=path, line=line)
        row = dict(zip(header or ("i", "j"), fields))
        chosen = row.get(column, "1").lower()
        if chosen not in ("1", "0", "true", "false", "yes", "no"):
            found = f"found {chosen!r} in the column {column}, expected 1 or 0"
            raise FormatError(found, path=path, line=line)
        if chosen in ("1", "true", "yes"):
            edges.append((row["i"], row["j"]))
            lines.append(line)
    return edges, lines


def _fields(path: Path, data: bytes) -> Iterator[tuple[int, list[str]]]:
    """(line number, fields) of every line that is neither blank nor a comment."""
    if b'"' in data and (b"," in data or b";" in data):
        for line, row in csv_rows(path, data):
            yield line, [field.decode().strip() for field in row]
        return
    for line, text in content_lines(path, data):
        words = text.decode(errors="replace").strip()
        separator = next((c for c in ",;" if c in words), None)
        yield line, [field.strip() for field in words.split(separator)]


def _write(
    path: str | os.PathLike[str], header: tuple[str, ...], rows: Iterable[Iterable[object]]
) -> None:
    lines = [",".join(header)]
    for row in rows:
        lines.append(",".join(quoted(v) if isinstance(v, str) else repr(v) for v in row))
    atomic.write_files({Path(path): "\n".join([*lines, ""]).encode()})
