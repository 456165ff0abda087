"""Robust losses and peers on simulated view graphs and on photographs with ground truth.

    ./dev bench robust                         # all of the table, half an hour
    ./dev bench robust --nodes 500 --no-peers  # a part of it, a minute

Errors are angles to the ground truth after the common rotation with the least sum of angles, in
degrees; times are seconds of CPU of the call that solves. The column "l2" is without certificate,
and so without the other starts that a refuted answer leads to. The column "truth" is the default
loss started from the ground truth: where it has a higher robust objective than the default's
answer, the data themselves speak for the wrong answer (marked ^). Peers run in processes of their
own, which are ended after --peer-limit seconds: "> 10 s".
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Callable

import click
import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.cases import shortest_path_start
from benchmarks.check import write_check_problem
from benchmarks.problem import Problem
from benchmarks.runner import Limits, measure
from benchmarks.solvers import SOLVERS

LOSSES = ("l2", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls", "auto")
PEERS = ("pytheia", "pycolmap")
CLUSTERS = 10

Truth = tuple[NDArray[np.float64], NDArray[np.bool_]]
Case = tuple[str, rotavg.MeasurementGraph, "Truth | None"]


def simulated(
    nodes: list[int], degrees: list[int], noises: list[float], normal: bool
) -> Iterator[Case]:
    """The view graphs of the table; `normal`: noise is a normal vector, of that much per axis."""
    for n in nodes:
        for degree in degrees:
            for noise in noises:
                sigma = float(np.radians(noise))
                vectors = partial(normal_vectors, sigma)
                for share in (0.0, 0.1, 0.3, 0.5, 0.7):
                    for clusters in (0, CLUSTERS) if share else (0,):
                        s = rotavg.simulate(
                            "erdos_renyi", n, density=degree / (n - 1),
                            noise=vectors if normal else sigma,
                            outliers=share, outlier_clusters=clusters, seed=1,
                        )  # fmt: skip
                        kind = "" if not share else " coherent" if clusters else " random"
                        name = f"{n} / {degree} / {noise:g} / {100 * share:.0f} %{kind}"
                        yield name, s.graph, (s.ground_truth, np.ones(n, dtype=np.bool_))


def normal_vectors(sigma: float, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Rotation vectors (count, 3)."""
    return sigma * rng.normal(size=(count, 3))


def photographs(folder: Path) -> Iterator[Case]:
    """Ellis Island with ground truth, Madrid Metropolis without, where they are."""
    ellis = folder / "ellis_island" / "ellis_island.npz"
    if ellis.exists():
        with np.load(ellis) as file:
            truth = file["ground_truth"], file["has_ground_truth"]
        yield "Ellis Island", rotavg.read(ellis), truth
    madrid = folder / "1dsfm" / "Madrid_Metropolis" / "EGs.txt"
    if madrid.exists():
        table = np.loadtxt(madrid)
        edges, rotations = table[:, :2].astype(np.int64), table[:, 2:11].reshape(-1, 3, 3)
        graph = rotavg.MeasurementGraph(edges, rotations).largest_component()
        yield "Madrid Metropolis", graph, None


def run(name: str, graph: rotavg.MeasurementGraph, truth: Truth | None) -> dict[str, Any]:
    """A loss of this library on one graph: its figures, or why there are none."""
    try:
        solve = ours(name, graph, truth)
    except ValueError as error:
        return {"failure": str(error)}
    start = time.process_time()
    solution = solve()
    seconds = time.process_time() - start
    objective = None if solution.robust is None else solution.robust.objective
    return {
        "seconds": seconds,
        "objective": objective,
        **accuracy(solution.rotations, graph, truth),
    }


def run_peer(
    name: str, graph: rotavg.MeasurementGraph, truth: Truth | None, limit: float
) -> dict[str, Any]:
    """The same for a peer, from the shortest paths, for so many seconds at most."""
    solver = next(s for s in SOLVERS if s.name == name)
    with TemporaryDirectory(prefix="rotavg-bench-") as folder:
        problem, warm_up = Path(folder) / "problem.npz", Path(folder) / "check.npz"
        Problem(graph.indices, graph.rotations, graph.weights, shortest_path_start(graph)).save(
            problem
        )
        write_check_problem(warm_up)
        measured = measure(solver, problem, warm_up, Limits(timeout=limit))
    if measured.outcome == "timeout":
        return {"limit": limit, "failure": measured.message}
    if measured.rotations is None:
        return {"failure": f"{measured.outcome}: {measured.message}"}
    return {"seconds": measured.cpu_s, **accuracy(measured.rotations, graph, truth)}


def accuracy(
    rotations: NDArray[np.float64], graph: rotavg.MeasurementGraph, truth: Truth | None
) -> dict[str, float]:
    """Share of the edges with a residual below 5 degrees, and errors where the truth is known."""
    i, j = graph.indices.T
    chord = np.linalg.norm(rotations[i] @ graph.rotations - rotations[j], axis=(1, 2)) / np.sqrt(2)
    figures = {"below_5": float(np.mean(chord < 2 * np.sin(np.radians(2.5))))}
    if truth is not None:
        error = rotavg.compare(rotations[truth[1]], truth[0][truth[1]])
        figures["mean"], figures["median"] = np.degrees([error.mean, error.median]).tolist()
    return figures


