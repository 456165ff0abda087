"""Pose graphs some of whose loop closures are wrong: robust losses, and GTSAM's GNC beside them.

    python -m benchmarks.wrong_closures [FILE.g2o ...] [--seeds 8] [--no-peers]

Every file gets as many random closures as thirty per cent of those that it has, and then five
groups of ten that agree among themselves, as of two places that look alike. Beside them stand
trajectories that are made up: odometry of .001 rad, closures of .01 rad (weights 1 / (2 sigma^2)),
thirty per cent of them random. Errors are mean angles, degrees: to the solution of the file as it
is, or to the truth; seconds are CPU seconds of one thread.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A graph, which of its edges are odometry, which are wrong, and rotations to compare with."""

    name: str
    graph: rotavg.MeasurementGraph
    is_odometry: NDArray[np.bool_]
    is_wrong: NDArray[np.bool_]
    reference: Any


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path, nargs="*", help="pose graphs in the order of their ids")
    parser.add_argument("--seeds", type=int, default=8, help="of trajectories")
    parser.add_argument("--no-peers", action="store_true", help="without GTSAM")
    arguments = parser.parse_args()
    ways: dict[str, Callable[[Case], tuple[Any, NDArray[np.bool_]]]] = {
        "auto": lambda case: _ours(case, loss="auto"),
        "auto, odometry trusted": lambda case: _ours(case, loss="auto", trusted=case.is_odometry),
        "tls, odometry trusted": lambda case: _ours(case, loss="tls", trusted=case.is_odometry),
    }
    if not arguments.no_peers:
        ways["GTSAM's GNC, odometry known"] = _gnc
    print("| graph | " + " | ".join(ways) + " |")
    print("|---" * (len(ways) + 1) + "|")
    for path in arguments.files:
        _row([with_random(path)], ways)
        _row([with_groups(path)], ways)
    for nodes, closures in ((2000, 30), (2000, 100), (5000, 300)):
        _row([_trajectory(nodes, closures, seed) for seed in range(arguments.seeds)], ways)


def _row(cases: list[Case], ways: dict[str, Any]) -> None:
    cells = []
    for way in ways.values():
        errors, missed, accused, seconds = [], 0, 0, []
        for case in cases:
            start = time.process_time()
            rotations, rejected = way(case)
            seconds.append(time.process_time() - start)
            errors.append(np.degrees(rotavg.compare(rotations, case.reference).mean))
            missed += int((case.is_wrong & ~rejected).sum())
            accused += int((rejected & ~case.is_wrong).sum())
        cells.append(
            f"{np.mean(errors):.3g} (largest {np.max(errors):.3g}), {missed} missed, "
            f"{accused} right ones rejected, {np.median(seconds):.2g} s"
        )
    wrong, seeds = sum(int(case.is_wrong.sum()) for case in cases), len(cases)
    of_seeds = f", {seeds} seeds" if seeds > 1 else ""
    print(f"| {cases[0].name}{of_seeds}: {wrong} wrong | " + " | ".join(cells) + " |", flush=True)


def _ours(case: Case, **settings: Any) -> tuple[Any, NDArray[np.bool_]]:
    solution = rotavg.solve(case.graph, certify=False, num_threads=1, **settings)
    return solution, np.asarray(solution.is_outlier)


def _gnc(case: Case) -> tuple[Any, NDArray[np.bool_]]:
    import gtsam

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    deviations = 1 / np.sqrt(2 * case.graph.weights)
    for (i, j), R, sigma in zip(case.graph.indices.tolist(), case.graph.rotations, deviations):
        noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma)
        graph.add(gtsam.BetweenFactorRot3(i, j, gtsam.Rot3(R), noise))
    first = gtsam.noiseModel.Isotropic.Sigma(3, float(deviations.min()))
    graph.add(gtsam.PriorFactorRot3(0, gtsam.Rot3(), first))
    where = dict(zip(map(tuple, case.graph.indices.tolist()), case.graph.rotations))
    R = np.eye(3)
    values.insert(0, gtsam.Rot3(R))
    for k in range(1, case.graph.num_nodes):
        R = R @ where[k - 1, k]
        values.insert(k, gtsam.Rot3(R))
    parameters = gtsam.GncLMParams()
    parameters.setKnownInliers([*np.flatnonzero(case.is_odometry).tolist(), case.graph.num_edges])
    optimizer = gtsam.GncLMOptimizer(graph, values, parameters)
    found = optimizer.optimize()
    ids = case.graph.nodes.tolist()
    rotations = {ids[k]: found.atRot3(k).matrix() for k in range(len(ids))}
    return rotations, np.asarray(optimizer.getWeights())[:-1] < 0.5


