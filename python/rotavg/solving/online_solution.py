"""What online averaging knows at one time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import read_only
from rotavg.graph import conventions
from rotavg.graph.ids import IdArray
from rotavg.graph.node_mapping import IdMapping
from rotavg.solving.certificate import Verdict


@dataclass(frozen=True, eq=False)
class OnlineSolution(IdMapping):
    """What `Online` knew at one time, and a mapping from the ids of the nodes to their rotations.

    Attributes:
        nodes: (n,) ids, in the order in which they came.
        rotations: (n, 3, 3) world_from_node, the identity at the first node of every component.
        objective: f(rotations), equation (3), with the weights in use.
        verdict: "proved" where `relative_gap` is below the tolerance, else "not_certified".
        gap: bound on f(rotations) - f*, where f* is the global optimum. Rounding is included.
        relative_gap: gap / f, of the worst component.
        num_components: of the graph.
    """

    nodes: IdArray
    rotations: NDArray[np.float64]
    objective: float
    verdict: Verdict
    gap: float
    relative_gap: float
    num_components: int

    @cached_property
    def quaternions(self) -> NDArray[np.float64]:
        """(n, 4) Hamilton quaternions xyzw, w >= 0."""
        return read_only(conventions.quaternions_from_matrices(self.rotations))

    def _ids(self) -> IdArray:
        return self.nodes
