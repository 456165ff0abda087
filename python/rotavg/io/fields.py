"""The fields of a row of a table, and what may be the names of its columns."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from typing import Union

from rotavg.io.columns import Layout, layout_of
from rotavg.io.lines import is_number, lines_of

Row = Union[bytes, "list[bytes]"]  # as it stands, or its fields
Rows = Iterable["tuple[int, Row]"]  # with line numbers


def split(row: Row, counts: Collection[int], *, named: bool) -> list[bytes]:
    """The fields of a row, of which there should be so many; empty ones only of `named` columns."""
    if isinstance(row, list):  # a name in quotes may begin with a blank
        fields = list(row)
    elif b";" in row:
        fields = [field.strip() for field in row.split(b";")]
    elif b"," in row:
        fields = [field.strip() for field in row.split(b",")]
    else:
        return row.split()  # none of them is empty
    while fields and len(fields) > max(counts) and not fields[-1].strip():
        fields.pop()
    if isinstance(row, list) or b";" in row:
        return fields
    if len(fields) in counts and (named or all(fields)):
        return fields
    return row.replace(b",", b" ").split()


def title_words(data: bytes) -> list[str]:
    """The words of the comment just above the first line that is none; none where there is none."""
    words: list[str] = []
    for text in lines_of(data):
        text = text.strip()
        if text.startswith(b"#"):
            comment = text.lstrip(b"# \t").decode(errors="replace")
            words = comment.replace(",", " ").replace(";", " ").split()
        elif text:
            return words
    return words


def header_words(row: Row) -> list[list[str]]:
    """What the words of a header may be: none of its fields is a number."""
    ways = [split(row, {1}, named=True)]
    if isinstance(row, bytes):
        separator = b";" if b";" in row else b","
        ways = [[f.strip() for f in row.split(separator)], row.replace(b",", b" ").split()]
    for fields in ways:
        while fields and not fields[-1]:  # the lines end in a separator
            fields.pop()
    ways = [fields for fields in ways if not any(map(is_number, fields))]
    return [[f.decode(errors="replace").strip("\"' ") for f in fields] for fields in ways]


def is_header(row: Row, num_ids: int) -> bool:
    """Whether this row names the columns of a table."""
    return header_of(row, num_ids) is not None


def says_something(row: Row) -> bool:
    """Whether there is more than separators, as below the rows of a spreadsheet."""
    return any(row) if isinstance(row, list) else bool(row.strip(b",; \t\r\f\v"))


def is_separator_line(row: Row) -> bool:
    """Whether this is the line (sep=;) that tells spreadsheets the separator."""
    text = b";".join(row) if isinstance(row, list) else row.strip()
    return re.fullmatch(rb"sep=.?[,;]*", text, re.IGNORECASE) is not None


def header_of(row: Row, num_ids: int) -> Layout | None:
    """The layout that this row says, if it names the columns of a table."""
    for words in header_words(row):
        layout = layout_of(words, num_ids)
        if layout is not None:
            return layout
    return None
