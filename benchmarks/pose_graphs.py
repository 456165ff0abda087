"""Pose graphs: how good a start rotavg's output is, measured by GTSAM.

    python -m benchmarks.pose_graphs {sphere2500,torus3D,parking-garage}.g2o

For each file, `rotavg.write` writes the averaged rotations and the positions that fit them, GTSAM
reads that file, and its Levenberg-Marquardt and Gauss-Newton go on from there; the same from
GTSAM's own chordal initialisation (InitializePose3). chi^2 is twice GTSAM's error of the between
factors, with the information in the file. Prints a table and draws each graph before and after.
rotavg's times include reading, the certificate and writing; GTSAM's do not include reading. The
last column is `rotavg.refine_poses`, its chi^2 counted by GTSAM, its time CPU seconds.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

import rotavg

mpl.use("Agg")
import gtsam
import matplotlib.pyplot as plt
from PIL import Image

HEAD = (
    "graph", "nodes / edges", "the file's poses", "rotavg", "GTSAM chordal",
    "LM from rotavg", "LM from chordal", "GN from rotavg", "GN from chordal", "refine_poses",
)  # fmt: skip


def main() -> None:
    """Measure, print the table, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.g2o")
    parser.add_argument("--out", type=Path, default=Path("build/pose_graphs"), metavar="FOLDER")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(" | ".join(["", *HEAD, ""]).strip())
    print("|" + "---|" * len(HEAD))
    count = len(arguments.files)
    picture = plt.figure(figsize=(10, 4.6 * count), layout="constrained")
    for k, path in enumerate(arguments.files):
        panels = [picture.add_subplot(count, 2, 2 * k + side, projection="3d") for side in (1, 2)]
        print(" | ".join(["", *row(path, arguments.out, panels), ""]).strip(), flush=True)
    target = arguments.out / "pose_graphs.png"
    picture.savefig(target, dpi=72)
    Image.open(target).quantize(64).save(target, optimize=True)


def row(path: Path, out: Path, panels: list[Any]) -> list[str]:
    """A row of the table: chi^2, and what it took; also draws the graph into two panels."""
    factors, given = gtsam.readG2o(str(path), True)

    started = time.perf_counter()
    graph = rotavg.read(path)
    solution = rotavg.solve(graph, num_threads=1)
    rotavg.write(out / path.name, solution)
    ours = time.perf_counter() - started
    _, solved = gtsam.readG2o(str(out / path.name), True)
    started = time.process_time()
    poses = rotavg.refine_poses(solution)
    refining = time.process_time() - started
    rotavg.write(out / f"refined_{path.name}", poses)
    _, refined = gtsam.readG2o(str(out / f"refined_{path.name}"), True)

    # One pose must be held, in the chordal relaxation and in every optimiser.
    held = gtsam.NonlinearFactorGraph(factors)
    first = min(given.keys())
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    held.add(gtsam.PriorFactorPose3(first, given.atPose3(first), tight))
    started = time.perf_counter()
    chordal = gtsam.InitializePose3.initialize(held)
    theirs = time.perf_counter() - started

    draw(panels[0], f"{path.stem}: in the file", graph, given)
    draw(panels[1], f"{path.stem}: rotavg", graph, solved)
    return [
        path.stem,
        f"{graph.num_nodes} / {graph.num_edges}",
        figure(factors, given),
        f"{figure(factors, solved)}, {ours:.2f} s",
        f"{figure(factors, chordal)}, {theirs:.2f} s",
        *(
            optimised(factors, held, optimiser, start)
            for optimiser in (levenberg_marquardt, gauss_newton)
            for start in (solved, chordal)
        ),
        f"{figure(factors, refined)}, {poses.iterations} its, {refining:.1f} s",
    ]


def figure(factors: Any, values: Any) -> str:
    """chi^2 of these poses."""
    return f"{2 * factors.error(values):.6g}"


def levenberg_marquardt(factors: Any, start: Any) -> Any:
    """GTSAM's optimiser, to the end."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-10)
    return gtsam.LevenbergMarquardtOptimizer(factors, start, parameters)


def gauss_newton(factors: Any, start: Any) -> Any:
    """GTSAM's optimiser, to the end."""
    parameters = gtsam.GaussNewtonParams()
    parameters.setRelativeErrorTol(1e-10)
    return gtsam.GaussNewtonOptimizer(factors, start, parameters)


def optimised(factors: Any, held: Any, optimiser: Any, start: Any) -> str:
    """chi^2 where an optimiser ends, its iterations and seconds."""
    started = time.perf_counter()
    run = optimiser(held, start)
    try:
        end = run.optimize()
    except RuntimeError as error:
        return f"failed: {str(error).strip().splitlines()[0]}"
    seconds = time.perf_counter() - started
    return f"{figure(factors, end)}, {run.iterations()} its, {seconds:.1f} s"


def draw(axes: Any, title: str, graph: rotavg.MeasurementGraph, values: Any) -> None:
    """The trajectory, and the other edges."""
    where = np.array([values.atPose3(node).translation() for node in graph.nodes.tolist()])
    closing = np.abs(np.diff(graph.indices, axis=1).ravel()) > 1
    for i, j in graph.indices[closing]:
        axes.plot(*where[[i, j]].T, color="tab:orange", linewidth=0.3, alpha=0.5)
    axes.plot(*where.T, color="tab:blue", linewidth=0.6)
    axes.set_title(title, y=0.97)
    axes.set_box_aspect(np.ptp(where, axis=0) + 0.15 * np.ptp(where))
    axes.tick_params(labelsize=7)


if __name__ == "__main__":
    main()
