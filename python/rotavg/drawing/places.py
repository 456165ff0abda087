"""Where nodes are drawn, and the axes of their frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import SolverError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.positions import positions as positions_in_file
from rotavg.solving.positions import positions


def positions_of(
    graph: MeasurementGraph, rotations: ArrayLike
) -> tuple[NDArray[np.float64], str] | None:
    """Positions (n, 3) to draw poses at, and a sentence that says where they come from.

    Those that fit the relative translations best, given the rotations; without translations
    those of the file that the graph was read from; None where there are none, either.
    """
    if graph.translations is not None:
        try:
            return positions(graph, rotations), (
                "The positions fit the measured translations best, given these rotations."
            )
        except SolverError:
            pass
    found = positions_in_file(graph)
    if found is None:
        return None
    return found, "The positions are those of the input file."


def axes_of_frames(
    positions: NDArray[np.float64], rotations: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    """Segments (3, n, 2, 3) that draw the x, y and z axis of world_from_node at every position."""
    start = np.broadcast_to(positions, (3, *positions.shape))
    return np.stack([start, start + length * np.moveaxis(rotations, 2, 0)], axis=2)


def spacing(graph: MeasurementGraph, positions: NDArray[np.float64]) -> float:
    """How far apart neighbours are: the median distance between the ends of an edge."""
    i, j = graph.indices.T
    distance = float(np.median(np.linalg.norm(positions[i] - positions[j], axis=1)))
    return distance if distance > 0 else 0.02 * float(np.ptp(positions, axis=0).max())
