"""Which optima are proved: random graphs and regular ones, from no noise at all to .1 rad.

    ./dev bench --set noise                                  # ten seeds: an hour
    ./dev bench --set noise --seeds 1 --graph grid --graph erdos_renyi-200-8
    ./dev bench --set noise --weights uneven

A cell counts the verdicts over the seeds: how many of the optima found are proved. Where some are
not, the others follow, and the largest relative gap. The last column is how many times as long as
the solve its certificate takes: the largest, over noise of 1e-9 rad and more (with less the start
is the solution), of medians over the seeds.
"""

from __future__ import annotations

import json
from collections import Counter
from fnmatch import fnmatchcase
from pathlib import Path
from statistics import median

import click
import numpy as np

import rotavg
from benchmarks.robust import print_table

NOISE = (0.0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)  # radians
GRAPHS: dict[str, tuple[str, int, dict[str, float]]] = {
    **{
        f"erdos_renyi-{n}-{degree}": ("erdos_renyi", n, {"density": degree / (n - 1)})
        for n in (200, 1000, 5000)
        for degree in (4, 8, 30)
    },
    "erdos_renyi-20000-6": ("erdos_renyi", 20000, {"density": 6 / 19999}),
    "sphere": ("sphere", 1000, {}),
    "grid": ("grid", 1024, {}),
    "cycle": ("cycle", 1000, {}),
    "complete": ("complete", 200, {}),
    "band": ("band", 2000, {}),
}


def measure(
    name: str, noise: float, seed: int, weights: str, threads: int | None
) -> tuple[str, float, float]:
    """What is proved of a graph, the relative gap, and the certificate's time over the solve's."""
    kind, n, options = GRAPHS[name]
    graph = rotavg.simulate(kind, n, noise=noise, seed=seed, **options).graph
    if weights == "uneven":  # over four orders
        rng = np.random.default_rng([seed, n])
        graph = graph.with_weights(10 ** rng.uniform(-2, 2, graph.num_edges))
    solution = rotavg.solve(graph.largest_component(), num_threads=threads)
    certificate, timings = solution.certificate, solution.timings
    assert certificate is not None
    times = timings.certify / max(timings.init + timings.solve, 1e-6)
    return certificate.verdict, certificate.relative_gap, times


def cell(found: list[tuple[str, float, float]]) -> str:
    """The verdicts of one graph at one noise."""
    counts = Counter(verdict for verdict, _, _ in found)
    text = f"{counts.pop('proved', 0)}"
    if not counts:
        return text
    others = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    return f"{text}; {others}; {max(gap for _, gap, _ in found):.1e}"


def certify_over_solve(row: dict[str, list[tuple[str, float, float]]]) -> str:
    """The certificate's time over the solve's, of one graph."""
    medians = [
        median(times for _, _, times in found)
        for noise, found in row.items()
        if float(noise) >= 1e-9
    ]
    return f"{max(medians):.2g}"


@click.command(help=__doc__)
@click.option("--graph", "patterns", multiple=True, help="Only these; a pattern. May be repeated.")
@click.option("--seeds", type=click.IntRange(1), default=10, show_default=True)
@click.option("--weights", type=click.Choice(["even", "uneven"]), default="even")
@click.option("--threads", type=int, default=1, show_default=True)
@click.option("--output", type=click.Path(path_type=Path), default=Path("build/bench/noise.json"))
def main(patterns: tuple[str, ...], seeds: int, weights: str, threads: int, output: Path) -> None:
    """Solve all of them, print the table, keep every figure."""
    names = [n for n in GRAPHS if not patterns or any(fnmatchcase(n, p) for p in patterns)]
    if not names:
        raise click.UsageError(f"no graph is named {' or '.join(patterns)}: {', '.join(GRAPHS)}")
    output.parent.mkdir(parents=True, exist_ok=True)
    measured: dict[str, dict[str, list[tuple[str, float, float]]]] = {}
    for name in names:
        click.echo(name, err=True)
        measured[name] = {}
        for noise in NOISE:
            measured[name][f"{noise:g}"] = [
                measure(name, noise, seed, weights, threads) for seed in range(1, seeds + 1)
            ]
        output.write_text(json.dumps(measured, indent=1))
    table = [
        [name, *(cell(found) for found in row.values()), certify_over_solve(row)]
        for name, row in measured.items()
    ]
    title = f"proved, of {seeds}, {weights} weights"
    print_table([title, *(f"{noise:g}" for noise in NOISE), "certify / solve"], table)


if __name__ == "__main__":
    main()
