"""`rotavg reproduce`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Callable

import click
from rich.console import Console

from rotavg.base.errors import require
from rotavg.cli import options
from rotavg.cli.options import number
from rotavg.cli.output import print_json, print_text
from rotavg.io.atomic import check_writable, make_folder
from rotavg.reproduce import EXPERIMENTS, Settings, write

_LARGEST = 5000  # nodes; complete graphs of more fill the memory


class _Sizes(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """Numbers of nodes, with commas between them."""

    name = "n,n,..."

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, ...]:
        if isinstance(value, tuple):
            return value
        try:
            sizes = tuple(int(part) for part in value.split(","))
        except ValueError:
            sizes = ()
        if not sizes or min(sizes) < 3 or max(sizes) > _LARGEST:
            self.fail(f"found {value!r}, expected numbers from 3 to {_LARGEST}: 20,200", param)
        return sizes


@click.command(
    short_help="Reproduce tables and figures of the paper.",
    epilog="\b\n" + "\n".join(f"{name:<8}{e.title}" for name, e in EXPERIMENTS.items()),
)
@click.argument(
    "names", metavar="WHAT...", type=click.Choice([*EXPERIMENTS, "all"]), nargs=-1, required=True
)
@click.option(
    "-o", "--output", "folder", metavar="FOLDER", type=options.PATH, default="reproduced",
    show_default=True, help="Where the tables and pictures go; made if need be.",
)  # fmt: skip
@click.option(
    "--runs", type=click.IntRange(1), metavar="N",
    help="Graphs per row of a table.  [default: 100, above n = 200: 3]",
)  # fmt: skip
@click.option(
    "--sizes", type=_Sizes(),
    help="Numbers of nodes; a figure takes the first.  [default: 20,200 for table1]",
)  # fmt: skip
@click.option(
    "--photographs", metavar="FOLDER", type=options.PATH,
    help="Photographs, or folders of them (ET, kermit): needed for table2 and fig4.",
)  # fmt: skip
@click.option(
    "--references", metavar="FOLDER", type=options.PATH,
    help="Where NAME_glomap_rotations.txt are, to compare with.",
)  # fmt: skip
@click.option("--slow", is_flag=True, help="BCDSR above n = 200, too: hours. Tells how many first.")
@number("--seed", click.IntRange(0), 1, "Of the graphs.")
@options.as_json
def reproduce(names: tuple[str, ...], folder: Path, as_json: bool, **settings: Any) -> None:
    """Reproduce tables and figures of the paper (Dong, Xie and Shi 2021).

    WHAT is one or several of those below, or all. Each leaves a Markdown file, a JSON file and, if
    it is a figure (which needs the extra [plot]), a PNG and a PDF in FOLDER. Table 1 takes some
    minutes, a figure some seconds.

    \b
    Examples:
      rotavg reproduce table1
      rotavg reproduce all --runs 10 -o paper
      rotavg reproduce table1 --sizes 2000 --runs 1 --slow
      rotavg reproduce table2 fig4 --photographs bundler_sfm/examples
    """
    chosen = _chosen(names, settings["photographs"] is not None)
    make_folder(folder)
    for name in chosen:
        check_writable(folder / f"{name}.json")
    found = {}
    note = partial(click.echo, err=True)
    with _line() as progress:
        for name in chosen:
            experiment = EXPERIMENTS[name]
            progress(experiment.title)
            outcome = experiment.run(Settings(note=note, progress=progress, **settings))
            paths = write(folder, experiment, outcome)
            found[name] = outcome.data
            if not as_json:
                print_text(f"{experiment.title}\n\n{outcome.markdown}")
                click.echo("wrote " + ", ".join(map(str, paths)), err=True)
    if as_json:
        print_json(found)


def _chosen(names: tuple[str, ...], photographs: bool) -> list[str]:
    """What to run; "all" leaves out what needs photographs where there are none, and says so."""
    chosen = list(EXPERIMENTS) if "all" in names else list(dict.fromkeys(names))
    missing = [] if photographs else [n for n in chosen if EXPERIMENTS[n].from_photographs]
    if missing and "all" not in names:
        raise click.UsageError(f"{missing[0]} starts from photographs: pass --photographs FOLDER")
    if missing:
        click.echo(f"left out: {', '.join(missing)}, which need --photographs FOLDER", err=True)
    chosen = [name for name in chosen if name not in missing]
    if any(EXPERIMENTS[name].draws for name in chosen):
        require("matplotlib", "plot")  # not after minutes of work
    return chosen


@contextmanager
def _line() -> Iterator[Callable[[str], None]]:
    """A function that keeps one line of progress on stderr, where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda text: None
        return
    with Console(stderr=True).status("") as status:
        yield lambda text: status.update(text)
