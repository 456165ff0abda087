"""How much chi scatters: the noise that most measurements of a pose graph show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.graph.measurement_graph import MeasurementGraph

Floats = NDArray[np.float64]

# Of chi with so many degrees of freedom, where the noise along each is 1.
_MEDIAN = {2: 1.1774, 3: 1.5382, 6: 2.3126}
_MANY_EDGES = 20_000  # beyond, finding how much each edge is checked would take too long
_LEAST_REDUNDANCY = 1e-6  # below, rounding is seen
_ROUNDING = 1e-12  # of the chi of what is measured, and of a turn of a radian


class ChiNoise:
    """The noise of chi = sqrt(r^T Omega r) of the edges of a graph that has translations.

    Least squares leave an edge sqrt(1 - h) of its noise, h its leverage, here that of its
    translation. Bridges say nothing, and edges in series, which lie on the same cycles, say one
    thing.

    Attributes:
        num_series: series of edges that cycles check.
        num_cycles: how many cycles there are, none of them the sum of others.
        rounding: of chi: what is below is no noise.
    """

    def __init__(self, graph: MeasurementGraph) -> None:
        measured = graph.translations
        assert measured is not None
        self.dimension = measured.dimension
        traces = np.trace(measured.information, axis1=1, axis2=2)
        squares = 1.0 + (measured.vectors**2).sum(axis=1)
        self.rounding = _ROUNDING * float(np.sqrt((traces * squares).max(initial=0.0)))
        self._series, cycles = _core.series(graph._core)
        self.num_series = int(self._series.max(initial=-1)) + 1
        self.num_cycles = int(cycles)
        checked = self._series >= 0
        self._left = np.full(graph.num_edges, np.sqrt(cycles / max(1, checked.sum())))
        if cycles > 0 and graph.num_edges <= _MANY_EDGES:
            self._left = np.sqrt(_redundancy(graph, measured.information))

    def standardised(self, chi: Floats) -> Floats:
        """(m,) chi in units of what is left of a noise of 1; 0 of edges that nothing checks."""
        return np.asarray(np.where(self._series >= 0, chi / self._left, 0.0))

    def of_series(self, chi: Floats, kept: NDArray[np.bool_] | None = None) -> Floats:
        """The largest of these in each series; 0 where none is `kept`."""
        result = np.zeros(self.num_series)
        checked = self._series >= 0
        if kept is not None:
            checked = checked & kept
        np.maximum.at(result, self._series[checked], self.standardised(chi)[checked])
        return result

    def __call__(self, chi: Floats, degrees: int) -> float:
        """The noise along each of the degrees of freedom, from the median; 0 without cycles."""
        if self.num_series == 0:
            return 0.0
        return float(np.median(self.of_series(chi))) / _MEDIAN[degrees]


def _redundancy(graph: MeasurementGraph, omega: Floats) -> Floats:
    """(m,) 1 - h of translations whose information is `omega` (m, 3, 3), taken for isotropic.

    h = w times the resistance between the ends, which is what rotations without noise have for
    their covariance.
    """
    weights = np.trace(omega, axis1=1, axis2=2)
    weights = np.clip(weights / np.median(weights), 1e-50, 1e50)
    same = np.broadcast_to(np.eye(3), (graph.num_edges, 3, 3))
    network = MeasurementGraph(graph.edges, same, weights, graph.nodes)
    at = np.ascontiguousarray(np.broadcast_to(np.eye(3), (graph.num_nodes, 3, 3)))
    resistance = _core.covariances(
        network._core, at, network.indices, noise_variance=1.0, information=None, num_threads=1
    )
    if resistance is None:
        return np.ones(graph.num_edges)
    leverage = weights * np.trace(resistance, axis1=1, axis2=2) / 3
    return np.asarray(np.clip(1 - leverage, _LEAST_REDUNDANCY, 1.0))
