"""The lines of a pose graph's file, tag by tag, as tables of numbers that were checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import first_bad_quaternion
from rotavg.graph.ids import IdArray
from rotavg.io import bulk
from rotavg.io.dialects import G2O_3D, Dialect
from rotavg.io.lines import check_finite, integer, number_table, shown
from rotavg.io.rounding import quaternion_notes


@dataclass
class Lines:
    """The lines of one tag: ids, the text after them, and the line numbers.

    Lines that were read at once have their numbers (m, k) as `table`, and no text.
    """

    ids: Sequence[int] = field(default_factory=list)
    rows: list[bytes] = field(default_factory=list)
    lines: Sequence[int] = field(default_factory=list)
    table: NDArray[np.float64] | None = None

    def add(self, path: Path, line: int, fields: list[bytes], num_ids: int) -> None:
        """Keep a line: its tag, `num_ids` ids and the rest; FormatError for another."""
        assert isinstance(self.ids, list)
        assert isinstance(self.lines, list)
        self.ids += integers(path, line, fields[1 : 1 + num_ids])
        if len(fields) < 2 + num_ids:
            found = f"found only {len(fields) - 1} values after {shown(fields[0])}"
            raise FormatError(f"{found}, the line is truncated", path=path, line=line)
        self.rows.append(fields[-1])
        self.lines.append(line)

    def id_array(self) -> IdArray:
        """All ids, in one row."""
        return np.array(self.ids, dtype=object if isinstance(self.ids, list) else np.int64)

    def numbers(self, path: Path, columns: int) -> NDArray[np.float64]:
        """The numbers (m, columns) of the lines; FormatError that names one with others."""
        if self.table is not None:
            return self.table
        return number_table(path, self.rows, self.lines, columns)


def read_at_once(
    data: bytes, kinds: Sequence[tuple[bytes, int, int]]
) -> tuple[list[Lines], list[tuple[int, bytes]]] | None:
    """The lines of each kind, and all others; None where they have to be read one by one.

    Args:
        data: the whole content.
        kinds: tag, number of ids, number of numbers after them.
    """
    found = bulk.read_tagged(
        data, [(tag, bulk.INTEGER * ids + bulk.NUMBER * count) for tag, ids, count in kinds]
    )
    if found is None:
        return None
    tables, others = found
    return [Lines(t.ids.ravel().data, [], t.lines, t.numbers) for t in tables], others


def integers(path: Path, line: int, fields: list[bytes]) -> list[int]:
    """Node ids; FormatError that names the line if they are none."""
    try:
        return list(map(integer, fields))
    except ValueError:
        found = " ".join(map(shown, fields))
        raise FormatError(
            f"found {found} for node ids, expected integers", path=path, line=line
        ) from None


def check_fixed(
    path: Path,
    dialect: Dialect,
    vertices: Lines,
    given: NDArray[np.float64],
    fixed: dict[int, int],
) -> None:
    """FormatError that names the line of a vertex that is fixed, but has no pose to keep."""
    held = [k for k, node in enumerate(vertices.ids) if node in fixed]
    lines = [vertices.lines[k] for k in held]
    check_finite(path, given[held], lines, dialect.words)
    if dialect is not G2O_3D:
        return
    turns = given[held, dialect.dimension :]
    bad = first_bad_quaternion(turns)
    if bad is not None:
        node = vertices.ids[held[bad[0]]]
        found = f"vertex {node} is fixed (line {fixed[node]}), but {bad[1]}"
        raise FormatError(found, path=path, line=lines[bad[0]])
    quaternion_notes(path, turns, lines)


def edge_table(
    path: Path, dialect: Dialect, edges: Lines, unit_weights: bool
) -> NDArray[np.float64]:
    """The finite numbers (m, k) of the edges; with unit weights they may lack the information."""
    if edges.table is not None:
        return edges.table
    counts = {len(row.split()) for row in edges.rows}
    if counts == {dialect.num_pose}:
        if not unit_weights:
            found = f"found {dialect.num_pose} numbers after the ids, no information"
            expected = f"expected {dialect.num_pose + len(dialect.order)}"
            hint = "(read with unit weights, --unit-weights, where there is none)"
            message = f"{found}, {expected} {hint}"
            raise FormatError(message, path=path, line=edges.lines[0])
        columns = dialect.num_pose
    else:
        columns = dialect.num_pose + len(dialect.order)
    rows = edges.rows
    if unit_weights and counts == {dialect.num_pose, columns}:  # some have it: nobody reads it
        columns = dialect.num_pose
        rows = [b" ".join(row.split()[:columns]) for row in rows]
    table = number_table(path, rows, edges.lines, columns)
    read = table[:, : dialect.num_pose] if unit_weights else table
    check_finite(path, read, edges.lines, dialect.words)
    return table
