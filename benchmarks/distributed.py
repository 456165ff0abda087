"""Graphs in parts: objective, rounds and memory, beside one process.

    python -m benchmarks.distributed families --workers 1 2 4    # n = 1e5, three families
    python -m benchmarks.distributed rounds --parts 2 4 8 16 32 64
    python -m benchmarks.distributed chunks --nodes 3e6 --edges 3e7 --workers 4 --parts 32
    python -m benchmarks.distributed scheduler    # what a task costs
    python -m benchmarks.distributed plan --nodes 1e8 --edges 1e10 --parts 512 1024 --anywhere 0

Each prints a table. With `--workers 0` there is no Dask, and one process does everything: it takes
the same rounds, in less time. `chunks` makes the measurements chunk by chunk on the workers, so
that no process ever holds the graph, and tells the largest memory of any.
"""

from __future__ import annotations

import argparse
import os
import time
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from benchmarks.distributed_plan import add_arguments, plan
from benchmarks.inline_client import InlineClient
from rotavg.distributed import DistributedSolution, Edges, solve
from rotavg.distributed.cluster import ON_THIS_MACHINE


def family(name: str, n: int) -> rotavg.MeasurementGraph:
    """A graph of about n nodes: a sphere's trajectory, a grid, or an expander of degree 22."""
    if name == "expander":
        return rotavg.simulate("erdos_renyi", n, noise=0.1, density=22.0 / n, seed=1).graph
    return rotavg.simulate(name, n, noise=0.05, seed=1).graph


def used() -> tuple[float, float]:
    """The largest memory of this process so far, GB, and its CPU seconds.

    Not ru_maxrss, in which a process begins with what the one had that started it.
    """
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
    return peak / 2**20, sum(os.times()[:2])


def cluster(workers: int) -> tuple[Any, Any]:
    """So many processes on this machine, and their client."""
    import dask
    from distributed import Client, LocalCluster

    with dask.config.set(ON_THIS_MACHINE):
        local = LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=":0", memory_limit=0
        )
        return local, Client(local)


@dataclass(frozen=True)
class Run:
    """A solution and what it took.

    Attributes:
        solution: of which the numbers are left.
        seconds: from first to last.
        memory, client_memory: the largest of a worker, and of the client with the scheduler, GB.
        cpu, client_cpu: seconds of all workers together, and of that.
        fetched: MB that all parts fetch from one another in one exchange of rotations, if each is
            on a worker of its own.
    """

    solution: DistributedSolution
    seconds: float
    memory: float
    client_memory: float
    cpu: float
    client_cpu: float
    fetched: float


def in_parts(source: Any, workers: int, parts: int, **options: Any) -> Run:
    """Solved, and measured; 0 workers: in this process, without Dask."""
    local, client = cluster(workers) if workers > 0 else (nullcontext(), InlineClient())
    with local, client:
        begin, (_, before) = time.perf_counter(), used()
        solution = solve(source, client=client, parts=parts, **options)
        seconds = time.perf_counter() - begin
        told = client.run(used).values()
        network = solution.network
        sizes = client.gather(network.each(boundary_size))
        fetched = sum(sizes[q] for around in network.neighbours for q in around) * 80e-6
    here, now = used()
    memory = max(peak for peak, _ in told)
    cpu = sum(time for _, time in told) if workers > 0 else 0.0
    return Run(solution, seconds, memory, here, cpu, now - before, fetched)


def boundary_size(part: Any) -> int:
    """How many nodes' rotations others ask the part for."""
    return len(part.boundary)


def row(run: Run, objective: float) -> str:
    """Of a table."""
    solution = run.solution
    solved = [r for r in solution.rounds if r.objective <= objective * (1.0 + 1e-9)]
    certificate = solution.certificate
    verdict = "" if certificate is None else f"{certificate.verdict} ({certificate.method})"
    return (
        f"| {solution.num_parts} | {solved[0].number if solved else '-'} | "
        f"{solution.rounds[-1].number} | {solution.objective / objective - 1.0:.1e} | {verdict} | "
        f"{run.seconds:.1f} | {run.cpu:.1f} + {run.client_cpu:.1f} | {run.memory:.2f} | "
        f"{run.fetched:.2f} |"
    )


HEAD = (
    "| parts | rounds to 1e-9 | rounds | objective, relative to one process | certificate | "
    "wall, s | CPU of workers + client, s | largest worker, GB | "
    "an exchange, MB |\n|" + "---|" * 9
)


def families(arguments: argparse.Namespace) -> None:
    """Three families by as many parts as workers."""
    for name in arguments.families:
        graph = family(name, arguments.nodes)
        begin = time.perf_counter()
        alone = rotavg.solve(graph, tolerance=1e-10)
        seconds = time.perf_counter() - begin
        print(
            f"\n{name}: {len(graph.nodes)} nodes, {len(graph.edges)} edges; one process: ", end=""
        )
        print(f"{alone.objective:.12g}, {alone.certificate.verdict}, {seconds:.1f} s\n\n{HEAD}")
        for workers in arguments.workers:
            print(row(in_parts(graph, workers, workers), alone.objective), flush=True)


