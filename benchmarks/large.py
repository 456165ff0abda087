"""Graphs of 1e5 to 1e6 nodes: from arrays, solved, proved; long files; bytes an edge and sweep.

    ./dev bench --set large                                  # all: an hour, up to 8 GB
    ./dev bench --set large --family band --nodes 300000 --threads 1
    ./dev bench --set large --files-only --edges 3000000

Every graph is made, built, solved and certified in a process of its own. Seconds are CPU seconds of
all threads, with wall seconds in brackets; memory is what is resident at the peak, the arrays that
the graph is made of included. The exponent is that of the growth of solve + proof with n.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

import rotavg
from benchmarks import large_graphs
from benchmarks.robust import print_table

ROOT = Path(__file__).resolve().parents[1]


class Clock:
    """CPU seconds of all threads, and wall seconds, since it was made."""

    def __init__(self) -> None:
        self.cpu, self.wall = time.process_time(), time.perf_counter()

    def seconds(self) -> list[float]:
        """Both."""
        return [time.process_time() - self.cpu, time.perf_counter() - self.wall]


def measure_graph(family: str, n: int, threads: int, seed: int) -> dict[str, Any]:
    """All stages of one graph."""
    edges, rotations = large_graphs.arrays(family, n, seed)
    clock = Clock()
    graph = rotavg.MeasurementGraph(edges, rotations)
    seconds = {"graph": clock.seconds()}
    found = {
        "family": family, "nodes": graph.num_nodes, "edges": graph.num_edges, "threads": threads,
        "bytes_an_edge": graph.num_bytes / graph.num_edges,
    }  # fmt: skip
    del edges, rotations
    clock = Clock()
    solution = rotavg.solve(graph, certify=False, num_threads=threads)
    seconds["solve"] = clock.seconds()
    found["solve_gib"] = _peak_gib()
    clock = Clock()
    certificate = rotavg.certify(graph, solution.rotations, num_threads=threads)
    seconds["proof"] = clock.seconds()
    return {
        **found,
        "seconds": seconds,
        "peak_gib": _peak_gib(),
        "method": solution.method,
        "status": solution.status.name,
        "verdict": certificate.verdict,
        "relative_gap": certificate.relative_gap,
        "failure_probability": certificate.failure_probability,
    }


def measure_files(m: int, threads: int, seed: int) -> dict[str, Any]:
    """A graph of m edges written and read in three formats, and a table reader beside them."""
    edges, rotations = large_graphs.arrays("expander", m // 11, seed)
    graph = rotavg.MeasurementGraph(edges, rotations)
    del edges, rotations
    graph.quaternions, graph.weights, graph.edges  # noqa: B018  (not to be measured)
    found: dict[str, Any] = {"edges": graph.num_edges}
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("txt", "csv", "g2o"):
            path = Path(folder) / f"graph.{suffix}"
            clock = Clock()
            rotavg.write(path, graph)
            written = clock.seconds()
            clock = Clock()
            rotavg.read(path)
            found[suffix] = {
                "megabytes": path.stat().st_size / 1e6, "write": written, "read": clock.seconds(),
            }  # fmt: skip
            if suffix == "csv":
                found.update(_table_readers(path))
            path.unlink()
    return found


def _table_readers(path: Path) -> dict[str, Any]:
    """The CSV file by other readers, and the graph of what they read."""
    found: dict[str, Any] = {}

    def by_pandas() -> Any:
        import pandas

        return pandas.read_csv(path)

    def by_polars() -> Any:
        import polars

        return polars.read_csv(path)

    readers: dict[str, Callable[[], Any]] = {"pandas": by_pandas, "polars": by_polars}
    for name, read in readers.items():
        try:
            clock = Clock()
            table = read()
        except ImportError:
            found[name] = "not installed"
            continue
        seconds = clock.seconds()
        clock = Clock()
        rotavg.MeasurementGraph.from_quaternions(
            np.column_stack([table["i"], table["j"]]),
            np.column_stack([table[word] for word in ("qx", "qy", "qz", "qw")]),
            np.asarray(table["weight"]),
        )
        found[name] = {"read": seconds, "graph": clock.seconds()}
    return found


def measure_roofline(seed: int) -> dict[str, Any]:
    """What a sweep over a dense graph reads a second, beside a plain read of memory."""
    data = np.ones(1 << 26)
    data.sum()
    clock = Clock()
    for _ in range(5):
        data.sum()
    stream = 5 * data.nbytes / clock.seconds()[0]
    del data
    graph = rotavg.simulate("complete", 2000, noise=0.2, seed=seed).graph
    found: dict[str, Any] = {"stream_gb_s": stream / 1e9, "edges": graph.num_edges}
    for method in ("bcd", "sum"):
        seconds = []
        for sweeps in (5, 25):
            clock = Clock()
            rotavg.solve(
                graph, method=method, max_iterations=sweeps, tolerance=1e-300,
                certify=False, num_threads=1,
            )  # fmt: skip
            seconds.append(clock.seconds()[0])
        sweep = (seconds[1] - seconds[0]) / 20
        found[method] = {"seconds": sweep, "gb_s": 40e-9 * graph.num_edges / sweep}
    return found


def _peak_gib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _in_a_process(what: str, *arguments: Any, limit_gib: float, timeout: float) -> dict[str, Any]:
    """What one of the functions above returns; what went wrong as "error"."""
    command = [sys.executable, "-m", "benchmarks.large", "--child", json.dumps([what, *arguments])]
    limit = int(limit_gib * 2**30)
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=timeout,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (limit, limit)),
        )
    except subprocess.TimeoutExpired:
        return {"error": f"no end in {timeout:g} s"}
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        return {"error": lines[-1]}
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def _both(seconds: list[float]) -> str:
    return f"{seconds[0]:.3g} ({seconds[1]:.3g})"


def _print_graphs(rows: list[dict[str, Any]]) -> None:
    header = [
        "graph", "edges", "bytes an edge", "from arrays", "solve", "proof", "proof / solve",
        "peak GB", "verdict", "exponent",
    ]  # fmt: skip
    table, before = [], {}
    for row in rows:
        name = f"{row['family']} {row['nodes']:.0e}"
        if "error" in row:
            table.append([name, row["error"], *[""] * (len(header) - 2)])
            continue
        seconds = row["seconds"]
        total = seconds["solve"][0] + seconds["proof"][0]
        exponent = ""
        if row["family"] in before:
            n, earlier = before[row["family"]]
            exponent = f"{np.log(total / earlier) / np.log(row['nodes'] / n):.2f}"
        before[row["family"]] = row["nodes"], total
        table.append([
            name, f"{row['edges']:.3g}", f"{row['bytes_an_edge']:.1f}", _both(seconds["graph"]),
            _both(seconds["solve"]), _both(seconds["proof"]),
            f"{seconds['proof'][0] / seconds['solve'][0]:.2f}", f"{row['peak_gib']:.2f}",
            row["verdict"], exponent,
        ])  # fmt: skip
    print_table(header, table)


def _print_files(found: dict[str, Any]) -> None:
    if "error" in found:
        click.echo(found["error"])
        return
    table = [
        [f"{suffix}, {found[suffix]['megabytes']:.0f} MB",
         _both(found[suffix]["write"]), _both(found[suffix]["read"])]
        for suffix in ("txt", "csv", "g2o")
    ]  # fmt: skip
    for name in ("pandas", "polars"):
        reader = found[name]
        told = reader if isinstance(reader, str) else (
            f"{_both(reader['read'])} and the graph {_both(reader['graph'])}"
        )  # fmt: skip
        table.append([f"csv by {name}", "", told])
    print_table([f"{found['edges']:.3g} edges", "written", "read"], table)


def _print_roofline(found: dict[str, Any]) -> None:
    if "error" in found:
        click.echo(found["error"])
        return
    table = [
        [method, f"{found[method]['seconds']:.4f}", f"{found[method]['gb_s']:.2f}",
         f"{found[method]['gb_s'] / found['stream_gb_s']:.0%}"]
        for method in ("bcd", "sum")
    ]  # fmt: skip
    stream = f"GB/s at 40 bytes an edge (memory: {found['stream_gb_s']:.2f})"
    print_table([f"sweep, {found['edges']:.3g} edges", "seconds", stream, "share"], table)


@click.command(help=__doc__)
@click.option("--family", "families", type=click.Choice(list(large_graphs.FAMILIES)), multiple=True)
@click.option("--nodes", multiple=True, type=int, help="1e5 and 1e6 without this.")
@click.option("--edges", type=int, default=3_000_000, show_default=True, help="Of the files.")
@click.option("--threads", type=int, default=1, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--memory", type=float, default=8.0, show_default=True, help="GiB, of each process.")
@click.option("--timeout", type=float, default=3600.0, show_default=True, help="Seconds of each.")
@click.option("--graphs-only", is_flag=True)
@click.option("--files-only", is_flag=True)
@click.option("--roofline-only", is_flag=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("build/bench/large.json"))
@click.option("--child", hidden=True)
def main(
    families: tuple[str, ...],
    nodes: tuple[int, ...],
    edges: int,
    threads: int,
    seed: int,
    memory: float,
    timeout: float,
    graphs_only: bool,
    files_only: bool,
    roofline_only: bool,
    output: Path,
    child: str | None,
) -> None:
    """Measure each in a process, print the tables, keep every figure."""
    if child is not None:
        what, *arguments = json.loads(child)
        measured = {"graph": measure_graph, "files": measure_files, "roofline": measure_roofline}
        click.echo(json.dumps(measured[what](*arguments)))  # type: ignore[operator]
        return
    everything: dict[str, Any] = {"load_average": os.getloadavg(), "graphs": []}
    output.parent.mkdir(parents=True, exist_ok=True)
    whole = not (graphs_only or files_only or roofline_only)

    def measure(what: str, *arguments: Any) -> dict[str, Any]:
        click.echo(f"{what} {' '.join(map(str, arguments))}", err=True)
        return _in_a_process(what, *arguments, limit_gib=memory, timeout=timeout)

    if whole or graphs_only:
        for family in families or large_graphs.FAMILIES:
            for n in sorted(nodes) or (100_000, 1_000_000):
                found = {"family": family, "nodes": n} | measure("graph", family, n, threads, seed)
                everything["graphs"].append(found)
                output.write_text(json.dumps(everything, indent=1))
        _print_graphs(everything["graphs"])
    if whole or files_only:
        everything["files"] = measure("files", edges, threads, seed)
        _print_files(everything["files"])
    if whole or roofline_only:
        everything["roofline"] = measure("roofline", seed)
        _print_roofline(everything["roofline"])
    output.write_text(json.dumps(everything, indent=1))


if __name__ == "__main__":
    main()
