"""Initial values: where Newton's method ends from each of them, and after what time.

    python -m benchmarks.starts [FILE...] [--repeat 7]

Beside simulations the files that are given, with their own weights. CPU milliseconds of one thread,
medians, the initial value in them; without the certificate.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import rotavg
from rotavg.solving.solve import Init

_INITS: tuple[Init, ...] = ("shortest_path", "chordal", "auto")
_SIMULATIONS = (
    ("sphere", 2500, 0.3),
    ("sphere", 20000, 0.1),
    ("sphere", 20000, 0.3),
    ("grid", 27000, 0.1),
    ("grid", 27000, 0.3),
    ("grid", 27000, 0.5),
)


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--repeat", type=int, default=7)
    arguments = parser.parse_args()
    print("| graph | " + " | ".join(f"`{init}`" for init in _INITS) + " |")
    print("|---|" + "---|" * len(_INITS))
    for path in arguments.files:
        _row(path.stem, rotavg.read(path).largest_component(), arguments.repeat)
    for kind, n, noise in _SIMULATIONS:
        graph = rotavg.simulate(kind, n, noise=noise, seed=1).graph
        _row(f"{kind} of {n} nodes, {noise:g} rad", graph, arguments.repeat)


def _row(name: str, graph: rotavg.MeasurementGraph, repeat: int) -> None:
    results = [_measured(graph, init, repeat) for init in _INITS]
    best = min(objective for _, _, objective in results)
    cells = []
    for milliseconds, steps, objective in results:
        above = objective / best - 1
        tail = f", +{above:.2%}" if above > 1e-6 else ""
        cells.append(f"{milliseconds:.3g} ms, {steps}{tail}")
    print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def _measured(graph: rotavg.MeasurementGraph, init: Init, repeat: int) -> tuple[float, int, float]:
    seconds = []
    for _ in range(repeat):
        before = time.process_time()
        solution = rotavg.solve(graph, init=init, certify=False, num_threads=1)
        seconds.append(time.process_time() - before)
    return 1e3 * statistics.median(seconds), solution.iterations, solution.objective


if __name__ == "__main__":
    main()
