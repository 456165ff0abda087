"""The graphs to solve: files by path, simulations by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Callable

import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.problem import Problem
from rotavg.graph.conventions import matrices_from_rotvecs

SEED = 1


@dataclass(frozen=True, eq=False)
class Case:
    """A connected graph by name."""

    name: str
    graph: rotavg.MeasurementGraph

    def problem(self) -> Problem:
        """What the solvers get."""
        graph = self.graph
        return Problem(graph.indices, graph.rotations, graph.weights, shortest_path_start(graph))


def shortest_path_start(graph: rotavg.MeasurementGraph) -> NDArray[np.float64]:
    """Products (n, 3, 3) of the measurements along shortest paths (Lemma 3)."""
    return rotavg.solve(graph, init="shortest_path", max_iterations=0, certify=False).rotations


def load(name: str, *, file_weights: bool = False) -> Case:
    """The case of a file's path or a simulation's name.

    A file's edges have weight 1 unless `file_weights`; of several components the largest is taken.
    """
    if name in SIMULATIONS:
        return Case(name, SIMULATIONS[name]())
    path = Path(name)
    graph = rotavg.read(path, unit_weights=not file_weights)
    return Case(path.stem, graph.largest_component())


def _simulated(kind: str, n: int, **options: float) -> rotavg.MeasurementGraph:
    return rotavg.simulate(kind, n, seed=SEED, **options).graph


def _band(n: int, noise: float, closures: int) -> rotavg.MeasurementGraph:
    """Each node joined to the next 9, and `closures` edges between random nodes."""
    simulation = rotavg.simulate("band", n, noise=noise, loop_closures=0, seed=SEED)
    graph = simulation.graph
    if closures == 0:
        return graph
    rng = np.random.default_rng(SEED)
    i = rng.integers(n, size=closures)
    j = (i + rng.integers(10, n - 9, size=closures)) % n  # further away than the band reaches
    R = simulation.ground_truth
    axes = rng.standard_normal((closures, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    off = matrices_from_rotvecs(rng.normal(0, noise, (closures, 1)) * axes)
    return rotavg.MeasurementGraph(
        np.concatenate([graph.edges, np.column_stack([i, j])]),
        np.concatenate([graph.rotations, np.swapaxes(R[i], 1, 2) @ R[j] @ off]),
        nodes=graph.nodes,
    )


def _measured(
    i: NDArray[np.int64], j: NDArray[np.int64], n: int, noise: float
) -> rotavg.MeasurementGraph:
    """The edges (i, j) between random rotations, each pair once."""
    pairs = np.unique(np.sort(np.column_stack([i, j]), axis=1), axis=0)
    i, j = pairs[pairs[:, 0] != pairs[:, 1]].T
    rng = np.random.default_rng(SEED)
    R = matrices_from_rotvecs(rng.uniform(-2, 2, (n, 3)))
    axes = rng.standard_normal((len(i), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    off = matrices_from_rotvecs(rng.normal(0, noise, (len(i), 1)) * axes)
    return rotavg.MeasurementGraph(
        np.column_stack([i, j]), np.swapaxes(R[i], 1, 2) @ R[j] @ off, nodes=np.arange(n)
    )


def _random(n: int, degree: int, noise: float) -> rotavg.MeasurementGraph:
    """A cycle, and each node joined to random ones, `degree` edges at a node on average."""
    rng = np.random.default_rng(SEED)
    nodes = np.arange(n)
    i = np.concatenate([nodes, np.repeat(nodes, degree // 2 - 1)])
    j = np.concatenate([(nodes + 1) % n, rng.integers(n, size=n * (degree // 2 - 1))])
    return _measured(i, j, n, noise)


def _city(side: int, noise: float) -> rotavg.MeasurementGraph:
    """Dense neighbourhoods of 50 nodes on a square grid, with three links to each neighbour."""
    rng = np.random.default_rng(SEED)
    size, links, blocks = 50, 3, np.arange(side * side)
    a, b = np.triu_indices(size, 1)
    a, b = a[(b - a) % 3 == 1], b[(b - a) % 3 == 1]
    i, j = [(blocks[:, None] * size + a).ravel()], [(blocks[:, None] * size + b).ravel()]
    for from_, to in (
        (blocks[blocks % side < side - 1], 1),
        (blocks[blocks < side * (side - 1)], side),
    ):
        ends = rng.integers(size, size=(2, len(from_), links))
        i.append((from_[:, None] * size + ends[0]).ravel())
        j.append(((from_ + to)[:, None] * size + ends[1]).ravel())
    return _measured(np.concatenate(i), np.concatenate(j), size * side * side, noise)


SIMULATIONS: dict[str, Callable[[], rotavg.MeasurementGraph]] = {
    "sphere-300": partial(_simulated, "sphere", 300, noise=0.1),
    "complete-150": partial(_simulated, "complete", 150, noise=0.2),
    "band-500": partial(_band, 500, 0.1, 500),
    "complete-2000-0.2": partial(_simulated, "complete", 2000, noise=0.2),
    "complete-2000-0.5": partial(_simulated, "complete", 2000, noise=0.5),
    "random-3000": partial(_simulated, "erdos_renyi", 3000, density=0.4, noise=0.2),
    "sphere-2500": partial(_simulated, "sphere", 2500, noise=0.1),
    "sphere-50000": partial(_simulated, "sphere", 50_000, noise=0.05),
    "grid-3000": partial(_simulated, "grid", 3000, noise=0.05),
    "grid-36000": partial(_simulated, "grid", 36_000, noise=0.05),
    "erdos-renyi-25000": partial(_random, 25_000, 8, 0.05),
    "expander-500": partial(_random, 500, 22, 0.05),
    "expander-10000": partial(_random, 10_000, 22, 0.05),
    "band-11000": partial(_band, 11_500, 0.05, 0),
    "city-11000": partial(_city, 15, 0.05),
    "band-100000": partial(_band, 100_000, 0.1, 0),
    "band-100000-closures": partial(_band, 100_000, 0.1, 100_000),
}

SETS: dict[str, tuple[str, ...]] = {
    "small": ("sphere-300", "complete-150", "band-500"),
    "dense": ("complete-2000-0.2", "complete-2000-0.5", "random-3000"),
    "band": ("band-100000", "band-100000-closures"),
}
SETS["all"] = tuple(name for names in SETS.values() for name in names)


def unknown(names: Iterable[str]) -> list[str]:
    """Those that are neither a simulation nor a file."""
    return [name for name in names if name not in SIMULATIONS and not Path(name).is_file()]
