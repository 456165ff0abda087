"""Tables of rotations in text: which column is what, the numbers of all rows, and their lines.

Between the fields of a row stand semicolons, commas or blanks. Where a line has semicolons, a comma
in a number is a decimal point. The columns are as the caller says, as a header says (a first line
of names, or the comment just above the first row), or else as the format has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.ids import IdArray
from rotavg.graph.units import TURN, beyond_a_turn
from rotavg.io import bulk
from rotavg.io.columns import EXPECTED, Layout, layout_of
from rotavg.io.fields import (
    Row,
    Rows,
    header_of,
    is_header,
    is_separator_line,
    says_something,
    split,
)
from rotavg.io.lines import (
    check_finite,
    ids_of,
    is_number,
    number_table,
    shown,
)
from rotavg.io.rounding import matrix_notes, quaternion_notes

DEGREES_HINT = "of degrees name the columns rx_deg, ry_deg, rz_deg"


@dataclass(frozen=True)
class Table:
    """The rows of a table.

    Attributes:
        layout: which column is what.
        fields: (m k) the fields with node ids, k for each row, or these as an array (m, k).
        numbers: (m, ...) of the rotations; finite.
        weights: (m,); None without such a column.
        components: (m,) labels; None without such a column.
        covariances: (m, 3, 3); None without such columns.
        lines: (m,) the line of each row.
    """

    layout: Layout
    fields: list[bytes] | IdArray
    numbers: NDArray[np.float64]
    weights: NDArray[np.float64] | None
    components: list[bytes] | None
    covariances: NDArray[np.float64] | None
    lines: Sequence[int]

    def ids(self, path: Path) -> IdArray:
        """Node ids (m, k); FormatError if they are neither integers nor UTF-8."""
        if isinstance(self.fields, np.ndarray):
            return self.fields
        return ids_of(path, self.fields, self.lines).reshape(len(self.lines), -1)

    def rotations(self, path: Path) -> tuple[NDArray[np.float64], tuple[str, ...]]:
        """The rotations (m, 3, 3), or of quaternions these (m, 4), and what to tell of them.

        They are as they stand in the file, matrices at most `rounding.MATRIX_TOLERANCE` off.
        Raises FormatError for what is no rotation, but for a quaternion of zeros.
        """
        if self.layout.kind == "quaternion":
            notes = quaternion_notes(path, self.numbers, self.lines)
            return self.numbers, notes
        if self.layout.kind == "matrix":
            matrices = self.numbers.reshape(-1, 3, 3)
            return matrices, matrix_notes(path, matrices, self.lines)
        return self._of_vectors(path)

    def _of_vectors(self, path: Path) -> tuple[NDArray[np.float64], tuple[str, ...]]:
        vectors = np.radians(self.numbers) if self.layout.degrees else self.numbers
        with np.errstate(over="ignore"):
            length = np.linalg.norm(vectors, axis=1)
        far = length > TURN
        names = ("rotation vector", "rotation vectors")
        odd = None if self.layout.degrees else beyond_a_turn(length, vectors, names)
        if far.any():
            row = int(np.argmax(far))
            size = np.degrees(length[row]) if self.layout.degrees else length[row]
            found = f"found a rotation vector of length {size:.6g}"
            expected = "expected degrees, at most 360"
            if odd is not None:
                expected = f"expected radians, at most 2 pi ({odd[1]}; {DEGREES_HINT})"
            raise FormatError(f"{found}, {expected}", path=path, line=self.lines[row])
        notes: tuple[str, ...] = ()
        if odd is not None:
            notes = (f"{odd[1]}, first in line {self.lines[odd[0]]}: {DEGREES_HINT}",)
        return matrices_from_rotvecs(vectors), notes


def read_table(
    path: Path,
    rows: Rows,
    usual: Sequence[tuple[str, ...]],
    *,
    num_ids: int,
    title: Sequence[str] = (),
    columns: Sequence[str] | None = None,
    data: bytes | None = None,
) -> Table:
    """Read the table.

    Args:
        path: the file, for errors.
        rows: all lines that are neither blank nor a comment.
        usual: the columns that the format has, each with another number of them.
        num_ids: how many node ids a row has.
        title: the words in the comment just above the first row.
        columns: what the columns are, whatever the file says.
        data: the whole content where these are its lines, so that it may be read at once.

    Raises FormatError, which names the line.
    """
    expected = " ".join(usual[0]) + "".join(f" [{word}]" for word in usual[-1][len(usual[0]) :])
    layout: Layout | None = None
    fields: list[list[bytes]] = []
    lines: list[int] = []
    told = columns is not None
    if columns is not None:
        layout = layout_of(columns, num_ids)
        if layout is None:
            found = f"columns are {' '.join(columns)}"
            raise FormatError(f"{found}, expected {EXPECTED}, each once", path=path)
    first = True
    for line, row in rows:
        separated = isinstance(row, list) or b"," in row or b";" in row
        if separated and not says_something(row):
            continue
        if first:
            if is_separator_line(row):
                continue
            first = False
            here = header_of(row, num_ids)
            if here is not None:
                layout, told = layout or here, True
                continue
            if layout is None:
                layout, told = _by_title(row, title, num_ids)
            layout = layout or _usual(path, line, row, usual, num_ids, expected)
        assert layout is not None
        if data is not None and isinstance(row, bytes):
            table = _at_once(data, line, row, layout)
            if table is not None:
                return table
            data = None
        if separated or isinstance(row, list):
            found_here = split(row, (len(layout.words),), named=told)
        else:
            found_here = row.split()
        if len(found_here) != len(layout.words):
            raise _wrong_count(path, line, len(found_here), layout, num_ids, told, expected)
        fields.append(found_here)
        lines.append(line)
    if not lines:
        what = "edges" if num_ids == 2 else "rotations"
        raise FormatError(f"the file has no {what}, expected {expected}", path=path)
    assert layout is not None
    return _table(path, fields, lines, layout)


def _at_once(data: bytes, line: int, row: bytes, layout: Layout) -> Table | None:
    """The table whose first row this is; None where a line is not as most are."""
    if layout.component is not None:
        return None
    kinds = [bulk.UNREAD] * len(layout.words)
    for place in layout.ids:
        kinds[place] = bulk.INTEGER
    for place in layout.numbers:
        kinds[place] = bulk.NUMBER
    found = bulk.read_rows(data, line, row, "".join(kinds))
    if found is None:
        return None
    numbers = _in_order(found.numbers, layout.numbers)
    return _of_numbers(layout, _in_order(found.ids, layout.ids), numbers, None, found.lines)


def _in_order(columns: NDArray[Any], places: Sequence[int]) -> NDArray[Any]:
    """The columns (m, k) found in rising order of their places, in the order of these."""
    order = np.argsort(np.argsort(places))
    return columns if (order == np.arange(len(places))).all() else columns[:, order]


def _by_title(row: Row, title: Sequence[str], num_ids: int) -> tuple[Layout | None, bool]:
    layout = layout_of(title, num_ids)
    if layout is None or len(split(row, {len(title)}, named=True)) != len(title):
        return None, False
    return layout, True


def _usual(
    path: Path,
    line: int,
    row: Row,
    usual: Sequence[tuple[str, ...]],
    num_ids: int,
    expected: str,
) -> Layout:
    """The format's own layout of as many columns as the first row has; FormatError without one."""
    counts = [len(words) for words in usual]
    fields = split(row, counts, named=False)
    if len(fields) > 2 and not any(map(is_number, fields)):
        found = f"found the header {' '.join(map(shown, fields))}"
        if num_ids == 2 and is_header(row, 1):
            found = f"{found}: this looks like a solution (id and a rotation)"
            raise FormatError(f"{found}, expected edges: {expected}", path=path, line=line)
        hint = f"in a header {EXPECTED}; or say what the columns are (--columns)"
        raise FormatError(f"{found}, expected {expected}; {hint}", path=path, line=line)
    for words in usual:
        if len(words) == len(fields):
            layout = layout_of(words, num_ids)
            assert layout is not None
            return layout
    what = f"{' or '.join(map(str, counts))}: {expected}" if num_ids == 2 else expected
    found = f"found {len(fields)} field{'s' * (len(fields) != 1)}"
    if num_ids == 2 and len(fields) == 5:
        found, what = f"{found}: this looks like a solution (id qx qy qz qw)", f"edges: {expected}"
    elif num_ids == 2 and len(fields) > 2:
        what += "; or a header, or --columns, that says what the columns are"
    raise FormatError(f"{found}, expected {what}", path=path, line=line)


