"""The command line: `./dev bench`, or `python -m benchmarks.run`."""

from __future__ import annotations

import os
import sys
from fnmatch import fnmatchcase
from pathlib import Path

import click
from rich.console import Console

import rotavg
from benchmarks import cases, record, report
from benchmarks.compare import GraphResult, Settings, compare, refusals
from benchmarks.solvers import SOLVERS, Solver

_WIDTH = 150  # of tables in a file or a pipe
_BUSY = 0.5  # load of each processor
_MEMORY_SHARE = 0.8  # of the machine's, for one process


def _threads(context: click.Context, option: click.Parameter, text: str) -> tuple[int, ...]:
    try:
        threads = tuple(sorted({int(number) for number in text.split(",")}))
    except ValueError:
        threads = ()
    available = len(os.sched_getaffinity(0))
    if not threads or threads[0] < 1 or threads[-1] > available:
        raise click.BadParameter(f"found {text}, expected numbers from 1 to {available}")
    return threads


def _solvers(
    context: click.Context, option: click.Parameter, patterns: tuple[str, ...]
) -> list[Solver]:
    chosen = [s for s in SOLVERS if not patterns or any(fnmatchcase(s.name, p) for p in patterns)]
    if not chosen:
        raise click.BadParameter(f"no solver is named {' or '.join(patterns)}; see --list")
    return chosen


@click.command()
@click.argument("graphs", nargs=-1)
@click.option("--set", "graph_set", type=click.Choice(list(cases.SETS)), help="Simulated graphs.")
@click.option(
    "--solver",
    "solvers",
    multiple=True,
    metavar="NAME",
    callback=_solvers,
    help="Only these solvers; 'rotavg*' is a pattern. May be repeated.",
)
@click.option(
    "--threads",
    default="1",
    show_default=True,
    metavar="N,...",
    callback=_threads,
    help="Numbers of threads, each measured; '1,2' tells the speed-up.",
)
@click.option(
    "--repeat",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Runs of every solver; medians are reported.",
)
@click.option(
    "--timeout",
    type=click.FloatRange(0, min_open=True),
    default=60.0,
    show_default=True,
    help="Seconds of wall time for one run.",
)
@click.option("--file-weights", is_flag=True, help="Weights as files have them; 1 without this.")
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default="build/bench",
    show_default=True,
    help="Folder for results.json and plot.png.",
)
@click.option("--readme", is_flag=True, help="Put the tables into benchmarks/README.md.")
@click.option("--list", "list_only", is_flag=True, help="List the solvers and graphs, and stop.")
def main(
    graphs: tuple[str, ...],
    graph_set: str | None,
    solvers: list[Solver],
    threads: tuple[int, ...],
    repeat: int,
    timeout: float,
    file_weights: bool,
    output: Path,
    readme: bool,
    list_only: bool,
) -> None:
    """Measure rotavg and other solvers on GRAPHS: files, or names of simulated graphs.

    Without any graph, a set of small simulated ones is taken: --set small.
    """
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _WIDTH)
    if list_only:
        for solver in solvers:
            console.print(f"[bold]{solver.name:18}[/] {solver.about}")
        for name, members in cases.SETS.items():
            console.print(f"[bold]--set {name:12}[/] {', '.join(members)}")
        return
    progress = Console(stderr=True, highlight=False)

    def say(text: str) -> None:
        progress.print(text, style="dim", markup=False)

    names = [*graphs, *(cases.SETS[graph_set] if graph_set else ())] or list(cases.SETS["small"])
    if missing := cases.unknown(names):
        raise click.UsageError(f"neither a file nor a simulated graph: {', '.join(missing)}")
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    settings = Settings(threads, repeat, timeout, _MEMORY_SHARE * memory)
    before = record.machine()

    load = before["load_average"][0]
    if load > _BUSY * before["processors"]:
        say(f"the machine is busy (load {load:.1f} of {before['processors']}): times suffer")
    refused = refusals(solvers, settings, say)
    kept = [solver for solver in solvers if solver.name not in refused]
    if not kept:
        raise click.ClickException("no solver can be measured")

    from benchmarks.plot import save_plot  # matplotlib takes a second to import

    output.mkdir(parents=True, exist_ok=True)
    results: list[GraphResult] = []
    for name in names:
        try:
            case = cases.load(name, file_weights=file_weights)
        except rotavg.Error as error:
            raise click.ClickException(str(error)) from None
        results.append(compare(case, kept, settings, say))
        report.print_table(console, results[-1])
        # After every graph, as a long run may be interrupted.
        record.write_json(
            output / "results.json",
            machine=before,
            settings=settings,
            refused=refused,
            results=results,
        )
        save_plot(output / "plot.png", results)
    report.print_notes(console, refused)
    say(f"wrote {output}/results.json and {output}/plot.png")
    if readme:
        report.rewrite_readme(
            results,
            machine=before,
            versions=record.versions(),
            settings=settings,
            refused=refused,
        )
        say(f"wrote {report.README}")


if __name__ == "__main__":
    main()
