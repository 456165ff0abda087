"""Measurements as plain arrays, the form in which they travel between processes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError
from rotavg.graph.measurement_graph import MeasurementGraph


@dataclass(frozen=True, eq=False)
class Edges:
    """Measured rotations between nodes with integer ids.

    Attributes:
        i, j: (m,) int64 ids of the two ends.
        rotations: (m, 3, 3) i_from_j.
        weights: (m,).
        alone: (k,) ids of nodes that are listed, whether they have an edge or not.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    rotations: NDArray[np.float64]
    weights: NDArray[np.float64]
    alone: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    @staticmethod
    def of(graph: MeasurementGraph) -> Edges:
        """Those of a graph."""
        if not isinstance(graph, MeasurementGraph):
            raise GraphError(
                f"found a {type(graph).__name__}, expected a MeasurementGraph or Edges"
            )
        if graph.nodes.dtype.kind not in "iu":
            raise GraphError("a distributed solve takes integer node ids, and these are names")
        return Edges(
            graph.edges[:, 0].astype(np.int64),
            graph.edges[:, 1].astype(np.int64),
            np.asarray(graph.rotations),
            np.asarray(graph.weights),
            np.setdiff1d(graph.nodes, graph.edges).astype(np.int64),
        )

    def checked(self) -> Edges:
        """Under the rules of `MeasurementGraph`, but that there may be none.

        Raises GraphError if these are broken.
        """
        alone = np.asarray(self.alone, np.int64)
        if np.size(self.i) == 0:
            return replace(Edges.concatenated([]), alone=alone)
        ends = np.stack([self.i, self.j], axis=1)
        return replace(Edges.of(MeasurementGraph(ends, self.rotations, self.weights)), alone=alone)

    @staticmethod
    def concatenated(pieces: Iterable[Edges]) -> Edges:
        """All of them, in order; nodes without an edge are left out."""
        pieces = list(pieces)
        if not pieces:
            return Edges(
                np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros(0)
            )
        return Edges(
            np.concatenate([piece.i for piece in pieces]),
            np.concatenate([piece.j for piece in pieces]),
            np.concatenate([piece.rotations for piece in pieces]),
            np.concatenate([piece.weights for piece in pieces]),
        )

    def __len__(self) -> int:
        return len(self.i)

    def take(self, rows: NDArray[np.generic] | slice) -> Edges:
        """Those of a mask, of row numbers or of a slice; no nodes without an edge."""
        return Edges(self.i[rows], self.j[rows], self.rotations[rows], self.weights[rows])

    def nodes(self) -> NDArray[np.int64]:
        """The ids that occur, rising."""
        return np.unique(np.concatenate([self.i, self.j, self.alone]))