def _wrong_count(
    path: Path,
    line: int,
    here: int,
    layout: Layout,
    num_ids: int,
    told: bool,
    expected: str,
) -> FormatError:
    count = len(layout.words)
    found = f"found {here} field{'s' * (here != 1)}"
    if told:
        message = f"{found}, expected {' '.join(layout.words)}"
    elif num_ids == 1:
        message = f"{found}, expected {expected}"
    elif here < 3:
        message = f"{found}, expected {count}: {expected}"
    else:
        message = f"found {here - 2} numbers after the ids, expected {count - 2}"
    return FormatError(message, path=path, line=line)


def _table(path: Path, fields: list[list[bytes]], lines: list[int], layout: Layout) -> Table:
    places = layout.numbers
    columns = [[row[place] for row in fields] for place in places]
    for place, column in zip(places, columns):
        if not all(column) or not all(map(bytes.strip, column)):
            row = next(k for k, field in enumerate(column) if not field.strip())
            message = f"{layout.words[place]} is empty, expected a number"
            raise FormatError(message, path=path, line=lines[row])
    numbers = [row.replace(b",", b".") for row in map(b" ".join, zip(*columns))]
    table = number_table(path, numbers, lines, len(places))
    check_finite(path, table, lines, [layout.words[place] for place in places])
    label = layout.component
    return _of_numbers(
        layout,
        [row[place] for row in fields for place in layout.ids],
        table,
        None if label is None else [row[label] for row in fields],
        lines,
    )


def _of_numbers(
    layout: Layout,
    ids: list[bytes] | IdArray,
    numbers: NDArray[np.float64],
    components: list[bytes] | None,
    lines: Sequence[int],
) -> Table:
    """The table whose numbers (m, k) stand as `layout.numbers` says."""
    size = len(layout.rotation)
    upper = numbers[:, size : size + len(layout.covariance)]
    return Table(
        layout=layout,
        fields=ids,
        numbers=numbers[:, :size],
        weights=None if layout.weight is None else numbers[:, -1],
        components=components,
        covariances=_symmetric(upper) if layout.covariance else None,
        lines=lines,
    )


def _symmetric(upper: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 3, 3) from upper triangles (m, 6), row by row."""
    return upper[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
