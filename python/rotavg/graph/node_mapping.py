"""Rotations of the nodes of a graph as a mapping from their ids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import ReadOnly
from rotavg.base.errors import UnknownNodeError, require
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.graph.ids import IdArray
from rotavg.graph.measurement_graph import MeasurementGraph

Id = Union[int, str]


class IdMapping(ReadOnly, Mapping[Id, NDArray[np.float64]]):
    """What has the ids of n `nodes` and their `rotations` (n, 3, 3), as a mapping.

    The keys are the ids, in their order; the values are matrices (3, 3), world_from_node. Two are
    equal only if they are the same object.
    """

    rotations: NDArray[np.float64]

    def _ids(self) -> IdArray:
        """(n,) ids of the nodes, in the order of `rotations`."""
        raise NotImplementedError

    def _component(self) -> NDArray[np.int32] | None:
        """(n,) label of each node's component; None where nobody knows."""
        return getattr(self, "component", None)

    def __getitem__(self, node: Id) -> NDArray[np.float64]:
        """Rotation (3, 3), world_from_node, of the node with this id.

        Raises UnknownNodeError, a GraphError and a KeyError, without one.
        """
        try:
            return np.asarray(self.rotations[self._row_of[node]])
        except (KeyError, TypeError):
            raise UnknownNodeError(f"node {node!r} is not in the graph") from None

    def __iter__(self) -> Iterator[Id]:
        return iter(self._row_of)

    def __len__(self) -> int:
        return len(self._row_of)

    def __eq__(self, other: object) -> bool:
        return self is other

    __hash__ = object.__hash__

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The rotations (n, 3, 3), for functions that take arrays."""
        if dtype is None and not copy:
            return self.rotations
        return np.array(self.rotations, dtype=dtype)

    @cached_property
    def _row_of(self) -> dict[Id, int]:
        return {node: row for row, node in enumerate(self._ids().tolist())}

    def to_scipy(self) -> Any:
        """The rotations as a `scipy.spatial.transform.Rotation` of length n, world_from_node."""
        return require("scipy.spatial.transform", "scipy").Rotation.from_matrix(self.rotations)

    def to_dataframe(self) -> Any:
        """A `pandas.DataFrame` of the ids, qx qy qz qw (world_from_node, w >= 0), and `component`.

        The ids are its index; where components are not known, they are left out. Needs pandas, the
        extra [pandas].
        """
        pandas = require("pandas", "pandas")
        quaternions = quaternions_from_matrices(self.rotations)
        columns: dict[str, Any] = {f"q{axis}": quaternions[:, k] for k, axis in enumerate("xyzw")}
        label = self._component()
        if label is not None:
            columns["component"] = np.array(label)
        return pandas.DataFrame(columns, index=pandas.Index(self._ids().tolist(), name="id"))


class NodeMapping(IdMapping):
    """The same of the nodes of a `graph`, in its order."""

    graph: MeasurementGraph

    @property
    def nodes(self) -> IdArray:
        """(n,) ids of the nodes, in the order of `rotations`."""
        return self.graph.nodes

    def _ids(self) -> IdArray:
        return self.graph.nodes

    def _component(self) -> NDArray[np.int32] | None:
        label = super()._component()
        return self.graph.components() if label is None else label
