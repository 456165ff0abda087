"""Solving again after some edges came and went: from the last solution, and from nothing.

    python -m benchmarks.warm_start {sphere2500,torus3D,parking-garage}.g2o

Of each file's graph, all weights 1, 20 edges are removed and 20 added between random nodes, with
noise of 0.05 rad; one thread. Prints a table of iterations and CPU milliseconds, the least of 20.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path
from typing import Any, Callable

import numpy as np

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs


def changed(last: rotavg.Solution, count: int) -> rotavg.MeasurementGraph:
    """The graph of a solution with so many edges fewer, and as many others."""
    graph, R, random = last.graph, last.rotations, np.random.default_rng(0)
    kept = np.sort(random.permutation(graph.num_edges)[count:])
    i, j = random.integers(graph.num_nodes, size=(2, 2 * count))
    i, j = i[i != j][:count], j[i != j][:count]
    noise = matrices_from_rotvecs(random.normal(scale=0.05, size=(count, 3)))
    return rotavg.MeasurementGraph(
        np.concatenate([graph.indices[kept], np.stack([i, j], axis=1)]),
        np.concatenate([graph.rotations[kept], np.swapaxes(R[i], 1, 2) @ R[j] @ noise]),
        nodes=np.arange(graph.num_nodes),
    )


def timed(solve: Callable[[], rotavg.Solution]) -> str:
    """Iterations and the least CPU time of 20 calls."""
    times = []
    for _ in range(20):
        began = time.process_time()
        solution = solve()
        times.append(time.process_time() - began)
    return f"{solution.iterations} / {1e3 * min(times):.2f}"


def main() -> None:
    """Measure, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    print(
        "| graph | cold | warm | cold, no certificate | warm, no certificate |\n" + "|---" * 5 + "|"
    )
    for path in parser.parse_args().files:
        last = rotavg.solve(rotavg.read(path, unit_weights=True))
        solve: Any = partial(rotavg.solve, changed(last, 20), num_threads=1)
        runs = [partial(solve, certify=c, init=i) for c in (True, False) for i in ("auto", last)]
        print(f"| {path.stem} |", " | ".join(map(timed, runs)), "|")


if __name__ == "__main__":
    main()
