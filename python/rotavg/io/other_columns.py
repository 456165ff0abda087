"""The columns of a table of edges, if its rotations were meant otherwise than they are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rotavg.io.columns import Layout, layout_of
from rotavg.io.fields import header_of, is_header, says_something, split, title_words
from rotavg.io.lines import content_lines

_LAST = ("qx", "qy", "qz", "qw")


def w_first_columns(data: bytes, columns: Sequence[str] | None) -> str | None:
    """The columns of a table of edges, with the w of its quaternions first instead of last.

    None where it is not last: then it was said, or there are no quaternions.
    """
    layout = _layout_in(data, columns)
    if layout is None or layout.kind != "quaternion":
        return None
    x, y, z, w = layout.rotation
    if (y, z, w) != (x + 1, x + 2, x + 3):
        return None
    names = _names_read(layout)
    names[x : w + 1] = [_LAST[3], *_LAST[:3]]
    return ",".join(names)


def degree_columns(data: bytes, columns: Sequence[str] | None) -> str | None:
    """The columns of a table of edges with rotation vectors, but with these in degrees.

    None where there are no such, or it was said.
    """
    layout = _layout_in(data, columns)
    if layout is None or layout.kind != "rotation vector" or layout.degrees:
        return None
    names = _names_read(layout)
    for place, axis in zip(layout.rotation, "xyz"):
        names[place] = f"r{axis}_deg"
    return ",".join(names)


def _layout_in(data: bytes, columns: Sequence[str] | None) -> Layout | None:
    """What the columns of a table of edges are taken for."""
    row = next((text for _, text in content_lines(Path(), data) if says_something(text)), b"")
    words = list(columns or title_words(data))
    if is_header(row, 2):
        # What the columns are said to be holds for what a header names otherwise.
        return layout_of(list(columns), 2) if columns else header_of(row, 2)
    layout = layout_of(words, 2)
    fields = split(row, (6, 7), named=False)
    if layout is None or len(words) != len(fields):
        usual = ["i", "j", *_LAST, "weight"][: len(fields)]
        layout = layout_of(usual, 2) if len(usual) == len(fields) else None
    return layout


def _names_read(layout: Layout) -> list[str]:
    """Of all columns; _ of those that are not read."""
    read = {*layout.ids, *layout.numbers}
    return [word if k in read else "_" for k, word in enumerate(layout.words)]
