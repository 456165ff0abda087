"""What notebooks show."""

from __future__ import annotations

from collections.abc import Iterable


def table(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """An HTML table of names and texts under a title."""
    import html  # its table of entities takes long to load

    cells = "".join(
        f"<tr><th style='text-align: left'>{html.escape(name)}</th>"
        f"<td style='text-align: left'>{html.escape(text)}</td></tr>"
        for name, text in rows
    )
    caption = f"<caption style='text-align: left'><b>{html.escape(title)}</b></caption>"
    return f"<table>{caption}{cells}</table>"
