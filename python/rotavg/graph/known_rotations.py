"""Rotations of a graph's nodes that no solver found: ground truth, somebody else's solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError
from rotavg.graph.conventions import first_no_rotation, quaternions_from_matrices
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import why_row_is_no_rotation
from rotavg.graph.node_mapping import NodeMapping


@dataclass(frozen=True, eq=False)
class KnownRotations(NodeMapping):
    """Rotations for `rotavg.write`, which writes them as it does a solution's.

    Attributes:
        graph: whose nodes they are of, n.
        rotations: (n, 3, 3) world_from_node, rows as in `graph.nodes`.

    Raises:
        GraphError: these are not n rotations.
    """

    graph: MeasurementGraph
    rotations: NDArray[np.float64]

    def __post_init__(self) -> None:
        rotations = as_floats(self.rotations, (self.graph.num_nodes, 3, 3), "rotations")
        bad = first_no_rotation(rotations)
        if bad is not None:
            node = self.graph.nodes[bad].item()
            raise GraphError(
                f"the matrix of node {node!r} {why_row_is_no_rotation(rotations, bad)}"
            )
        object.__setattr__(self, "rotations", read_only(rotations))

    @property
    def quaternions(self) -> NDArray[np.float64]:
        """(n, 4), the same as xyzw."""
        return quaternions_from_matrices(self.rotations)
