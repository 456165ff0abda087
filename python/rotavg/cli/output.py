"""What the commands print: one JSON object, a table, a line of progress."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Callable, Optional

import click
from rich.console import Console
from rich.table import Table

import rotavg
from rotavg.json_text import json_text

Callback = Optional[Callable[[rotavg.Progress], None]]


def print_text(text: str) -> None:
    """Text on stdout. Where its reader has gone, as in `rotavg info graph.g2o | head -1`, the rest
    is lost, and that is no error.
    """
    try:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        # What is left in the buffer must not fail again when Python closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_json(value: dict[str, Any]) -> None:
    """One JSON object on stdout."""
    print_text(json_text(value))


def print_table(rows: Iterable[tuple[str, str]]) -> None:
    """Names and values on stdout."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    with console.capture() as capture:
        console.print(table, markup=False)
    print_text("\n".join(line.rstrip() for line in capture.get().splitlines()))


def print_notes(graph: rotavg.MeasurementGraph) -> None:
    """What the reader wants its user to know, on stderr."""
    for note in graph.notes:
        click.echo(f"note: {note}", err=True)


@contextmanager
def progress() -> Iterator[Callback]:
    """A callback that keeps one line of progress on stderr; None where that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    with Console(stderr=True).status("starting") as line:
        shown = 0.0

        def show(p: rotavg.Progress) -> None:
            nonlocal shown
            if p.seconds - shown >= 0.1:
                shown = p.seconds
                line.update(
                    f"iteration {p.iteration}, objective {p.objective:.9g}, "
                    f"relative gradient {p.relative_gradient:.1e}, {p.seconds:.1f} s"
                )

        yield show
