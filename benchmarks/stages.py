"""Where the time of solve and proof goes, beside the proof's one factorisation alone.

`./dev bench stages GRAPH...`, or `python -m benchmarks.stages`; it compiles stages.cpp.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import rotavg
from benchmarks import cases
from rotavg.graph.conventions import quaternions_from_matrices

_ROOT = Path(__file__).resolve().parents[1]
_BUILD = _ROOT / "build" / "bench-stages"
_COLUMNS = ("initial value", "solve", "certify", "together", "factorisation alone")


def _program() -> Path:
    """stages.cpp, compiled as the Python package is for processors with AVX2."""
    options = ["-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS=-mavx2 -mfma"]
    configure = ["cmake", "-S", _ROOT, "-B", _BUILD, "-DROTAVG_BUILD_BENCHMARKS=ON", *options]
    for command in (configure, ["cmake", "--build", _BUILD, "--target", "stages"]):
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return _BUILD / "benchmarks" / "stages"


def _measure(program: Path, graph: rotavg.MeasurementGraph, runs: int) -> list[float]:
    """Milliseconds, one for each of the columns."""
    quaternions = quaternions_from_matrices(graph.rotations)
    table = np.column_stack([graph.indices, quaternions, graph.weights])
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        np.savetxt(file, table, fmt=["%d"] * 2 + ["%.17g"] * 5)
        file.flush()
        done = subprocess.run(
            [program, file.name, str(runs)], check=True, capture_output=True, text=True
        )
    return [float(word) for word in done.stdout.split()]


@click.command()
@click.argument("graphs", nargs=-1, required=True)
@click.option("--runs", type=click.IntRange(1), default=40, show_default=True)
@click.option("--file-weights", is_flag=True, help="Weights as files have them; 1 without this.")
def main(graphs: tuple[str, ...], runs: int, file_weights: bool) -> None:
    """CPU milliseconds of one thread on GRAPHS, medians of many runs in one process."""
    table = Table("graph", "nodes / edges", *(f"{name} (ms)" for name in _COLUMNS), "ratio")
    program = _program()
    for name in graphs:
        case = cases.load(name, file_weights=file_weights)
        times = _measure(program, case.graph, runs)
        size = f"{case.graph.num_nodes} / {case.graph.num_edges}"
        table.add_row(case.name, size, *(f"{t:.3g}" for t in times), f"{times[3] / times[4]:.2f}")
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
