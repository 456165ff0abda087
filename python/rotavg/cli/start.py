"""Where `rotavg solve` starts: a name, or a file of rotations."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import click
import numpy as np
from click.shell_completion import CompletionItem
from numpy.typing import NDArray

import rotavg
from rotavg.cli import options
from rotavg.graph.ids import rows_of
from rotavg.io import read_rotations
from rotavg.solving.solve import Init
from rotavg.solving.warm_start import warm_start

_NAMES = get_args(Init)


class NameOrFile(click.Choice):  # type: ignore[type-arg]
    """One of a few words, which come first, or the path of a file."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | Path:
        """The word, or the path; usage error for neither."""
        if isinstance(value, Path) or value in self.choices:
            return value  # type: ignore[no-any-return]
        path: Path = options.INPUT.convert(value, param, ctx)
        if not value or not path.exists():
            words = ", ".join(self.choices)
            self.fail(f"{value!r} is not one of {words}, nor a file that is there", param, ctx)
        return path

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """The words that begin so, else files."""
        words = super().shell_complete(ctx, param, incomplete)
        return words or options.PATH.shell_complete(ctx, param, incomplete)


init_option = click.option(
    "--init",
    type=NameOrFile(_NAMES),
    metavar=f"[{'|'.join(_NAMES)}|FILE]",
    default="auto",
    show_default=True,
    help="Initial value; or a file of rotations to start from, such as an earlier solution: nodes "
    "that it lacks are placed by the edges. A file named as a word: ./chordal.",
)


def read_start(graph: rotavg.MeasurementGraph, path: Path) -> NDArray[np.float64]:
    """Rotations (n, 3, 3) of all nodes, from those in a file, world_from_node.

    What does not match is counted and told on stderr.
    """
    ids, rotations = read_rotations(path)
    start = warm_start(graph, ids, rotations, what=str(path))
    found = int((rows_of(graph.nodes, ids) >= 0).sum())
    for count, total, what in (
        (len(ids) - found, len(ids), "nodes are not in the graph"),
        (graph.num_nodes - found, graph.num_nodes, "nodes of the graph are not in it"),
    ):
        if count > 0:
            click.echo(f"note: {path}: {count} of {total} {what}", err=True)
    return start
