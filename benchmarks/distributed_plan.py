"""What a graph in parts needs of a cluster: a model, fitted to the runs below.

python -m benchmarks.distributed plan --nodes 1e8 --edges 1e10 --parts 512 1024 2048 --anywhere 0
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

ROTATION = 80  # bytes: 3 x 3 doubles and an id
EXCHANGES = 4  # of rotations in a round: solved, joined, and the two levels
TASKS = 12  # of Dask's, a part and round: counted by `benchmarks.distributed rounds --workers 0`
PRODUCT_TASKS = 5  # a part and product of the proof
AROUND = 8  # parts beside a part of a plane
OWNER = 12  # bytes of a node in the table of owners, which all workers hold
HOME = 60  # bytes of a node while one worker sorts out who owns it


@dataclass(frozen=True)
class Measured:
    """A run of `benchmarks.distributed`, on a machine where a dozen other programs ran.

    Attributes:
        command: what it was.
        edges: as asked for.
        workers: 0: this process.
        rounds: all of them.
        memory: the largest of a worker, GB; the proof was under way in the last two.
        cpu: seconds until then, of workers and client.
    """

    command: str
    edges: int
    workers: int
    rounds: int
    memory: float
    cpu: float


RUNS = (
    Measured(
        "rounds --nodes 10000 --families sphere --parts 64 --workers 0", 19_899, 0, 28, 0.12, 3.7
    ),
    Measured(
        "chunks --nodes 1e5 --edges 1e6 --workers 0 --parts 16", 1_000_000, 0, 13, 0.465, 28.5
    ),
    Measured(
        "chunks --nodes 3e5 --edges 3e6 --workers 4 --parts 32", 3_000_000, 4, 15, 0.362, 345.0
    ),
)


@dataclass(frozen=True)
class Model:
    """What was fitted.

    Attributes:
        base: GB of a worker that holds nothing.
        held: bytes of an edge.
        seconds: CPU, of an edge and round; reading and dividing are counted as rounds.
    """

    base: float
    held: float
    seconds: float


def fitted(runs: tuple[Measured, ...]) -> Model:
    """By least squares of relative errors; seconds by the run with the fewest of an edge and round,
    as Dask's processes do some work even when they wait, and small graphs are mostly tasks.
    """
    rows = np.array([[1e9, run.edges / max(1, run.workers)] for run in runs])
    peak = np.array([run.memory * 1e9 for run in runs])
    base, held = np.linalg.lstsq(rows / peak[:, None], np.ones(len(runs)), rcond=None)[0]
    return Model(float(base), float(held), min(run.cpu / (run.edges * run.rounds) for run in runs))


def plan(arguments: argparse.Namespace) -> None:
    """Print the runs, what was fitted to them, and a table."""
    model = fitted(RUNS)
    for run in RUNS:
        print(
            f"{run.command}: {run.edges} edges, {run.rounds} rounds, {run.memory} GB, {run.cpu} s"
        )
    print(
        f"\n{model.base:.2f} GB a worker, {model.held:.0f} bytes an edge, "
        f"{1e6 * model.seconds:.1f} us of CPU an edge and round\n"
    )
    n, m = arguments.nodes, arguments.edges
    print(
        "| parts, each on a core of its own | memory of each, GB | network, a part and round, MB | "
        "a round, s | messages of the scheduler, a round, s | scheduler, after all rounds and the "
        "proof, GB |\n|" + "---|" * 6
    )
    for parts in (int(p) for p in arguments.parts):
        own = n / parts
        far = 2 * arguments.anywhere * m / parts
        # Overlap and halo of the parts around, three steps a layer (MOST_OVERLAP, MOST_LAYERS).
        boundary = min(own, min(0.3 * own, 4 * 3 * 9 * own**0.5) + far)
        around = min(parts - 1, AROUND + far)
        memory = model.base + model.held * m / parts / 1e9 + OWNER * n / 1e9
        network = EXCHANGES * around * boundary * ROTATION / 1e6
        tasks = TASKS * parts
        every = tasks * arguments.rounds + PRODUCT_TASKS * parts * arguments.products
        print(
            f"| {parts} | {memory:.1f} | {network:.0f} | {model.seconds * m / parts:.0f} | "
            f"{tasks * arguments.task_seconds:.0f} | {every * arguments.task_bytes / 1e9:.1f} |"
        )
    print(f"\nOne worker sorts out the owners of all nodes in {HOME * n / 1e9:.1f} GB.")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Those of the plan alone."""
    parser.add_argument("--rounds", type=int, default=30, help="of the plan")
    parser.add_argument("--products", type=int, default=300, help="of the plan's proof")
    parser.add_argument(
        "--task-seconds", type=float, default=5e-4, help="of the scheduler: assumed"
    )
    parser.add_argument("--task-bytes", type=float, default=2e3, help="of the scheduler: assumed")