def rounds(arguments: argparse.Namespace) -> None:
    """Rounds by the number of parts."""
    for name in arguments.families:
        graph = family(name, arguments.nodes)
        alone = rotavg.solve(graph, tolerance=1e-10, certify=False)
        print(f"\n{name}: {len(graph.nodes)} nodes, {len(graph.edges)} edges\n\n{HEAD}")
        for parts in arguments.parts:
            run = in_parts(graph, arguments.workers[-1], parts, certify=False)
            print(row(run, alone.objective), flush=True)


def made(chunk: int, chunks: int, nodes: int, edges: int, anywhere: float, seed: int) -> Edges:
    """A city's district: nodes on a square of a lattice, joined to others within three steps, also
    of the districts around; a share of the edges leads anywhere (a place seen again).
    """
    rng = np.random.default_rng([seed, chunk])
    across = int(np.sqrt(chunks))  # districts in a row; the last row may be shorter
    side = int(np.sqrt(nodes / chunks))
    size, count = side * side, edges // chunks
    district = np.array([chunk % across, chunk // across])
    local = np.stack(np.divmod(np.arange(size), side), axis=1)
    more = count - 2 * size
    begin = np.concatenate([local, local, local[rng.integers(size, size=more)]])
    step = np.concatenate(
        [
            np.tile([1, 0], (size, 1)),
            np.tile([0, 1], (size, 1)),
            rng.integers(-3, 4, size=(more, 2)),
        ]
    )
    there = side * district + begin + step
    cell = there // side
    inside = (cell >= 0).all(axis=1) & (cell[:, 0] < across)
    number = cell[:, 0] + across * cell[:, 1]
    inside &= (number < chunks) & (step != 0).any(axis=1)
    rest = there - side * cell
    i = chunk * size + begin @ [side, 1]
    j = number * size + rest @ [side, 1]
    again = rng.random(len(i)) < anywhere
    again[: 2 * size] = False
    j[again] = rng.integers(chunks * size, size=np.count_nonzero(again))
    keep = (inside | again) & (i != j)
    i, j = i[keep], j[keep]
    noise = rotations(0.05 * rng.normal(size=(len(i), 3)))
    return Edges(i, j, truth(i).transpose(0, 2, 1) @ truth(j) @ noise, np.ones(len(i)))


def truth(nodes: np.ndarray) -> np.ndarray:
    """Rotations that any process can tell of any node."""
    return rotations(np.stack([np.sin(0.7 * nodes), np.cos(1.3 * nodes), np.sin(2.1 * nodes)], 1))


def rotations(rotvecs: np.ndarray) -> np.ndarray:
    """Matrices (k, 3, 3) of rotation vectors (k, 3)."""
    from rotavg.graph.conventions import matrices_from_rotvecs

    return np.asarray(matrices_from_rotvecs(rotvecs))


def chunks(arguments: argparse.Namespace) -> None:
    """A graph that no process holds."""
    count, size = arguments.parts[-1], (arguments.nodes, arguments.edges)
    made_by = [partial(made, k, count, *size, arguments.anywhere, 1) for k in range(count)]
    run = in_parts(
        made_by,
        arguments.workers[-1],
        arguments.parts[-1],
        tolerance=arguments.tolerance,
        max_rounds=arguments.max_rounds,
        callback=lambda r: print(
            f"round {r.number}: {r.objective:.12g}, {r.relative_gradient:.1e} rad, {r.kind}, "
            f"{r.seconds:.0f} s",
            flush=True,
        ),
    )
    print(
        f"{run.solution}\n{run.seconds:.0f} s, CPU {run.cpu:.0f} s of the workers and "
        f"{run.client_cpu:.0f} s of the client; largest worker {run.memory:.2f} GB, "
        f"client {run.client_memory:.2f} GB; {run.fetched:.1f} MB an exchange"
    )


def scheduler(arguments: argparse.Namespace) -> None:
    """What a task costs the process of scheduler and client; of a chain the end is held."""
    local, client = cluster(1)
    with local, client:
        future = client.submit(int, 0, pure=False)
        future.result()
        before, cpu = resident_bytes(), used()[1]
        for _ in range(arguments.tasks // 100):
            for _ in range(100):
                future = client.submit(np.add, future, 1, pure=False)
            future.result()
        each = (resident_bytes() - before) / arguments.tasks
        seconds = (used()[1] - cpu) / arguments.tasks
    print(f"{arguments.tasks} tasks: {each:.0f} bytes and {1e6 * seconds:.0f} us of CPU each")


def resident_bytes() -> int:
    """Of this process now."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """One of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = {
        "families": families,
        "rounds": rounds,
        "chunks": chunks,
        "scheduler": scheduler,
        "plan": plan,
    }
    parser.add_argument("what", choices=list(commands))
    parser.add_argument("--families", nargs="+", default=["sphere", "grid", "expander"])
    parser.add_argument("--nodes", type=whole, default=100_000)
    parser.add_argument("--edges", type=whole, default=1_000_000)
    parser.add_argument("--workers", type=int, nargs="+", default=[2])
    parser.add_argument("--parts", type=int, nargs="+", default=[2, 4, 8, 16, 32, 64])
    parser.add_argument("--anywhere", type=float, default=0.01)
    parser.add_argument("--tasks", type=int, default=10_000)
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--max-rounds", type=int, default=200, help="of chunks")
    add_arguments(parser)
    arguments = parser.parse_args()
    commands[arguments.what](arguments)


def whole(text: str) -> int:
    """A whole number, also as 1e8."""
    return int(float(text))


if __name__ == "__main__":
    main()
