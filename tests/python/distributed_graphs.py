"""Graphs that are solved in parts."""

from __future__ import annotations

import numpy as np

import rotavg


def with_two_components() -> rotavg.MeasurementGraph:
    one = rotavg.simulate("sphere", 80, noise=0.1, seed=1).graph
    other = rotavg.simulate("cycle", 20, noise=0.1, seed=2).graph
    return rotavg.MeasurementGraph(
        np.concatenate([one.edges, other.edges + 1000]),
        np.concatenate([one.rotations, other.rotations]),
        np.concatenate([one.weights, 5.0 * other.weights]),
    )


GRAPHS = {
    "sphere": rotavg.simulate("sphere", 300, noise=0.1, seed=3).graph,
    "dense": rotavg.simulate("erdos_renyi", 90, noise=0.3, density=0.3, seed=4).graph,
    "trajectory": rotavg.simulate("grid", 120, noise=0.05, seed=5).graph,
    "two components": with_two_components(),
    "one edge": rotavg.MeasurementGraph([(7, 3)], np.eye(3)[None]),
}
