"""Long texts at once: tables of numbers out of lines, and lines out of tables, in compiled code.

It reads only what is as usual on every line: so many fields, plain integers, decimal numbers. For
all else there is None, and the caller goes through the lines one by one, which words the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import rotavg._text as _text
from rotavg.graph.ids import IdArray
from rotavg.io.lines import BYTE_ORDER_MARK, exactly

INTEGER, NAME, NUMBER, UNREAD = "isn_"


@dataclass(frozen=True)
class Bulk:
    """The lines of one kind.

    Attributes:
        ids: (m, k) what stands in their columns of integers or, where there are none, of names.
        numbers: (m, l); finite.
        lines: (m,) the line of each row.
    """

    ids: IdArray
    numbers: NDArray[np.float64]
    lines: Sequence[int]


def read_tagged(
    data: bytes, kinds: Sequence[tuple[bytes, str]]
) -> tuple[list[Bulk], list[tuple[int, bytes]]] | None:
    """The lines of each kind, and (line number, content) of those with any other first field.

    Args:
        data: the whole text.
        kinds: first field, and what each of the others is: INTEGER, NUMBER or UNREAD.
    """
    found = _read(data, 1, " ", kinds)
    if found is None:
        return None
    tables, others = found
    return [Bulk(ids, numbers, lines.data) for ids, numbers, lines in tables], others


def read_rows(data: bytes, first: int, row: bytes, columns: str) -> Bulk | None:
    """The rows of a table that begins in line `first`, with `row`; its ids are integers or names.

    `columns` says what each column is: INTEGER, here an id of either sort, NUMBER or UNREAD.
    """
    separator = ";" if b";" in row else "," if b"," in row else " "
    for words in (columns, columns.replace(INTEGER, NAME)):
        found = _read(data, first, separator, [(b"", words)])
        if found is not None:
            ids, numbers, lines = found[0][0]
            if ids.dtype.kind == "S":
                try:
                    ids = ids.astype(np.str_)  # of ASCII alone
                except UnicodeDecodeError:
                    return None
            return Bulk(ids, numbers, lines.data)
    return None


def write_rows(
    ids: IdArray,
    numbers: NDArray[np.float64],
    *,
    tag: str = "",
    separator: str = " ",
    short_zeros: bool = False,
    end: str = "",
) -> bytes:
    """A line for each row: the tag, integers (m, k) and numbers (m, l), and the end.

    Numbers are the shortest text that reads back as the same double, as `repr` has it, but with
    `short_zeros` 0 for 0.0.
    """
    if ids.dtype == np.int64 and _text.knows_numbers:
        tag = f"{tag}{separator}" if tag else ""
        return _text.write(ids, numbers, tag, separator, short_zeros, f"{end}\n")
    start = [tag] if tag else []
    lines = []
    for row, values in zip(ids.tolist(), numbers):
        texts = ["0" if short_zeros and float(text) == 0 else text for text in exactly(values)]
        lines.append(separator.join([*start, *map(str, row), *texts]) + end + "\n")
    return "".join(lines).encode()


def _read(
    data: bytes, first: int, separator: str, kinds: Sequence[tuple[bytes, str]]
) -> (
    tuple[list[tuple[IdArray, NDArray[np.float64], NDArray[np.int64]]], list[tuple[int, bytes]]]
    | None
):
    if not _text.knows_numbers:
        return None
    skip = len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0
    return _text.read(data, first, skip, separator, kinds)
