"""What short cycles say of the edges they pass through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import ReadOnly, read_only
from rotavg.base.errors import OptionError, expect
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving import options
from rotavg.solving.unchecked import bridges


@dataclass(frozen=True, eq=False)
class CycleEvidence(ReadOnly):
    """What the short cycles (of three edges, or of two parallel ones) say of every edge.

    Attributes:
        checked: (m,) cycles that were looked at: all, or some evenly spread ones.
        agreeing: (m,) of these, cycles that miss the identity by no more than the threshold.
        median_error: (m,) median of the angles, radians, by which they miss it; NaN without cycles.
        least_error: (m,) the least of these angles.
        bridge: (m,) whether no cycle of any length passes through the edge.
        min_cycles: how many cycles are enough to refute an edge.
    """

    checked: NDArray[np.int32]
    agreeing: NDArray[np.int32]
    median_error: NDArray[np.float64]
    least_error: NDArray[np.float64]
    bridge: NDArray[np.bool_]
    min_cycles: int = 3

    @property
    def share(self) -> NDArray[np.float64]:
        """(m,) (agreeing + 1) / (checked + 2): a factor for the weights; a half without cycles."""
        return np.asarray((self.agreeing + 1) / (self.checked + 2), dtype=np.float64)

    @property
    def refuted(self) -> NDArray[np.bool_]:
        """(m,) whether `min_cycles` cycles or more were looked at and none agrees."""
        return np.asarray((self.checked >= self.min_cycles) & (self.agreeing == 0))


def cycle_evidence(
    graph: MeasurementGraph, threshold: float, *, min_cycles: int = 3
) -> CycleEvidence:
    """Check every edge by the short cycles through it (Zach, Klopschitz and Pollefeys 2010).

    Use `graph.with_weights(graph.weights * evidence.share)` to weight by it, or
    `solve(graph, cycle_threshold=...)` to leave out what it refutes.

    Args:
        graph: the measurements.
        threshold: angle in radians by which the rotations around a cycle may miss the identity.
        min_cycles: how many cycles are enough to refute an edge.

    Raises:
        OptionError: for a threshold that is no angle, or less than one cycle.
    """
    expect(graph, MeasurementGraph)
    if not (isinstance(threshold, (int, float, np.number)) and 0 <= threshold <= np.pi):
        raise OptionError(f"threshold is {threshold!r}; expected an angle in radians, 0 to pi")
    least = options.whole("min_cycles", min_cycles, 1, 2**31 - 1)
    checked, agreeing, median, smallest = _core.cycle_evidence(graph._core, float(threshold))
    return CycleEvidence(
        checked=read_only(checked),
        agreeing=read_only(agreeing),
        median_error=read_only(median),
        least_error=read_only(smallest),
        bridge=bridges(graph),
        min_cycles=least,
    )
