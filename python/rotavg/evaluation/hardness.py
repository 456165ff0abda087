"""How hard a graph is to average, before anything is solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import Brief
from rotavg.base.errors import expect
from rotavg.graph.measurement_graph import MeasurementGraph

# Cycles are long on long trajectories; this many tell enough of their errors.
_MAX_CYCLES = 20000


@dataclass(frozen=True, eq=False)
class Hardness(Brief):
    """Measures of a measurement graph that decide how hard its averaging is.

    Attributes:
        component_sizes: nodes in every connected component, largest first.
        degrees: (n,) number of edges at each node.
        algebraic_connectivity: lambda_2 of the weighted Laplacian of the largest component. The
            larger it is against the noise, the easier the problem (Wilson, Bindel and Snavely,
            "When is rotations averaging hard?", 2016). NaN for a single node.
        cycle_angles: (k,) angle in radians by which the measurements around independent cycles
            miss the identity. The cycles are those that edges close with a breadth-first tree; at
            most 20000 of them, evenly spread, are looked at.
        cycle_lengths: (k,) edges in each of these cycles.
    """

    component_sizes: NDArray[np.int64]
    degrees: NDArray[np.int64]
    algebraic_connectivity: float
    cycle_angles: NDArray[np.float64]
    cycle_lengths: NDArray[np.int32]

    @property
    def noise(self) -> float:
        """A rough noise angle of one edge, radians: median of angle / sqrt(length) of right cycles.

        A cycle counts by how likely it is to have no wrong edge in it, judged by all of them
        together: right ones miss the identity by noise that grows with sqrt(length), the others by
        any rotation. Without wrong edges, all count. NaN for a graph without cycles.
        """
        if len(self.cycle_angles) == 0:
            return float("nan")
        return _noise(self.cycle_angles, self.cycle_lengths)


def _noise(angles: NDArray[np.float64], lengths: NDArray[np.int32]) -> float:
    """The noise angle of one edge, by expectation and maximisation of the likelihood."""
    theta = np.maximum(angles, 1e-12)
    per_edge = theta / np.sqrt(lengths)
    wrong = (1.0 - np.cos(theta)) / np.pi  # density of the angle of a random rotation
    variance, share = float(np.quantile(per_edge, 0.1)) ** 2, 0.5
    right = np.ones(len(theta))
    for _ in range(100):
        spread = np.sqrt(max(variance, 1e-20) * lengths)  # per axis
        likely = np.sqrt(2.0 / np.pi) * theta**2 / spread**3 * np.exp(-0.5 * (theta / spread) ** 2)
        right = share * likely / (share * likely + (1.0 - share) * wrong + 1e-300)
        variance = float(right @ per_edge**2 / (3.0 * right.sum() + 1e-300))
        share = float(right.mean())
    order = np.argsort(per_edge)
    below = np.cumsum(right[order])
    return float(per_edge[order[np.searchsorted(below, 0.5 * below[-1])]])


def hardness(graph: MeasurementGraph) -> Hardness:
    """Measure how hard a graph is: components, degrees, connectivity, cycle errors."""
    expect(graph, MeasurementGraph)
    label = graph.components()
    sizes = np.bincount(label)
    # Rotations along a breadth-first tree leave nothing over on its own edges; on any other edge
    # they leave over what its cycle misses the identity by.
    tree = _core.shortest_path_init(graph._core)
    angles = _core.residual_angles(graph._core, tree)
    num_cycles = graph.num_edges - graph.num_nodes + len(sizes)
    edges = np.arange(graph.num_edges, dtype=np.int32)
    if num_cycles > _MAX_CYCLES:
        edges = np.linspace(0, graph.num_edges - 1, _MAX_CYCLES).astype(np.int32)
    lengths = _core.cycle_lengths(graph._core, edges)
    closing = lengths > 1
    return Hardness(
        component_sizes=np.sort(sizes)[::-1],
        degrees=np.bincount(graph.indices.ravel(), minlength=graph.num_nodes),
        algebraic_connectivity=_core.algebraic_connectivity(graph._core, int(np.argmax(sizes))),
        cycle_angles=angles[edges[closing]],
        cycle_lengths=lengths[closing],
    )
