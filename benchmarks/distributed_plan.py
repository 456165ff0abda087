"""What a graph in parts needs of a cluster: a model, fitted to the runs below.

python -m benchmarks.distributed plan --nodes 1e8 --edges 1e10 --parts 256 512 1024 2048
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
    """A run of `benchmarks.distributed chunks`.

    Attributes:
        command: its arguments.
        nodes, edges, parts, workers: of it.
        rounds: to a relative gradient of 1e-6.
        products: of the proof.
        memory: the largest of a worker, GB.
        cpu: seconds, of workers and client.
        exchange: MB.
    """

    command: str
    nodes: int
    edges: int
    parts: int
    workers: int
    rounds: int
    memory: float
    cpu: float


RUNS: tuple[Measured, ...] = ()


@dataclass(frozen=True)
class Model:
    """What was fitted.

    Attributes:
        base: GB of a worker that holds nothing.
        held: bytes of an edge, all the time.
        at_work: bytes of an edge of the part that a worker is at.
        seconds: CPU, of an edge and round, reading and proof counted as further rounds.
    """

    base: float
    held: float
    at_work: float
    seconds: float


def fitted(runs: tuple[Measured, ...]) -> Model:
    """By least squares of relative errors."""
    rows = np.array([[1e9, r.edges / r.workers, r.edges / r.parts] for r in runs])
    peak = np.array([r.memory * 1e9 for r in runs])
    base, held, at_work = np.linalg.lstsq(rows / peak[:, None], np.ones(len(runs)), rcond=None)[0]
    seconds = float(np.mean([r.cpu / (r.edges * r.rounds) for r in runs]))
    return Model(float(base), float(held), float(at_work), seconds)


def plan(arguments: argparse.Namespace) -> None:
    """Print the runs, what was fitted to them, and a table."""
    model = fitted(RUNS)
    for run in RUNS:
        print(
            f"{run.command}: {run.edges} edges, {run.rounds} rounds, {run.memory} GB, {run.cpu} s"
        )
    print(
        f"\n{model.base:.2f} GB a worker, {model.held:.0f} bytes an edge and {model.at_work:.0f} "
        f"more of the part that it is at, {1e6 * model.seconds:.1f} us an edge and round\n"
    )
    n, m = arguments.nodes, arguments.edges
    print(
        "| parts, each on a core of its own | memory of each, GB | network, a part and round, MB | "
        "a round, s | messages of the scheduler, a round, s | scheduler, after all rounds and the "
        "proof, GB |\n|" + "---|" * 6
    )
    for parts in (int(p) for p in arguments.parts):
        own = n / parts
        boundary = min(0.3 * own, 4 * 3 * 9 * own**0.5)
        around = min(parts - 1, AROUND + arguments.anywhere * 2 * m / parts)
        memory = model.base + (model.held + model.at_work) * m / parts / 1e9 + OWNER * n / 1e9
        network = EXCHANGES * around * boundary * ROTATION / 1e6
        tasks = TASKS * parts
        every = tasks * arguments.rounds + PRODUCT_TASKS * parts * arguments.products
        print(
            f"| {parts} | {memory:.1f} | {network:.0f} | {model.seconds * m / parts:.0f} | "
            f"{tasks * arguments.task_seconds:.0f} | {every * 2e3 / 1e9:.1f} |"
        )
    print(f"\nOne worker sorts out the owners of all nodes in {HOME * n / 1e9:.1f} GB.")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Those of the plan alone."""
    parser.add_argument("--rounds", type=int, default=30, help="of the plan")
    parser.add_argument("--products", type=int, default=300, help="of the plan's proof")
    parser.add_argument("--task-seconds", type=float, default=5e-4, help="of the scheduler")
