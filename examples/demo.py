"""Make a trajectory graph, write it to a file, solve the file, and draw what came out.

Run by `./dev demo`; the files are left in demo/.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import rotavg

mpl.use("Agg")
import matplotlib.pyplot as plt

FOLDER = Path("demo")
NOISE = 0.1  # radians, standard deviation of every measurement's noise angle
BEFORE, AFTER = "tab:orange", "tab:blue"


def main() -> int:
    FOLDER.mkdir(exist_ok=True)
    simulation = rotavg.simulate("sphere", 2500, noise=NOISE, seed=1)
    rotavg.write(FOLDER / "sphere.g2o", simulation.graph)

    graph = rotavg.read(FOLDER / "sphere.g2o")
    start = rotavg.solve(graph, init="shortest_path", max_iterations=0, certify=False)
    solution = rotavg.solve(graph)
    rotavg.write(FOLDER / "solved.g2o", solution)

    before = node_errors_deg(start.rotations, simulation.ground_truth)
    after = node_errors_deg(solution.rotations, simulation.ground_truth)
    print(f"A robot circles a sphere: {graph.num_nodes} poses, {graph.num_edges} measured")
    print(f"relative rotations, each with {np.degrees(NOISE):.1f} deg of noise.\n")
    print(f"$ rotavg solve {FOLDER}/sphere.g2o -o {FOLDER}/solved.g2o")
    print(f"{solution}\n")
    print("Error of the rotations against the ground truth (median over all poses):")
    print(f"  shortest paths {np.median(before):6.2f} deg")
    print(f"  rotavg         {np.median(after):6.2f} deg\n")

    draw(simulation, start, solution, before, after).savefig(FOLDER / "sphere.png", dpi=130)
    print(f"Picture: {FOLDER}/sphere.png")
    return 0 if solution.solved else 1


def node_errors_deg(
    estimate: NDArray[np.float64], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Angle (n,) between estimate and truth, after the one rotation that aligns them best."""
    truth_from_estimate = Rotation.from_matrix(truth @ np.swapaxes(estimate, 1, 2))
    aligned = truth_from_estimate.mean().inv() * truth_from_estimate
    return np.degrees(aligned.magnitude())


def draw(
    simulation: rotavg.Simulation,
    start: rotavg.Solution,
    solution: rotavg.Solution,
    before: NDArray[np.float64],
    after: NDArray[np.float64],
) -> plt.Figure:
    """Where the poses are wrong before and after, what the edges leave over, how fast it went."""
    figure = plt.figure(figsize=(13, 8), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.5, 1))
    assert simulation.positions is not None
    top = float(np.percentile(before, 99))
    for column, (errors, title) in enumerate(
        ((before, "Before: products along shortest paths"), (after, "After: rotavg"))
    ):
        axes = figure.add_subplot(grid[0, column], projection="3d")
        axes.plot(*simulation.positions.T, color="0.85", linewidth=0.5)
        dots = axes.scatter(
            *simulation.positions.T, c=errors, s=7, cmap="viridis", vmin=0, vmax=top
        )
        axes.set_title(f"{title}\nmedian error of a pose {np.median(errors):.2f} deg")
        axes.set_box_aspect((1, 1, 1), zoom=1.5)
        axes.set_axis_off()
    figure.colorbar(dots, ax=figure.axes, label="error against the ground truth [deg]", shrink=0.8)

    residuals = figure.add_subplot(grid[1, 0])
    angles = [np.degrees(s.residual_angles) for s in (start, solution)]
    bins = np.linspace(0, float(np.percentile(angles[0], 99.5)), 60)
    residuals.hist(angles[0], bins, color=BEFORE, alpha=0.7, label="before")
    residuals.hist(angles[1], bins, color=AFTER, alpha=0.7, label="after")
    residuals.set(
        xlabel="residual of an edge [deg]",
        ylabel="edges",
        yscale="log",
        title="What the measurements leave over",
    )
    residuals.legend()

    convergence = figure.add_subplot(grid[1, 1])
    optimum = solution.trace.objective[-1]
    excess = np.maximum(solution.trace.objective / optimum - 1, 1e-16)
    convergence.semilogy(1e3 * solution.trace.seconds, excess, "o-", markersize=4, color=AFTER)
    convergence.set(
        xlabel="time [ms]",
        ylabel="objective above the optimum, relative",
        title=f"{solution.method}, {solution.iterations} iterations",
    )
    convergence.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    sys.exit(main())
