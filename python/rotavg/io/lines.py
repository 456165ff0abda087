"""Files of lines with fields between white space; shared by the formats that are made so."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.ids import IdArray

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_BLOCK = 1 << 16
_SHOWN = 40  # characters of a field
_IN_NUMBERS = b"0123456789+-.eE \t\v\f\r\n" + b"infatyINFATY"
_NOT_IN_A_NAME = re.compile(r"[\s,#]")
_NOT_IN_A_ROW = re.compile(r"[\s,;#]")


def content_lines(path: Path, data: bytes) -> Iterator[tuple[int, bytes]]:
    """(line number from 1, content) of every line that is neither blank nor a comment (#).

    LF, CRLF and CR end a line. Raises FormatError for binary data.
    """
    zero = data.find(b"\0")
    if zero >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise FormatError("the file is binary, expected lines of text", path=path, line=line)
    for line, text in enumerate(lines_of(data), start=1):
        if b"#" in text:
            text = text.partition(b"#")[0]
        if text and not text.isspace():
            yield line, text


def lines_of(data: bytes) -> Iterator[bytes]:
    """All lines, without a mark before the first; of a long text no more at once than needed."""
    begin = len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0
    while begin < len(data):
        end = data.find(b"\n", begin + _BLOCK) + 1 or len(data)
        yield from data[begin:end].splitlines()
        begin = end


def number_table(
    path: Path, rows: Sequence[bytes], lines: Sequence[int], columns: int
) -> NDArray[np.float64]:
    """The numbers (m, columns) in `rows`, none of them blank, read from these lines of the file.

    Raises FormatError for the first row that has more or fewer, or something else than numbers.
    """
    try:
        # numpy takes blanks of all scripts for blanks, other readers do not.
        if not any(row.translate(None, _IN_NUMBERS) for row in rows):
            table = np.loadtxt(rows, dtype=np.float64, comments=None, ndmin=2)
            if table.shape[1] == columns:
                return table
    except ValueError:
        pass
    for row, line in zip(rows, lines):  # something is wrong: look where
        fields = row.split()
        for field in fields:
            if not is_number(field):
                raise FormatError(f"found {shown(field)}, expected a number", path=path, line=line)
        if len(fields) != columns:
            found = f"found {len(fields)} numbers after the ids"
            raise FormatError(f"{found}, expected {columns}", path=path, line=line)
    raise FormatError("found something else than numbers between blanks", path=path)


def check_finite(
    path: Path, table: NDArray[np.float64], lines: Sequence[int], names: Sequence[str] = ()
) -> None:
    """FormatError that names line and column if a row of `table` (m, k) has NaN or an infinity.

    `names` are those of the columns; without such they are counted.
    """
    finite = np.isfinite(table).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        column = int(np.argmin(np.isfinite(table[row])))
        place = f"number {column + 1} of {table.shape[1]}" if not names else names[column]
        found = f"found {table[row, column]}, expected a finite number ({place})"
        raise FormatError(found, path=path, line=lines[row])


def is_number(field: bytes) -> bool:
    """Whether this is a number to everyone (Python alone takes 1_000)."""
    try:
        float(field)
    except ValueError:
        return False
    return b"_" not in field


def integer(field: str | bytes) -> int:
    """An integer as everyone spells it (Python alone takes 1_000, and digits of all scripts).

    ValueError for anything else.
    """
    text = field.decode() if isinstance(field, bytes) else field
    if not text.isascii() or "_" in text:
        raise ValueError(text)
    return int(text)


def comma_fields(path: Path, line: int, text: str) -> list[str]:
    """The fields of a line of CSV, commas or else semicolons between them, without blanks."""
    separator = ";" if ";" in text and "," not in text else ","
    try:
        return [field.strip() for field in next(csv.reader([text], delimiter=separator), [])]
    except csv.Error as error:
        raise FormatError(f"found no CSV: {error}", path=path, line=line) from None


def shown(field: bytes) -> str:
    """A field as it can be printed in a message, cut short if it is long."""
    text = field.decode("utf-8", errors="replace")
    return repr(text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "...")


def exactly(row: NDArray[np.float64]) -> list[str]:
    """Each number as the shortest text that reads back as the same double."""
    return list(map(repr, row.tolist()))


def ids_of(path: Path, fields: Sequence[bytes], lines: Sequence[int]) -> IdArray:
    """Node ids (k,): integers if all fields are such and spelt as usual, names otherwise.

    Raises FormatError for a name that is not UTF-8; as many fields each are from these lines.
    """
    try:
        integers = list(map(int, fields))
        if b" ".join(fields) == " ".join(map(str, integers)).encode():
            return np.array(integers, dtype=object)
    except ValueError:
        pass
    names = []
    for k, field in enumerate(fields):
        try:
            names.append(field.decode())
        except UnicodeDecodeError:
            line = lines[k * len(lines) // len(fields)]
            raise not_utf8(path, field, line) from None
    return np.array(names)


def not_utf8(path: Path, text: bytes, line: int) -> FormatError:
    """The error that says so; the text is shown as it would be in the most common other coding."""
    name = text.decode("latin-1")
    name = name if len(name) <= _SHOWN else name[: _SHOWN - 3] + "..."
    found = f"found {name!r} in another coding than UTF-8 (Latin-1, perhaps)"
    return FormatError(f"{found}, expected UTF-8", path=path, line=line)


def plain_name(path: Path, name: str, *, in_row: bool = False) -> str:
    """The name as it can stand between blanks; FormatError if it would not come back as it is.

    Rows of our own layouts (`in_row`) may be divided by semicolons.
    """
    if not name or (_NOT_IN_A_ROW if in_row else _NOT_IN_A_NAME).search(name):
        found = f"found a node of the name {name!r}"
        refused = "blank, comma, semicolon or #" if in_row else "blank, comma or #"
        hint = "(csv and npz hold any name)"
        raise FormatError(f"{found}, expected no {refused} in it {hint}", path=path)
    return name
