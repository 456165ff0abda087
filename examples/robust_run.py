"""Wrong measurements: a robust run, what it thinks of every edge, and how sure it is of the answer.

    python examples/robust_run.py

A view graph in which three of ten measured rotations have nothing to do with the truth.
"""

from __future__ import annotations

import numpy as np

import rotavg

simulation = rotavg.simulate(
    "erdos_renyi", 200, density=0.2, noise=np.radians(3), outliers=0.3, seed=1
)
graph, truth = simulation.graph, simulation.ground_truth

for loss in ("l2", "auto"):
    solution = rotavg.solve(graph, loss=loss)  # type: ignore[arg-type]
    errors = rotavg.compare(solution.rotations, truth)
    print(f"{loss:>4}: median error {np.degrees(errors.median):.2f} deg")
print(solution)

found = solution.is_outlier
right = np.count_nonzero(found & simulation.is_outlier)
print(f"{found.sum()} outliers found, {right} of the {simulation.is_outlier.sum()} there are")

covariances = solution.covariances()  # radians^2, relative to the first node
rms = np.degrees(np.sqrt(np.trace(covariances, axis1=1, axis2=2)))
print(f"rotations are known to {np.median(rms):.2f} deg (median)")
rotavg.write_edges("edges.csv", solution)
