"""Graphs in parts: objective, rounds and memory, beside one process.

    python -m benchmarks.distributed families --workers 1 2 4    # n = 1e5, three families
    python -m benchmarks.distributed rounds --parts 2 4 8 16 32 64
    python -m benchmarks.distributed chunks --nodes 3000000 --edges 30000000 --workers 4 --parts 32

Each prints a table. `chunks` makes the measurements chunk by chunk on the workers, so that no
process ever holds the graph, and tells the largest memory of any.
"""

from __future__ import annotations

import argparse
import resource
import time
from functools import partial
from typing import Any

import numpy as np

import rotavg
from rotavg.distributed import DistributedSolution, Edges, solve


def family(name: str, n: int) -> rotavg.MeasurementGraph:
    """A graph of about n nodes: a sphere's trajectory, a grid, or an expander of degree 22."""
    if name == "expander":
        return rotavg.simulate("erdos_renyi", n, noise=0.1, density=22.0 / n, seed=1).graph
    return rotavg.simulate(name, n, noise=0.05, seed=1).graph


def peak_gigabytes() -> float:
    """Of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def cluster(workers: int) -> tuple[Any, Any]:
    """So many processes on this machine, and their client."""
    from distributed import Client, LocalCluster

    local = LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address=":0", memory_limit=0
    )
    return local, Client(local)


def in_parts(source: Any, workers: int, parts: int, **options: Any) -> tuple[Any, ...]:
    """The solution, seconds, and the largest memory of a worker and of the client in GB."""
    local, client = cluster(workers)
    with local, client:
        begin = time.perf_counter()
        solution = solve(source, client=client, parts=parts, **options)
        seconds = time.perf_counter() - begin
        memory = max(client.run(peak_gigabytes).values())
    return solution, seconds, memory, peak_gigabytes()


def row(solution: DistributedSolution, seconds: float, memory: float, objective: float) -> str:
    """Of a table."""
    solved = [r for r in solution.rounds if r.objective <= objective * (1.0 + 1e-9)]
    certificate = solution.certificate
    verdict = "" if certificate is None else f"{certificate.verdict} ({certificate.method})"
    return (
        f"| {solution.num_parts} | {solved[0].number if solved else '-'} | "
        f"{solution.rounds[-1].number} | {solution.objective / objective - 1.0:.1e} | {verdict} | "
        f"{solution.rounds[-1].seconds:.1f} | {seconds:.1f} | {memory:.2f} |"
    )


HEAD = (
    "| parts | rounds to 1e-9 | rounds | objective, relative to one process | certificate | "
    "rounds, s | all, s | largest worker, GB |\n|" + "---|" * 8
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
            solution, seconds, memory, _ = in_parts(graph, workers, workers)
            print(row(solution, seconds, memory, alone.objective), flush=True)


def rounds(arguments: argparse.Namespace) -> None:
    """Rounds by the number of parts."""
    for name in arguments.families:
        graph = family(name, arguments.nodes)
        alone = rotavg.solve(graph, tolerance=1e-10, certify=False)
        print(f"\n{name}: {len(graph.nodes)} nodes, {len(graph.edges)} edges\n\n{HEAD}")
        for parts in arguments.parts:
            solution, seconds, memory, _ = in_parts(
                graph, arguments.workers[-1], parts, certify=False
            )
            print(row(solution, seconds, memory, alone.objective), flush=True)


def made(chunk: int, chunks: int, nodes: int, edges: int, seed: int) -> Edges:
    """A city's district: nodes on a square of a lattice, joined to others within three steps, also
    of the districts around; one edge in a hundred leads anywhere (a place seen again).
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
    again = rng.random(len(i)) < 0.01
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
    made_by = [
        partial(made, k, arguments.parts[-1], arguments.nodes, arguments.edges, 1)
        for k in range(arguments.parts[-1])
    ]
    solution, seconds, memory, here = in_parts(
        made_by,
        arguments.workers[-1],
        arguments.parts[-1],
        tolerance=arguments.tolerance,
        callback=lambda r: print(
            f"round {r.number}: {r.objective:.12g}, {r.relative_gradient:.1e} rad, {r.kind}, "
            f"{r.seconds:.0f} s",
            flush=True,
        ),
    )
    print(f"{solution}\n{seconds:.0f} s; largest worker {memory:.2f} GB, client {here:.2f} GB")


def main() -> None:
    """One of the three."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["families", "rounds", "chunks"])
    parser.add_argument("--families", nargs="+", default=["sphere", "grid", "expander"])
    parser.add_argument("--nodes", type=int, default=100_000)
    parser.add_argument("--edges", type=int, default=1_000_000)
    parser.add_argument("--workers", type=int, nargs="+", default=[2])
    parser.add_argument("--parts", type=int, nargs="+", default=[2, 4, 8, 16, 32, 64])
    parser.add_argument("--tolerance", type=float, default=1e-6)
    arguments = parser.parse_args()
    {"families": families, "rounds": rounds, "chunks": chunks}[arguments.what](arguments)


if __name__ == "__main__":
    main()
