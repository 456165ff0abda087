"""The runs of one solver on one graph as one row, and a row as text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from benchmarks.compare import VERDICTS, GraphResult, Run
from benchmarks.solvers import SOLVERS

_ROBUST = frozenset(solver.name for solver in SOLVERS if solver.robust)


@dataclass(frozen=True)
class Row:
    """One line of the table: medians of the costs, the worst of the answers.

    Attributes:
        failure: what went wrong in a run, empty where nothing did.
        speed_up: wall time on the fewest threads over this row's; NaN for these themselves.
    """

    solver: str
    threads: int
    failure: str
    claim: str
    cpu_s: float
    wall_s: float
    prepare_s: float
    memory_mib: float
    excess: float
    relative_gradient: float
    verdict: str
    relative_gap: float
    speed_up: float


def rows(result: GraphResult) -> list[Row]:
    """One row for each solver and number of threads, in the order of the runs."""
    groups: dict[tuple[str, int], list[Run]] = {}
    for run in result.runs:
        groups.setdefault((run.solver, run.threads), []).append(run)
    fewest = min((run.threads for run in result.runs), default=1)
    return [
        _row(runs, groups.get((solver, fewest), []) if threads > fewest else [])
        for (solver, threads), runs in groups.items()
    ]


def _row(runs: Sequence[Run], baseline: Sequence[Run]) -> Row:
    good = [run for run in runs if run.succeeded]
    failure = "; ".join(f"{r.outcome}: {r.message}" for r in runs if not r.succeeded)
    worst = max(good, key=lambda run: run.excess, default=runs[0])
    return Row(
        solver=worst.solver,
        threads=worst.threads,
        failure=failure,
        claim=worst.claim,
        cpu_s=_median(run.cpu_s for run in good),
        wall_s=_median(run.wall_s for run in good),
        prepare_s=_median(run.prepare_s for run in good),
        memory_mib=_median(run.memory_mib for run in good),
        excess=worst.excess,
        relative_gradient=worst.relative_gradient,
        verdict=min((run.verdict for run in good), key=VERDICTS.index, default=""),
        relative_gap=max((run.relative_gap for run in good), default=math.nan),
        speed_up=_median(run.wall_s for run in baseline if run.succeeded)
        / _median(run.wall_s for run in good),
    )


def _median(values: Iterable[float]) -> float:
    kept = list(values)
    return median(kept) if kept else math.nan


def title(result: GraphResult) -> str:
    """The graph and what is known of its optimum, in one line."""
    known = {
        "proved": "proved by rotavg",
        "estimated": "estimated by rotavg, not proved",
    }.get(result.best_verdict, "the best that was found, not proved")
    return (
        f"{result.name}: {result.nodes} nodes, {result.edges} edges; "
        f"f* = {result.best:.10g}, {known}"
    )


def header(several_threads: bool) -> list[str]:
    """The names of the columns of `cells`."""
    names = ["solver", "its own verdict", "CPU s", "wall s", "prepare s", "MiB"]
    names += ["(f - f*) / f*", "gradient", "rotavg's verdict"]
    return [*names, "threads", "speed-up"] if several_threads else names


def cells(row: Row, several_threads: bool) -> list[str]:
    """A row as text; robust solvers, which minimise something else, are marked."""
    texts = [
        row.solver + ("*" if row.solver in _ROBUST else ""),
        "; ".join(text for text in (row.claim, row.failure) if text) or "-",
        _seconds(row.cpu_s),
        _seconds(row.wall_s),
        _seconds(row.prepare_s),
        "" if math.isnan(row.memory_mib) else f"{row.memory_mib:.3g}",
        "" if math.isnan(row.excess) else f"{row.excess:.1e}" if row.excess > 0 else "0",
        "" if math.isnan(row.relative_gradient) else f"{row.relative_gradient:.0e}",
        _verdict(row),
    ]
    if several_threads:
        speed_up = "" if math.isnan(row.speed_up) else f"{row.speed_up:.2f}"
        texts += [str(row.threads), speed_up]
    return texts


def _verdict(row: Row) -> str:
    if row.verdict == "not_certified":
        return f"not certified: gap <= {row.relative_gap:.0e}"
    return row.verdict


def _seconds(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}" if value < 1000 else f"{value:.0f}"
