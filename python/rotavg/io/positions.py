"""Where the nodes of a pose graph are, for pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.lines import lines_of

_VERTEX = b"VERTEX_SE3:QUAT"


def positions(graph: MeasurementGraph) -> NDArray[np.float64] | None:
    """Positions (n, 3) of the vertices in the g2o file that a graph was read from, as they stand.

    None where the graph came from elsewhere, where a node has no vertex or one that is not finite,
    and where all are in one place, as in files that know rotations alone.
    """
    data = getattr(graph.source, "data", b"")  # what a reader of pose graphs keeps of its file
    place = {}
    for line in lines_of(data):
        fields = line.split(None, 5)
        if fields[:1] == [_VERTEX]:
            place[int(fields[1])] = [float(number) for number in fields[2:5]]
    if not all(node in place for node in graph.nodes.tolist()):
        return None
    found = np.array([place[node] for node in graph.nodes.tolist()])
    if not np.isfinite(found).all() or (found == found[0]).all():
        return None
    return found
