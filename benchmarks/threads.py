"""Two threads against one, and a sweep's traffic against a stream of reads.

`./dev bench threads [CASE...]`, or `python -m benchmarks.threads`; under three minutes. Wall times,
so on a machine that does nothing else; with `--load N` beside N busy loops.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import rotavg
from benchmarks import cases

_FAMILIES = (
    "sphere-50000",
    "grid-36000",
    "erdos-renyi-25000",
    "expander-10000",
    "band-11000",
    "city-11000",
    "complete-2000-0.2",
    "random-3000",
    "sphere-2500",
    "grid-3000",
    "expander-500",
    "complete-150",
    "band-500",
)
_STAGES = ("solve", "proof", "whole")


def _seconds(graph: rotavg.MeasurementGraph, threads: int) -> tuple[NDArray[np.float64], bytes]:
    """Of solve, proof and the whole; and the rotations."""
    before = time.perf_counter()
    solution = rotavg.solve(graph, num_threads=threads)
    whole = time.perf_counter() - before
    timings = solution.timings
    return np.array([timings.solve, timings.certify, whole]), solution.rotations.tobytes()


def _pairs(
    graph: rotavg.MeasurementGraph, threads: int, seconds: float
) -> tuple[NDArray[np.float64], bool]:
    """Seconds (pairs, 2, stages) with one thread and with `threads`; whether the bits agree."""
    _seconds(graph, threads)  # helpers, caches
    rows: list[list[NDArray[np.float64]]] = []
    same = True
    until = time.perf_counter() + seconds
    while len(rows) < 5 or (time.perf_counter() < until and len(rows) < 100):
        order = (1, threads) if len(rows) % 2 else (threads, 1)
        results = {count: _seconds(graph, count) for count in order}
        rows.append([results[1][0], results[threads][0]])
        same &= results[1][1] == results[threads][1]
    return np.array(rows), same


def _stream(threads: int) -> float:
    """Bytes a second that reading takes in, the best of some runs."""
    parts = np.array_split(np.ones(2**25), threads)  # 256 MB
    with ThreadPoolExecutor(threads) as pool:
        best = float("inf")
        for _ in range(7):
            before = time.perf_counter()
            list(pool.map(np.max, parts))
            best = min(best, time.perf_counter() - before)
    return 8 * 2**25 / best


def _sweep(graph: rotavg.MeasurementGraph, threads: int) -> float:
    """Seconds that one sweep of SUM takes, the best of some."""
    solution = rotavg.solve(
        graph, method="sum", max_iterations=12, tolerance=0.0, certify=False, num_threads=threads
    )
    return float(np.diff(solution.trace.seconds)[1:].min())


@contextmanager
def _load(loops: int) -> Iterator[None]:
    """Busy loops beside what is measured."""
    program = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(program) for _ in range(loops)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _compare(console: Console, names: tuple[str, ...], threads: int, seconds: float) -> None:
    times = [f"{count} threads: {stage}" for count in (1, threads) for stage in _STAGES]
    table = Table("graph", "nodes / edges", "pairs", *times, "ratio", "best quarter", "same bits")
    for name in names:
        graph = cases.load(name).graph
        rows, same = _pairs(graph, threads, seconds)
        medians = np.median(rows, axis=0).ravel() * 1e3
        whole = rows[:, :, 2]
        ratio = statistics.median(whole[:, 0] / whole[:, 1])
        quarters = np.quantile(whole, 0.25, axis=0)
        table.add_row(
            name,
            f"{graph.num_nodes} / {graph.num_edges}",
            str(len(rows)),
            *(f"{t:.3g}" for t in medians),
            f"{ratio:.2f}",
            f"{quarters[0] / quarters[1]:.2f}",
            "yes" if same else "NO",
        )
    console.print("Wall milliseconds, medians of pairs of runs; the ratio is that of the wholes.")
    console.print(table)


def _roofline(console: Console, threads: int) -> None:
    """What a sweep of SUM reads of the measurements: on dense graphs each once, a quaternion and
    two indices; on others at both ends.
    """
    bytes_each = 40
    table = Table(
        "graph", "threads", "bytes an edge", "sweep (ms)", "GB/s", "stream (GB/s)", "share"
    )
    for count in (1, threads):
        stream = _stream(count)
        for name, ends in (("complete-2000-0.2", 1), ("random-3000", 1), ("expander-10000", 2)):
            graph = cases.load(name).graph
            sweep = _sweep(graph, count)
            rate = ends * bytes_each * graph.num_edges / sweep
            table.add_row(
                name,
                str(count),
                str(ends * bytes_each),
                f"{sweep * 1e3:.3g}",
                f"{rate * 1e-9:.2f}",
                f"{stream * 1e-9:.2f}",
                f"{rate / stream:.0%}",
            )
    console.print(table)


@click.command()
@click.argument("names", nargs=-1, metavar="[CASE]...")
@click.option("--threads", type=click.IntRange(2), default=2, show_default=True)
@click.option("--seconds", type=float, default=5.0, show_default=True, help="For each graph.")
@click.option("--load", type=click.IntRange(0), default=0, help="Busy loops beside.")
def main(names: tuple[str, ...], threads: int, seconds: float, load: int) -> None:
    """Solve and prove CASES (files, simulations; some of every family), one thread against more."""
    if missing := cases.unknown(names):
        raise click.UsageError(f"neither a simulation nor a file: {', '.join(missing)}")
    console = Console(width=190)
    with _load(load):
        _compare(console, names or _FAMILIES, threads, seconds)
    if not names:
        _roofline(console, threads)


if __name__ == "__main__":
    main()