def _trajectory(nodes: int, closures: int, seed: int) -> Case:
    rng = np.random.default_rng(seed)
    truth = [np.eye(3)]
    for step in matrices_from_rotvecs(rng.normal(0, 0.2, (nodes - 1, 3))):
        truth.append(truth[-1] @ step)
    T = np.array(truth)
    ends = rng.integers(0, nodes, (closures, 2))
    ends = ends[np.abs(ends[:, 0] - ends[:, 1]) > 100]
    odometry = np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1)
    edges = np.concatenate([odometry, ends])
    is_odometry = np.arange(len(edges)) < nodes - 1
    sigma = np.where(is_odometry, 0.001, 0.01)
    noise = matrices_from_rotvecs(rng.normal(size=(len(edges), 3)) * sigma[:, None])
    R = np.swapaxes(T[edges[:, 0]], 1, 2) @ T[edges[:, 1]] @ noise
    is_wrong = ~is_odometry & (rng.random(len(edges)) < 0.3)
    R[is_wrong] = _random(rng, int(is_wrong.sum()))
    graph = rotavg.MeasurementGraph(edges, R, 1 / (2 * sigma**2))
    name = f"trajectory of {nodes} poses, {closures} closures"
    return Case(name, graph, is_odometry, is_wrong, T)


def with_random(path: Path, unit_weights: bool = False) -> Case:
    """A file with thirty per cent more closures, which are random."""
    graph = rotavg.read(path, unit_weights=unit_weights)
    rng = np.random.default_rng(5)
    closures = int((~_consecutive(graph.indices)).sum())
    ends = rng.integers(0, graph.num_nodes, (int(0.3 * closures), 2))
    ends = ends[np.abs(ends[:, 0] - ends[:, 1]) > 5]
    return _contaminated(f"{path.stem}, random", graph, ends, _random(rng, len(ends)))


def with_groups(path: Path, unit_weights: bool = False) -> Case:
    """A file with five groups of ten wrong closures that agree among themselves."""
    graph = rotavg.read(path, unit_weights=unit_weights)
    T = rotavg.solve(graph).rotations
    rng = np.random.default_rng(5)
    ends, rotations = [], []
    while len(ends) < 50:
        i, j = rng.integers(0, graph.num_nodes - 30, 2).tolist()
        if abs(i - j) < 20:
            continue
        turn = _random(rng, 1)[0]
        for k in range(10):
            ends.append((i + k, j + k))
            noise = matrices_from_rotvecs(rng.normal(0, 0.01, (1, 3)))[0]
            rotations.append(T[i + k].T @ turn @ T[j + k] @ noise)
    return _contaminated(f"{path.stem}, groups", graph, np.array(ends), np.array(rotations))


def _contaminated(
    name: str, graph: rotavg.MeasurementGraph, ends: NDArray[Any], rotations: Floats
) -> Case:
    weights = np.concatenate([graph.weights, np.full(len(ends), np.median(graph.weights))])
    more = rotavg.MeasurementGraph(
        np.concatenate([graph.edges, graph.nodes[ends]]),
        np.concatenate([graph.rotations, rotations]),
        weights,
        graph.nodes,
    )
    is_wrong = np.arange(more.num_edges) >= graph.num_edges
    return Case(name, more, _consecutive(more.indices) & ~is_wrong, is_wrong, rotavg.solve(graph))


def _consecutive(indices: NDArray[Any]) -> NDArray[np.bool_]:
    return np.asarray(np.abs(indices[:, 1] - indices[:, 0]) == 1)


def _random(rng: np.random.Generator, count: int) -> Floats:
    return np.asarray(matrices_from_quaternions(rng.normal(size=(count, 4))))


if __name__ == "__main__":
    main()
