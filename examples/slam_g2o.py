"""SLAM: a pose graph in g2o's format in, one in which all poses fit together out.

    python examples/slam_g2o.py [IN.g2o [OUT.g2o]]

Without a file, one is simulated. What is written is a start for any pose-graph optimiser: the
rotations are globally optimal, the positions are those that fit them best (this needs SciPy).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import rotavg


def main(arguments: list[str]) -> int:
    source = Path(arguments[0]) if arguments else simulated(Path("sphere.g2o"))
    target = Path(arguments[1]) if len(arguments) > 1 else source.with_name("solved.g2o")

    graph = rotavg.read(source)
    for note in graph.notes:
        print("note:", note)
    solution = rotavg.solve(graph)
    print(solution)
    rotavg.write(target, solution)
    print(f"wrote {target}")

    if graph.translations is not None:
        positions = rotavg.positions(graph, solution.rotations)
        print(f"the trajectory spans {np.ptp(positions, axis=0).round(2)}")
    return 0 if solution.solved else 1


def simulated(path: Path) -> Path:
    """A robot that circles a sphere of radius 10 with noisy odometry, as a g2o file."""
    sphere = rotavg.simulate("sphere", 400, noise=0.05, seed=1)
    i, j = sphere.graph.indices.T
    steps = 10 * (sphere.positions[j] - sphere.positions[i])
    in_frame_of_i = np.einsum("mba,mb->ma", sphere.ground_truth[i], steps)
    noise = np.random.default_rng(1).normal(scale=0.05, size=steps.shape)
    graph = rotavg.MeasurementGraph(
        sphere.graph.edges,
        sphere.graph.rotations,
        weights=np.full(len(steps), 0.5 / 0.05**2),
        translations=rotavg.RelativeTranslations(
            in_frame_of_i + noise, np.tile(np.eye(3) / 0.05**2, (len(steps), 1, 1))
        ),
    )
    rotavg.write(path, graph)
    return path


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
