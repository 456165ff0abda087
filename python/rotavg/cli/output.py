"""What the commands print: one JSON object, a table, a report, an error, a line of progress.

Colours are left to rich: it uses them on terminals alone, and honours NO_COLOR and TERM=dumb.
"""

from __future__ import annotations

import io
import math
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Optional

import click
from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

import rotavg
from rotavg.base.json_text import json_text
from rotavg.io import losses
from rotavg.io.formats import losses_of_solution

Callback = Optional[Callable[[rotavg.Progress], None]]


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


@contextmanager
def working(on: str) -> Iterator[None]:
    """Say on stderr, for as long as it lasts, what is worked on; only where that is a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    with Console(stderr=True).status(Text(on)):
        yield


@contextmanager
def progress(
    tolerance: float = 1e-9, stop: str = "gradient", certify: bool = True
) -> Iterator[Callback]:
    """A callback that shows on stderr how far the solver is; None where that is no terminal.

    How far: by how many of the orders of magnitude that the gradient (or step) has to fall.
    """
    if not sys.stderr.isatty():
        yield None
        return
    columns = (SpinnerColumn(), BarColumn(20), TextColumn("{task.description}"))
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        first, shown = 0.0, 0.0

        def show(p: rotavg.Progress) -> None:
            nonlocal first, shown
            now = p.relative_gradient if stop == "gradient" else p.step
            if p.iteration == 0:  # there is no step yet
                first, shown = 0.0, 0.0
            first = max(first, now)
            if now <= tolerance and p.iteration > 0:
                then = "certifying" if certify else "converged"
                bar.update(task, description=then, completed=1.0)
            elif p.seconds - shown >= 0.1:
                shown = p.seconds
                text = (
                    f"iteration {p.iteration}, objective {p.objective:.9g}, "
                    f"relative gradient {p.relative_gradient:.1e}, {p.seconds:.1f} s"
                )
                bar.update(task, description=text, completed=_fraction(first, now, tolerance))

        yield show


def _fraction(first: float, now: float, last: float) -> float:
    """How far `now` is on the way from `first` down to `last`, in orders of magnitude."""
    if not (first > now > 0 and last > 0):
        return 0.0
    return min(1.0, math.log(first / now) / math.log(first / last))
