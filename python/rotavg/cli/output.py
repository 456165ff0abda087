"""What the commands print: one JSON object, a table, a report, an error.

Colours are left to rich: it uses them on terminals alone, and honours NO_COLOR and TERM=dumb.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

import rotavg
from rotavg.base.json_text import json_text
from rotavg.io import losses
from rotavg.io.formats import losses_of_solution
from rotavg.io.streams import STDOUT


def print_text(text: str) -> None:
    """Text on stdout. Where its reader has gone, as in `rotavg info graph.g2o | head -1`, the rest
    is lost, and that is no error; FileAccessError where it cannot be written otherwise.
    """
    if sys.stdout is None:  # it was closed before we began
        raise rotavg.FileAccessError("cannot be written: it is closed", path="standard output")
    try:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
    except OSError as error:
        # What is left in the buffer must not fail again when Python closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            reason = f"cannot be written: {error.strerror}"
            raise rotavg.FileAccessError(reason, path="standard output") from error


def beside_files(*paths: Path | None) -> AbstractContextManager[Any]:
    """Where standard output is one of these files, what else is printed goes to stderr."""
    if STDOUT not in paths:
        return nullcontext()
    return redirect_stdout(sys.stderr or io.StringIO())


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


def print_solution(solution: rotavg.Solution) -> None:
    """Print what `print(solution)` does; on terminals the verdict stands out."""
    text = Text(str(solution))
    text.highlight_regex(r"(?m)^  \w+", "dim")
    text.highlight_regex(
        r"\A(Not solved|Not certified|Solved)", "bold green" if solution.solved else "bold red"
    )
    # rich styles a group of the match by the group's name.
    text.highlight_regex(rf"(?m)^  verdict +(?P<{_verdict_style(solution.certificate)}>.+)")
    rendered = io.StringIO()
    on_terminal = sys.stdout is not None and sys.stdout.isatty()
    Console(file=rendered, force_terminal=on_terminal, highlight=False, soft_wrap=True).print(
        text, end=""
    )
    print_text(rendered.getvalue())


def _verdict_style(certificate: rotavg.Certificate | None) -> str:
    if certificate is None:
        return "none"
    return {"proved": "green", "estimated": "yellow"}.get(certificate.verdict.value, "red")


def print_error(message: str) -> None:
    """One line on stderr."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        Text.assemble(("Error:", "bold red"), " ", message)
    )


def print_notes(graph: rotavg.MeasurementGraph) -> None:
    """What the reader wants its user to know, on stderr."""
    for note in graph.notes:
        click.echo(f"note: {note}", err=True)


def print_losses(path: Path, graph: rotavg.MeasurementGraph, format: str | None = None) -> None:
    """What of the graph is not in the file that was written, on stderr."""
    for loss in losses(path, graph, format):
        click.echo(f"note: {path}: {loss}", err=True)


def print_solution_losses(path: Path, solution: rotavg.Solution, format: str | None = None) -> None:
    """What of the solution is not in the file that was written, or is made up, on stderr."""
    if solution.graph.translations is None:
        print_losses(path, solution.graph, format)
    for loss in losses_of_solution(path, solution, format):
        click.echo(f"note: {path}: {loss}", err=True)
