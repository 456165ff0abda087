"""Graphs that tests share: without noise and with names, and with full covariances."""

from __future__ import annotations

import numpy as np

import rotavg
from benchmarks.anisotropic_graphs import RATIOS, simulated
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


def graph_with_covariances(seed: int, n: int = 10, noise: float = 0.1) -> MeasurementGraph:
    """Of noise with random axes, known better about some of them."""
    rng = np.random.default_rng(seed)
    return simulated(rng, n, 0.5, RATIOS[1 + seed % 3], noise)[0]
