"""`rotavg images`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np
import rich.progress
from rich.console import Console

import rotavg
from rotavg.base.errors import require
from rotavg.cli import options
from rotavg.cli.command import Command
from rotavg.cli.options import number
from rotavg.cli.output import print_json, print_notes, print_table
from rotavg.images.features import find_photographs
from rotavg.images.pipeline import Measurement, Progress, measure
from rotavg.io import FORMATS, check_writable
from rotavg.io.atomic import check_writable as check_file_writable
from rotavg.io.registry import by_suffix

_SHOWN = 20  # pairs that failed; --json has all of them


@click.command(
    cls=Command,
    short_help="Measure relative rotations of photographs.",
    groups={
        "Output": ("output", "unit_weights", "database", "as_json"),
        "Photographs": ("focal", "max_size", "max_features"),
        "Matching": ("ratio", "max_error", "min_inliers", "seed"),
    },
)
@click.argument("folder", type=options.PATH)
@click.option(
    "-o", "--output", type=options.PATH, required=True, help="A .txt, .csv or .npz file: a graph."
)
@click.option(
    "--focal", type=float, metavar="PIXELS", help="Focal length.  [default: from the EXIF data]"
)
@number("--max-size", int, 1600, "Reduce larger photographs to this many pixels.")
@number("--max-features", int, 8192, "Keep this many features of a photograph.")
@number("--ratio", float, 0.8, "Nearest to second nearest feature: the ratio test.")
@number("--max-error", float, 1.0, "Of an inlier, distance to its epipolar line in pixels.")
@number("--min-inliers", int, 15, "A pair with fewer gets no edge.")
@number("--seed", int, 0, "The same seed gives the same graph.")
@click.option("--unit-weights", is_flag=True, help="Weight 1, not the number of inliers.")
@click.option(
    "--database",
    type=options.PATH,
    help="Also write a COLMAP database of features and matches: a new file.",
)
@options.as_json
def images(
    folder: Path,
    output: Path,
    unit_weights: bool,
    database: Path | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Measure the relative rotations of all pairs of photographs in FOLDER.

    The file names are the nodes of the graph, the numbers of inliers its weights. Needs OpenCV,
    Pillow and SciPy: pip install "rotavg[images]".

    \b
    Examples:
      rotavg images photographs -o graph.txt
      rotavg images photographs -o graph.npz --focal 1520 --database photographs.db
      rotavg solve graph.txt -o rotations.txt
    """
    _check_output(folder, output)
    if database is not None:
        _check_database(database)
    with progress() as report:
        measured = measure(folder, progress=report, **settings)
    if database is not None:
        from rotavg.colmap import create_database

        create_database(database, measured)
    if as_json:
        print_json(_summary(measured))
    else:
        _print(measured)
    graph = measured.graph
    if unit_weights:
        graph = graph.with_weights(np.ones(graph.num_edges))
    rotavg.write(output, graph)
    if not as_json:
        print_notes(graph)
        click.echo(f"wrote {output}: {graph.num_nodes} nodes, {graph.num_edges} edges", err=True)


def _check_output(folder: Path, output: Path) -> None:
    """Whether the output can be written, and its format can hold the names: before the work."""
    check_writable(output)
    names = [path.name for path in find_photographs(folder)]
    chain = list(zip(names, names[1:]))
    form = by_suffix(FORMATS, output, to_write=True)
    if form.write is not None:
        form.write(output, rotavg.MeasurementGraph(chain, [np.eye(3)] * len(chain)))


def _check_database(database: Path) -> None:
    check_file_writable(database)
    require("pycolmap", "colmap")
    if database.exists():
        raise rotavg.FileAccessError("there is a file already", path=database)


@contextmanager
def progress() -> Iterator[Progress | None]:
    """Two bars on stderr, photographs and pairs; None where that is no terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (
        rich.progress.TextColumn("{task.description}"),
        rich.progress.BarColumn(),
        rich.progress.MofNCompleteColumn(),
        rich.progress.TimeRemainingColumn(),
    )
    with rich.progress.Progress(*columns, console=console, transient=True) as bars:
        tasks: dict[str, rich.progress.TaskID] = {}

        def show(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done)

        yield show


def _print(measured: Measurement) -> None:
    failed = [pair for pair in measured.pairs if pair.two_view is None]
    for pair in failed[:_SHOWN]:
        click.echo(f"no edge {pair.i} - {pair.j}: {pair.reason}", err=True)
    if len(failed) > _SHOWN:
        click.echo(f"... and {len(failed) - _SHOWN} more pairs: see --json", err=True)
    kinds = Counter(pair.two_view.kind for pair in measured.used if pair.two_view is not None)
    inliers = [pair.num_inliers for pair in measured.used]
    rows = [
        ("photographs", f"{len(measured.photographs)}"),
        ("pairs", f"{len(measured.pairs)}, of which {len(inliers)} with a relative rotation"),
    ]
    if inliers:
        rows += [
            ("geometry", ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))),
            ("inliers", f"{min(inliers)} to {max(inliers)}, median {np.median(inliers):g}"),
        ]
    print_table(rows)


def _summary(measured: Measurement) -> dict[str, Any]:
    return {
        "photographs": [
            {
                "name": photo.name, "width": photo.width, "height": photo.height,
                "focal": photo.focal, "features": len(photo.points),
            }
            for photo in measured.photographs
        ],
        "pairs": [
            {
                "i": pair.i, "j": pair.j, "matches": len(pair.matches),
                "inliers": pair.num_inliers,
                "geometry": None if pair.two_view is None else pair.two_view.kind,
                "reason": pair.reason or None,
            }
            for pair in measured.pairs
        ],
        "without_edge": measured.without_edge,
    }  # fmt: skip
