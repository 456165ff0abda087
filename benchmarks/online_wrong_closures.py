"""Online, while some of the loop closures that come are wrong.

    python -m benchmarks.online_wrong_closures FILE.g2o ... [--scale DEGREES] [--no-peers]

The graphs are those of benchmarks/wrong_closures.py, with weights 1: a step is a pose with all its
edges to poses before it, in the order of their ids, and odometry is trusted. Beside Online with the
truncated loss stand iSAM2 with Cauchy's loss on the closures (each of the same scale), and the
whole graph solved at the end, as one. CPU milliseconds of one thread a step: mean, median, 99th
percentile, largest. Errors are mean angles, degrees, to the solution of the file as it is: at the
end, and the largest at ten steps on the way, to what the right edges alone would have given then.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.online import cells_of_times
from benchmarks.wrong_closures import Case, Floats, with_groups, with_random


@dataclass
class _Stream:
    """A case whose edges come in steps; `begins` (n + 1,) of every step."""

    name: str
    edges: NDArray[np.int64]
    rotations: Floats
    is_wrong: NDArray[np.bool_]
    is_odometry: NDArray[np.bool_]
    begins: NDArray[np.int64]

    def right_until(self, step: int) -> rotavg.MeasurementGraph:
        """The right edges of all steps up to this one."""
        rows = np.flatnonzero(~self.is_wrong[: self.begins[step + 1]])
        return rotavg.MeasurementGraph(self.edges[rows], self.rotations[rows])


@dataclass
class _Row:
    """Of a table: seconds of the steps, errors at the checks, and what was misjudged at the end."""

    name: str
    seconds: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    missed: int = 0
    accused: int = 0

    def __str__(self) -> str:
        return (
            f"| {self.name} | {cells_of_times(self.seconds)} | {self.errors[-1]:.3g} "
            f"| {max(self.errors):.3g} | {self.missed} | {self.accused} |"
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+", help="pose graphs in the order of their ids")
    parser.add_argument("--scale", type=float, default=12.0, help="of the losses, degrees")
    parser.add_argument("--no-peers", action="store_true", help="without GTSAM")
    arguments = parser.parse_args()
    scale = np.radians(arguments.scale)
    for path in arguments.files:
        for contaminated in (with_random, with_groups):
            stream = _stream(contaminated(path, unit_weights=True))
            print(
                f"\n**{stream.name}**: {len(stream.begins)} poses, {len(stream.edges)} edges, "
                f"{stream.is_wrong.sum()} wrong\n\n| method | mean | median | 99 % | largest "
                "| error | worst on the way | missed | right ones rejected |"
            )
            print("|---" * 9 + "|")
            print(_online(stream, scale), flush=True)
            print(_at_once(stream, scale), flush=True)
            if not arguments.no_peers:
                print(_isam(stream, scale), flush=True)


def _stream(case: Case) -> _Stream:
    edges = np.asarray(case.graph.edges)
    later = edges.max(axis=1)
    order = np.lexsort((~case.is_odometry, later))
    _, begins = np.unique(later[order], return_index=True)
    return _Stream(
        case.name,
        edges[order],
        np.asarray(case.graph.rotations)[order],
        case.is_wrong[order],
        case.is_odometry[order],
        np.append(begins, len(edges)),
    )


def _checks(stream: _Stream) -> set[int]:
    steps = len(stream.begins) - 1
    return set(np.linspace(steps // 10, steps - 1, 10).astype(int).tolist())


def _error(rotations: object, stream: _Stream, step: int) -> float:
    best = rotavg.solve(stream.right_until(step), num_threads=1, certify=False)
    return float(np.degrees(rotavg.compare(rotations, best).mean))


def _online(stream: _Stream, scale: float) -> _Row:
    row = _Row("Online, tls")
    online = rotavg.Online(loss="tls", loss_scale=scale)
    checks = _checks(stream)
    for step in range(len(stream.begins) - 1):
        rows = slice(stream.begins[step], stream.begins[step + 1])
        began = time.thread_time()
        online.add(stream.edges[rows], stream.rotations[rows], trusted=stream.is_odometry[rows])
        row.seconds.append(time.thread_time() - began)
        if step in checks:
            row.errors.append(_error(online.solution, stream, step))
    rejected = np.asarray(online.edge_weights) < 0.5
    row.missed = int((stream.is_wrong & ~rejected).sum())
    row.accused = int((rejected & ~stream.is_wrong).sum())
    return row


def _at_once(stream: _Stream, scale: float) -> _Row:
    row = _Row("solve, tls, at the end")
    graph = rotavg.MeasurementGraph(stream.edges, stream.rotations)
    began = time.thread_time()
    solution = rotavg.solve(
        graph, loss="tls", loss_scale=scale, trusted=stream.is_odometry, num_threads=1
    )
    row.seconds.append(time.thread_time() - began)
    row.errors.append(_error(solution, stream, len(stream.begins) - 2))
    row.missed = int((stream.is_wrong & ~solution.is_outlier).sum())
    row.accused = int((solution.is_outlier & ~stream.is_wrong).sum())
    return row


def _isam(stream: _Stream, scale: float) -> _Row:
    import gtsam

    row = _Row("iSAM2, Cauchy")
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    isam = gtsam.ISAM2(parameters)
    plain = gtsam.noiseModel.Isotropic.Precision(3, 1.0)
    robust = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy(scale), plain)
    checks = _checks(stream)
    known: set[int] = set()
    for step in range(len(stream.begins) - 1):
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for k in range(stream.begins[step], stream.begins[step + 1]):
            i, j = stream.edges[k].tolist()
            R = gtsam.Rot3(stream.rotations[k])
            if not known:
                factors.add(gtsam.PriorFactorRot3(i, gtsam.Rot3(), plain))
                values.insert(i, gtsam.Rot3())
                known.add(i)
            for new, old, turn in ((j, i, R), (i, j, R.inverse())):
                if new not in known:
                    there = isam.valueExists(old)
                    at_old = isam.calculateEstimateRot3(old) if there else values.atRot3(old)
                    values.insert(new, at_old.compose(turn))
                    known.add(new)
            factors.add(
                gtsam.BetweenFactorRot3(i, j, R, plain if stream.is_odometry[k] else robust)
            )
        began = time.thread_time()
        isam.update(factors, values)
        row.seconds.append(time.thread_time() - began)
        if step in checks:
            estimate = isam.calculateEstimate()
            found = {int(i): estimate.atRot3(int(i)).matrix() for i in known}
            row.errors.append(_error(found, stream, step))
    estimate = isam.calculateEstimate()
    for (i, j), R, wrong, odometry in zip(
        stream.edges.tolist(), stream.rotations, stream.is_wrong, stream.is_odometry
    ):
        off = estimate.atRot3(i).matrix() @ R - estimate.atRot3(j).matrix()
        angle = 2 * np.arcsin(min(1.0, float(np.linalg.norm(off)) / np.sqrt(8)))
        rejected = not odometry and angle > scale  # less than half of the weight is left
        row.missed += int(wrong and not rejected)
        row.accused += int(rejected and not wrong)
    return row


if __name__ == "__main__":
    main()
