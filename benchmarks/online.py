"""Online averaging, pose by pose: `rotavg.Online`, `solve` anew at every step, GTSAM's iSAM2.

    ./dev bench online {sphere2500,torus3D,parking-garage}.g2o
    ./dev bench online robot:100000 cubicles:6000

One thread. A step is a pose with all its edges to poses before it, in the order of their ids; the
weights are 1. `solve` is warm-started from the last rotations, with its proof, the graph made anew,
as a user would write it without `Online`; it is measured at some steps, spread evenly, iSAM2 at
all, or up to the time limit. CPU time of the thread: mean, median, 99th percentile and largest
milliseconds a step. The errors are (f - f*) / f*, f* by `solve` with its proof: the largest at
those steps; of iSAM2 at its end; of Online with other tolerances the largest gap that was proved.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs

Floats = NDArray[np.float64]


@dataclass
class Measured:
    """Seconds of every step that was measured, and the errors."""

    name: str
    steps: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)

    def row(self) -> str:
        """Of the table."""
        error = f"{max(self.errors):.1e}" if self.errors else "-"
        return f"| {self.name} | {len(self.seconds)} | {cells_of_times(self.seconds)} | {error} |"


def cells_of_times(seconds: list[float]) -> str:
    """Mean, median, 99th percentile and largest, in milliseconds, of a table."""
    ms = 1e3 * np.array(seconds)
    figures = [ms.mean(), np.median(ms), np.percentile(ms, 99), ms.max()]
    return " | ".join(f"{x:.3g}" for x in figures)


@dataclass
class Sequence:
    """Edges in the order in which their later pose comes; `begins` (n + 1,) of every step."""

    name: str
    edges: NDArray[np.int64]
    rotations: Floats
    begins: NDArray[np.int64]

    @property
    def num_steps(self) -> int:
        """How many poses come."""
        return len(self.begins) - 1

    def graph(self, step: int) -> rotavg.MeasurementGraph:
        """All edges up to and with a step, as a user makes a graph."""
        end = self.begins[step + 1]
        return rotavg.MeasurementGraph(self.edges[:end], self.rotations[:end])


def sequence(name: str, edges: NDArray[np.int64], rotations: Floats) -> Sequence:
    """Sort edges into steps."""
    later = edges.max(axis=1)
    order = np.lexsort((edges.min(axis=1) != later - 1, later))  # odometry first
    _, begins = np.unique(later[order], return_index=True)
    return Sequence(name, edges[order], rotations[order], np.append(begins, len(edges)))


def robot(name: str, n: int, width: float, closing: float, noise: float) -> Sequence:
    """A robot that walks through the streets of a square, and knows places where it was before."""
    random = np.random.default_rng(n)
    size = max(2, int(width * np.sqrt(n)))
    position, heading = np.array([size // 2, size // 2]), np.array([1, 0])
    last_at: dict[tuple[int, int], int] = {}
    edges: list[tuple[int, int]] = []
    for i in range(n):
        if i > 0:
            edges.append((i - 1, i))
            x, y = position.tolist()
            for dx, dy in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
                seen = last_at.get((x + dx, y + dy))
                if seen is not None and i - seen > 10 and random.uniform() < closing:
                    edges.append((seen, i))
        last_at[tuple(position.tolist())] = i
        if random.uniform() < 0.15:
            heading = np.array([-heading[1], heading[0]]) * random.choice([-1, 1])
        while ((position + heading < 0) | (position + heading >= size)).any():
            heading = np.array([-heading[1], heading[0]])
        position = position + heading
    truth = matrices_from_rotvecs(random.normal(size=(n, 3)))
    ends = np.array(edges)
    errors = matrices_from_rotvecs(random.normal(scale=noise, size=(len(ends), 3)))
    exact = np.swapaxes(truth[ends[:, 0]], 1, 2) @ truth[ends[:, 1]]
    return sequence(name, ends, exact @ errors)


def load(name: str) -> Sequence:
    """Of a file, `robot:N` or `cubicles:N`."""
    kind, _, size = name.partition(":")
    if kind == "robot":
        return robot(name, int(size), 1.0, 0.05, 0.01)
    if kind == "cubicles":  # few streets, walked again and again
        return robot(name, int(size), 0.4, 0.3, 0.02)
    graph = rotavg.read(name, unit_weights=True)
    return sequence(name.rsplit("/", 1)[-1], np.asarray(graph.edges), np.asarray(graph.rotations))


def error_of(f: float, graph: rotavg.MeasurementGraph, start: Floats) -> float:
    """How far an objective is above the optimum, as a part of it."""
    best = rotavg.solve(graph, init=start, num_threads=1).objective
    return 0.0 if best < 1e-20 * graph.num_edges else (f - best) / best


def add_step(online: rotavg.Online, data: Sequence, step: int) -> float:
    """The CPU seconds in which a step's edges are added, and proved."""
    rows = slice(data.begins[step], data.begins[step + 1])
    edges, rotations = data.edges[rows], data.rotations[rows]
    began = time.thread_time()
    online.add(edges, rotations)
    proved = online.verdict
    seconds = time.thread_time() - began
    assert proved == "proved", f"step {step} of {data.name}: {online}"
    return seconds