def ours(
    name: str, graph: rotavg.MeasurementGraph, truth: Truth | None
) -> Callable[[], rotavg.Solution]:
    """A loss of this library, certificate included but for l2; "truth" is auto from the truth."""
    init: Any = "auto"
    if name == "truth":
        if truth is None or not truth[1].all():
            raise ValueError("no ground truth for every node")
        name, init = "auto", truth[0]
    loss: Any = name
    return lambda: rotavg.solve(graph, loss=loss, init=init, certify=name != "l2", num_threads=1)


def cell(result: dict[str, Any], figure: str, digits: str = ".3g") -> str:
    """A figure as text; a dash for none, the limit where it was met."""
    if figure in result:
        return format(result[figure], digits)
    return f"> {result['limit']:g} s" if "limit" in result else "-"


def error_row(results: dict[str, dict[str, Any]]) -> list[str]:
    """Mean errors, and how the default does beside the best of the columns before it."""
    row = [cell(results[name], "mean") for name in results]
    means = {name: r["mean"] for name, r in results.items() if "mean" in r and name != "truth"}
    if "mean" in results.get("truth", {}):
        lower = results["auto"]["objective"] < results["truth"]["objective"] * (1 - 1e-6)
        row[-1] += "^" if lower else ""
    return [*row, f"{means['auto'] / min(means.values()):.2f}" if "auto" in means else "-"]


def print_table(header: list[str], rows: list[list[str]]) -> None:
    """A Markdown table on stdout."""
    click.echo("| " + " | ".join(header) + " |")
    click.echo("| --- |" + " ---: |" * (len(header) - 1))
    for row in rows:
        click.echo("| " + " | ".join(row) + " |")
    click.echo("")


@click.command(help=__doc__)
@click.option("--nodes", type=int, multiple=True, default=(500, 2000), show_default=True)
@click.option("--degree", type=int, multiple=True, default=(20, 100), show_default=True)
@click.option("--noise", type=float, multiple=True, default=(2, 5), show_default=True)
@click.option("--normal", is_flag=True, help="Noise is a normal vector, of that much per axis.")
@click.option("--no-peers", is_flag=True, help="rotavg alone.")
@click.option(
    "--peer-limit", type=float, default=10.0, show_default=True, help="Seconds for a peer's run."
)
@click.option("--no-simulated", is_flag=True, help="Photographs alone.")
@click.option("--data", type=click.Path(path_type=Path), help="Folder of the photographs' graphs.")
@click.option("--output", type=click.Path(path_type=Path), default=Path("build/bench/robust.json"))
def main(
    nodes: tuple[int, ...],
    degree: tuple[int, ...],
    noise: tuple[float, ...],
    normal: bool,
    no_peers: bool,
    peer_limit: float,
    no_simulated: bool,
    data: Path | None,
    output: Path,
) -> None:
    """Measure, print the tables, keep every figure."""
    names = [*LOSSES, *(() if no_peers else PEERS), "truth"]
    measured: dict[str, dict[str, dict[str, Any]]] = {}
    cases = [] if no_simulated else list(simulated([*nodes], [*degree], [*noise], normal))
    real = [] if data is None else list(photographs(data))
    output.parent.mkdir(parents=True, exist_ok=True)
    for name, graph, truth in [*real, *cases]:
        click.echo(name, err=True)
        measured[name] = {
            solver: run_peer(solver, graph, truth, peer_limit)
            if solver in PEERS
            else run(solver, graph, truth)
            for solver in names
        }
        output.write_text(json.dumps(measured, indent=1))

    if real:
        click.echo("Photographs: median / mean error, or share of the edges below 5 deg; CPU s\n")
        rows = []
        for name, _, truth in real:
            figures = [
                f"{cell(r, 'median')} / {cell(r, 'mean')}; {cell(r, 'seconds', '.2g')}"
                if truth is not None
                else f"{cell(r, 'below_5', '.2%')}; {cell(r, 'seconds', '.2g')}"
                for r in list(measured[name].values())[:-1]
            ]
            rows.append([name, *figures])
        print_table(["graph", *names[:-1]], rows)
    if cases:
        click.echo("Simulated, mean error in degrees\n")
        header = ["nodes / degree / noise (deg) / outliers", *names, "auto / best"]
        print_table(header, [[name, *error_row(measured[name])] for name, _, _ in cases])
        click.echo("Simulated, CPU seconds (median over noise and outliers)\n")
        groups = sorted({tuple(name.split(" / ")[:2]) for name, _, _ in cases}, key=str)
        rows = []
        for group in groups:
            of_group = [measured[c[0]] for c in cases if tuple(c[0].split(" / ")[:2]) == group]
            times = [[r[s]["seconds"] for r in of_group if "seconds" in r[s]] for s in names]
            rows.append([" / ".join(group), *(f"{np.median(t):.2g}" if t else "-" for t in times)])
        print_table(["nodes / degree", *names], rows)


if __name__ == "__main__":
    main()
