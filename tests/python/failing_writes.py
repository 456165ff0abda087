"""Every writer against a disk that is full, and killed in the middle of a file.

    python tests/python/failing_writes.py full|killed

The limit on the size of files stands for both: beyond it a write fails, as on a full disk, or,
where the signal that goes with it is not ignored, ends the process there and then. Prints a JSON
object: for every writer what it came to, what its files then held, and what else was beside them.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import rotavg
from rotavg.io import FORMATS, write_covariances, write_diagnostics, write_edges, write_gravity

OLD = b"what was there before\n"
Writer = tuple[str, str, Callable[[Path], object]]  # name, the file's name, what writes it


def writers() -> Iterator[Writer]:
    graph = rotavg.simulate("sphere", 120, noise=0.05, seed=1).graph
    graph = rotavg.MeasurementGraph(
        graph.edges, graph.rotations, np.linspace(1, 2, graph.num_edges),
        translations=graph.translations,
    )  # fmt: skip
    solution = rotavg.solve(graph)
    for form in FORMATS:
        for item in (graph, solution):
            held = form.has_graphs if item is graph else form.has_solutions
            if form.write is None or not held or form.name == "colmap_model":
                continue  # (which writes to a folder of its own alone)
            usual = form.suffixes[0] if form.suffixes else ".dat"
            file = form.main_file or (f"new{usual}" if usual.startswith(".") else usual)
            name = form.name

            def write(path: Path, item: Any = item, name: str = name) -> None:
                rotavg.write(path, item, format=name)

            yield f"{name} {'graph' if item is graph else 'solution'}", file, write
    yield "edges", "edges.csv", lambda path: write_edges(path, solution)
    yield "covariances", "covariances.csv", lambda path: write_covariances(path, solution)
    yield "diagnostics", "diagnostics.csv", lambda path: write_diagnostics(path, solution)
    names = [f"{k}.jpg" for k in range(500)]
    vectors = np.tile([0.0, 1.0, 0.0], (500, 1))
    yield "gravity", "gravity.txt", lambda path: write_gravity(path, names, vectors)

    def write_part(path: Path) -> None:
        from rotavg.distributed.solution import _write

        part = SimpleNamespace(number=0, nodes=graph.nodes, num_own=graph.num_nodes)
        _write(part, solution.rotations, str(path.parent))  # type: ignore[arg-type]

    yield "distributed", "part-00000.npz", write_part
    for module in ("plotly", "jinja2"):
        try:
            __import__(module)
        except ImportError:
            return
    from rotavg.report import write_report

    yield "report", "report.html", lambda path: write_report(path, solution)


def largest(folder: Path) -> int:
    return max(path.stat().st_size for path in folder.iterdir())


def limited(write: Callable[[], object], limit: int, how: str = "full") -> tuple[str, int]:
    """What came of writing in a process whose files may have so many bytes, and how it ended."""
    told_by, tell = os.pipe()
    child = os.fork()
    if child == 0:
        if how == "killed":
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        try:
            write()
            outcome = "written"
        except BaseException as error:
            outcome = f"{type(error).__name__}: {error}"
        os.write(tell, outcome.encode())
        os._exit(0)
    os.close(tell)
    with os.fdopen(told_by, "rb") as stream:
        outcome = stream.read().decode()
    return outcome, os.waitpid(child, 0)[1]


def failing(file: str, write: Callable[[Path], object], how: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / file
        write(path)
        size = largest(path.parent)
        expected = sorted(p.name for p in path.parent.iterdir())
        for old in path.parent.iterdir():
            old.write_bytes(OLD)
        outcome, status = limited(lambda: write(path), size // 2, how)
        outcome = outcome.replace(str(path.parent), "FOLDER")
        there = {p.name: p.read_bytes() for p in path.parent.iterdir()}
        found = {
            "outcome": outcome,
            "signal": os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0,
            "old": all(there.pop(name) == OLD for name in expected),
            "beside": {name: len(data) for name, data in there.items()},
            "size": size,
        }
        write(path)  # the next attempt is none the worse
        found["again"] = largest(path.parent) == size
        return found


def main(how: str) -> None:
    warnings.simplefilter("ignore", rotavg.IncompleteWarning)
    print(json.dumps({name: failing(file, write, how) for name, file, write in writers()}))


if __name__ == "__main__":
    main(sys.argv[1])
