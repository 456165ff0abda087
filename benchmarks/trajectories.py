"""Trajectories with wrong loop closures of many kinds: how often a robust loss finds the truth.

    python -m benchmarks.trajectories [--seeds 10] [--family NAME] [--nodes 1000] [--details]

Every family is a simulated trajectory, its odometry and its loop closures, with weights
1 / (2 sigma^2) unless it says otherwise. An answer is bad if its mean error is more than twice
that of least squares on the right edges alone, and half a degree more. A row is a family: how many
of its seeds are bad (and how many of these say so), the mean error in degrees, and CPU seconds.
"All alike" is `auto` with `trusted=[]`; steps that are wrong are not among the trusted ones.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.wrong_closures import Case
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs

Floats = NDArray[np.float64]

_RUN = 10  # wrong closures from one place to another


@dataclass(frozen=True)
class Family:
    """What a trajectory is like."""

    closures: int = 200
    wrong: float = 0.3  # of the closures
    how: str = "random"  # or "one turn", "places"
    drift: float = 0.005  # radians a step
    sigma: float = 0.02  # of a closure
    claimed: float | None = None  # sigma that wrong closures claim; None: that of the others
    even: bool = False  # all weights are 1
    slips: float = 0.0  # of the odometry
    rounds: int = 0  # poses a round, each of which sees that of the round before


FAMILIES = {
    "random": Family(),
    "random, half": Family(wrong=0.5),
    "random, a few closures": Family(closures=24, wrong=0.4),
    "one turn": Family(how="one turn"),
    "one turn, half": Family(how="one turn", wrong=0.5),
    "places": Family(how="places"),
    "places, half": Family(how="places", wrong=0.5),
    "random, drifting": Family(drift=0.03, sigma=0.03, wrong=0.4),
    "one turn, drifting": Family(how="one turn", drift=0.03, sigma=0.03, wrong=0.4),
    "random, wrong ones precise": Family(wrong=0.4, claimed=0.004),
    "one turn, wrong ones precise": Family(how="one turn", wrong=0.4, claimed=0.004),
    "random, even weights": Family(wrong=0.4, even=True, drift=0.02, sigma=0.02),
    "one turn, even weights": Family(how="one turn", wrong=0.4, even=True, drift=0.02, sigma=0.02),
    "slips": Family(slips=0.01),
    "slips, one turn": Family(how="one turn", slips=0.01),
    "rounds": Family(rounds=40, closures=230, wrong=1.0, drift=0.05, sigma=0.05),
    "rounds, slips": Family(rounds=40, closures=230, wrong=1.0, drift=0.02, sigma=0.02, slips=0.02),
    "rounds, places": Family(
        rounds=40, closures=230, wrong=1.0, how="places", drift=0.05, sigma=0.05
    ),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--family", action="append", choices=list(FAMILIES), default=None)
    parser.add_argument("--nodes", type=int, default=1000, help="300 or more")
    parser.add_argument("--details", action="store_true", help="one line an answer")
    arguments = parser.parse_args()
    ways: dict[str, Callable[[Case], rotavg.Solution]] = {
        "auto": lambda case: _solve(case, "auto"),
        "auto, all alike": lambda case: _solve(case, "auto", np.zeros_like(case.is_odometry)),
        "auto, trusted": lambda case: _solve(case, "auto", case.is_odometry),
        "tls, trusted": lambda case: _solve(case, "tls", case.is_odometry),
    }
    print("| family | right edges alone | " + " | ".join(ways) + " |")
    print("|---" * (len(ways) + 2) + "|")
    for name in arguments.family or FAMILIES:
        _row(name, arguments, ways)


def _row(
    name: str, arguments: argparse.Namespace, ways: dict[str, Callable[[Case], rotavg.Solution]]
) -> None:
    seeds = range(arguments.seeds)
    cases = [trajectory(FAMILIES[name], arguments.nodes, seed) for seed in seeds]
    least = [_error(_right_ones(case), case) for case in cases]
    cells = []
    for way, solve in ways.items():
        errors, bad, told, seconds = [], 0, 0, 0.0
        for seed, case in enumerate(cases):
            began = time.process_time()
            solution = solve(case)
            seconds += time.process_time() - began
            errors.append(_error(solution, case))
            is_bad = errors[-1] > 2 * least[seed] + 0.5
            bad += is_bad
            lines = str(solution)
            told += is_bad and any(word in lines for word in ("odometry?", "alternative"))
            if arguments.details:
                why = f"; {solution.reason}" if is_bad else ""
                told_of = f"{errors[-1]:.3g} of {least[seed]:.3g} deg"
                print(f"{name}, seed {seed}, {way}: {told_of}{why}", file=sys.stderr)
        told_so = f" ({told} told)" if bad else ""
        cells.append(f"{bad}{told_so}, {np.mean(errors):.3g}, {seconds / len(cases):.2g} s")
    print(f"| {name} | {np.mean(least):.3g} | " + " | ".join(cells) + " |", flush=True)


def _solve(case: Case, loss: str, trusted: NDArray[np.bool_] | None = None) -> rotavg.Solution:
    return rotavg.solve(case.graph, loss=loss, trusted=trusted, certify=False, num_threads=1)


def _right_ones(case: Case) -> rotavg.Solution:
    graph, right = case.graph, ~case.is_wrong
    part = rotavg.MeasurementGraph(
        graph.edges[right], graph.rotations[right], graph.weights[right], graph.nodes
    )
    return rotavg.solve(part, certify=False, num_threads=1)


def _error(solution: rotavg.Solution, case: Case) -> float:
    return float(np.degrees(rotavg.compare(solution, case.reference).mean))


def trajectory(family: Family, nodes: int, seed: int) -> Case:
    """One of a family."""
    rng = np.random.default_rng(seed)
    truth = [np.eye(3)]
    for step in matrices_from_rotvecs(rng.normal(0, 0.2, (nodes - 1, 3))):
        truth.append(truth[-1] @ step)
    T = np.array(truth)
    odometry = np.stack([np.arange(nodes - 1), np.arange(1, nodes)], axis=1)
    ends, is_wrong, right_rounds = _closures(rng, family, nodes)
    edges = np.concatenate([odometry, right_rounds, ends])
    wrong = np.zeros(len(edges), dtype=bool)
    wrong[len(edges) - len(ends) :] = is_wrong
    is_odometry = np.arange(len(edges)) < len(odometry)
    slipped = is_odometry & (rng.random(len(edges)) < family.slips)
    sigma = np.where(is_odometry, family.drift, family.sigma)
    noise = matrices_from_rotvecs(rng.normal(size=(len(edges), 3)) * sigma[:, None])
    R = np.swapaxes(T[edges[:, 0]], 1, 2) @ T[edges[:, 1]] @ noise
    turns = _turns(rng, family, int(wrong.sum()))
    if family.how == "places":  # all of a run turn one place against the other
        at = T[edges[wrong, 1]]
        R[wrong] = R[wrong] @ np.swapaxes(at, 1, 2) @ turns @ at
    else:
        R[wrong] = R[wrong] @ turns
    R[slipped] = R[slipped] @ matrices_from_rotvecs(rng.normal(0, 0.5, (int(slipped.sum()), 3)))
    if family.claimed is not None:
        sigma = np.where(wrong, family.claimed, sigma)
    weights = np.ones(len(edges)) if family.even else 1 / (2 * sigma**2)
    graph = rotavg.MeasurementGraph(edges, R, weights)
    return Case("", graph, is_odometry & ~slipped, wrong | slipped, T)


def _closures(
    rng: np.random.Generator, family: Family, nodes: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    """Closures, which of them are wrong, and those of rounds."""
    rounds = np.zeros((0, 2), dtype=np.int64)
    if family.rounds:
        first = np.arange(nodes - family.rounds)
        rounds = np.stack([first, first + family.rounds], axis=1)
    ends = np.sort(rng.integers(0, nodes - _RUN, (4 * family.closures, 2)), axis=1)
    ends = ends[ends[:, 1] - ends[:, 0] > 20][: family.closures]
    is_wrong = rng.random(len(ends)) < family.wrong
    if family.how == "places":
        wrong = np.flatnonzero(is_wrong)
        along = np.arange(len(wrong)) % _RUN
        ends[wrong] = ends[wrong][np.arange(len(wrong)) - along] + along[:, None]
    return ends, is_wrong, rounds


def _turns(rng: np.random.Generator, family: Family, count: int) -> Floats:
    """What wrong closures are turned by, (count, 3, 3)."""
    if family.how == "one turn":
        return np.repeat(matrices_from_rotvecs(np.array([[0.0, 0.0, 1.5]])), count, axis=0)
    turns = np.asarray(matrices_from_quaternions(rng.normal(size=(count, 4))))
    if family.how == "places":
        turns = turns[np.arange(count) - np.arange(count) % _RUN]
    return turns


if __name__ == "__main__":
    main()