def measure_online(data: Sequence, checks: set[int]) -> tuple[Measured, Measured]:
    """Online, and `solve` from the same rotations at some steps."""
    ours, warm = Measured("Online"), Measured("solve, warm")
    online = rotavg.Online()
    for step in range(data.num_steps):
        start = next_start(online, data, step) if step in checks else None
        ours.seconds.append(add_step(online, data, step))
        if start is None:
            continue
        f = solve_warm(data, step, start, warm)
        ours.errors.append((online.objective - f) / max(f, 1e-20))
    return ours, warm


def next_start(online: rotavg.Online, data: Sequence, step: int) -> Floats:
    """What the step before left, and the new pose along its odometry edge."""
    known = online.rotations if online.num_nodes else np.eye(3)[None]
    first = data.begins[step]
    return np.concatenate([known, known[-1:] @ data.rotations[first : first + 1]])


def solve_warm(data: Sequence, step: int, start: Floats, warm: Measured) -> float:
    """All edges so far, solved and proved anew; the objective."""
    began = time.thread_time()
    solution = rotavg.solve(data.graph(step), init=start, num_threads=1)
    warm.seconds.append(time.thread_time() - began)
    warm.steps.append(step)
    return solution.objective


def measure_tolerance(
    data: Sequence, tolerance: float, checks: set[int]
) -> tuple[Measured, Measured]:
    """Online where this is enough, its error the largest gap that was proved; `solve` likewise."""
    ours, warm = Measured(f"Online, to {tolerance:g}"), Measured("solve, warm")
    online = rotavg.Online(tolerance=tolerance)
    largest = 0.0
    for step in range(data.num_steps):
        start = next_start(online, data, step) if step in checks else None
        ours.seconds.append(add_step(online, data, step))
        largest = max(largest, online.relative_gap)
        if start is not None:
            solve_warm(data, step, start, warm)
    ours.errors.append(largest)
    return ours, warm


def measure_isam(data: Sequence, limit: float) -> Measured:
    """GTSAM's iSAM2 with its defaults, but for relinearisation at every step."""
    import gtsam

    result = Measured("iSAM2")
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    isam = gtsam.ISAM2(parameters)
    model = gtsam.noiseModel.Isotropic.Precision(3, 1.0)
    rotation: dict[int, gtsam.Rot3] = {}
    for step in range(data.num_steps):
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for row in range(data.begins[step], data.begins[step + 1]):
            i, j = data.edges[row].tolist()
            R = gtsam.Rot3(data.rotations[row])
            if not rotation:
                first = gtsam.Rot3()
                factors.add(gtsam.PriorFactorRot3(i, first, model))
                values.insert(i, first)
                rotation[i] = first
            for new, known, turn in ((j, i, R), (i, j, R.inverse())):
                if new not in rotation:
                    before = isam.calculateEstimateRot3(known) if isam.valueExists(known) else first
                    rotation[new] = before.compose(turn)
                    values.insert(new, rotation[new])
            factors.add(gtsam.BetweenFactorRot3(i, j, R, model))
        began = time.thread_time()
        isam.update(factors, values)
        result.seconds.append(time.thread_time() - began)
        if sum(result.seconds) > limit:
            break
    graph = data.graph(len(result.seconds) - 1)
    estimate = isam.calculateEstimate()
    start = np.stack([estimate.atRot3(int(i)).matrix() for i in graph.nodes])
    result.errors.append(error_of(rotavg.objective(graph, start), graph, start))
    return result


def show(name: str, options: argparse.Namespace) -> None:
    """Measure one sequence, print its table."""
    data = load(name)
    print(f"\n**{data.name}**: {data.num_steps + 1} poses, {len(data.edges)} edges\n")
    print("| method | steps | mean | median | 99 % | largest | error |")
    print("|---" * 7 + "|")
    checks = set(np.linspace(1, data.num_steps - 1, options.count).astype(int).tolist())
    if not options.no_strict:
        for measured in measure_online(data, checks):
            print(measured.row(), flush=True)
    for tolerance in options.tolerances:
        # Where the strict one is left out, `solve` is measured beside these.
        ours, warm = measure_tolerance(data, tolerance, checks if options.no_strict else set())
        print(ours.row(), flush=True)
        if warm.seconds:
            print(warm.row(), flush=True)
    if not options.no_isam:
        print(measure_isam(data, options.time_limit).row(), flush=True)


def main() -> None:
    """Measure, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "names", nargs="+", metavar="GRAPH", help="a g2o file, robot:N or cubicles:N"
    )
    parser.add_argument("--count", type=int, default=50, help="steps at which solve() is measured")
    parser.add_argument("--time-limit", type=float, default=120.0, help="of iSAM2, seconds")
    parser.add_argument("--no-isam", action="store_true", help="leave GTSAM out")
    parser.add_argument(
        "--tolerances", nargs="*", type=float, default=[1e-3, 1e-2], help="others of Online"
    )
    parser.add_argument("--no-strict", action="store_true", help="leave Online to 1e-10 out")
    options = parser.parse_args()
    for name in options.names:
        show(name, options)


if __name__ == "__main__":
    main()
