"""Graphs without noise, with random weights and directions of edges, and with names."""

from __future__ import annotations

import numpy as np

import rotavg
from rotavg.graph.measurement_graph import MeasurementGraph


def random_graph(names: bool, seed: int = 3, weighted: bool = True) -> MeasurementGraph:
    """A consistent graph without noise: a wrong transpose leaves large residuals."""
    graph = rotavg.simulate("erdos_renyi", 30, density=0.2, seed=seed).graph
    rng = np.random.default_rng(seed)
    weights = rng.uniform(1e-3, 1e3, graph.num_edges) if weighted else None
    edges = np.where(rng.random((graph.num_edges, 1)) < 0.5, graph.edges, graph.edges[:, ::-1])
    R = np.where(
        (edges == graph.edges)[:, :1, None], graph.rotations, np.swapaxes(graph.rotations, 1, 2)
    )
    if names:
        edges = np.char.add(np.char.add("im/", edges.astype(str)), ".jpg")
    return MeasurementGraph(edges, R, weights)
