"""What is known beforehand of absolute rotations: some of them, or which way is down."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph

NodeKey = Union[int, str]


@dataclass(frozen=True, eq=False)
class Priors:
    """Prior knowledge of the rotations R_i = world_from_i; with it, the world is no free gauge.

    Attributes:
        fixed: rotation (3, 3) of every node that is held.
        absolute: (rotation P (3, 3), weight w) of a node: w |R_i - P|_F^2 is added to the
            objective, as an edge of weight w from the world would add.
        gravity: (down d (3,), weight w) of a node, down in the frame of the node, of any length:
            2 w |R_i d - g|^2 is added, which makes a tilt count like the angle of an edge of
            weight w. The larger w, the more certain; only the heading stays free.
        down: g (3,), down in the world: by default (0, 1, 0), as COLMAP and GLOMAP have it.
    """

    fixed: Mapping[Any, ArrayLike] = field(default_factory=dict)
    absolute: Mapping[Any, tuple[ArrayLike, float]] = field(default_factory=dict)
    gravity: Mapping[Any, tuple[ArrayLike, float]] = field(default_factory=dict)
    down: ArrayLike = (0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class CheckedPriors:
    """Priors as arrays, for one graph; rows are those of the graph's nodes.

    Attributes:
        fixed: (a,) rows; fixed_rotations: (a, 3, 3).
        absolute: (b,) rows; absolute_rotations: (b, 3, 3); absolute_weights: (b,).
        gravity: (c,) rows; gravity_downs: (c, 3) of length 1; gravity_weights: (c,).
        down: (3,) of length 1.
    """

    fixed: NDArray[np.int64]
    fixed_rotations: NDArray[np.float64]
    absolute: NDArray[np.int64]
    absolute_rotations: NDArray[np.float64]
    absolute_weights: NDArray[np.float64]
    gravity: NDArray[np.int64]
    gravity_downs: NDArray[np.float64]
    gravity_weights: NDArray[np.float64]
    down: NDArray[np.float64]

    @property
    def any(self) -> bool:
        """Whether anything is known at all."""
        return len(self.fixed) + len(self.absolute) + len(self.gravity) > 0

    @classmethod
    def of(cls, priors: Priors, graph: MeasurementGraph) -> CheckedPriors:
        """Check priors against a graph; GraphError names the node that is wrong, and why."""
        if not isinstance(priors, Priors):
            raise GraphError(f"priors are a {type(priors).__name__}, expected a rotavg.Priors")
        for name in ("fixed", "absolute", "gravity"):
            if not isinstance(getattr(priors, name), Mapping):
                raise GraphError(f"{name} priors are no mapping from nodes, expected a dict")
        fixed, rotations = _sorted(graph, priors.fixed, "fixed")
        absolute, with_weights = _sorted(graph, priors.absolute, "absolute")
        gravity, downs = _sorted(graph, priors.gravity, "gravity")
        both = np.intersect1d(fixed, absolute)
        if len(both) > 0:
            node = graph.nodes[both[0]].item()
            raise GraphError(f"node {node!r} has a fixed rotation and an absolute prior as well")
        return cls(
            fixed,
            _stack([_rotation(*item) for item in rotations], (3, 3)),
            absolute,
            _stack([_rotation(what, _pair(what, x)[0]) for what, x in with_weights], (3, 3)),
            _stack([_weight(what, _pair(what, x)[1]) for what, x in with_weights], ()),
            gravity,
            _stack([_direction(what, _pair(what, x)[0]) for what, x in downs], (3,)),
            _stack([_weight(what, _pair(what, x)[1]) for what, x in downs], ()),
            _direction("down", priors.down),
        )


def _sorted(
    graph: MeasurementGraph, priors: Mapping[Any, Any], kind: str
) -> tuple[NDArray[np.int64], list[tuple[str, Any]]]:
    """Rows, rising, and what is known of each, under a name for errors."""
    if not priors:
        return np.empty(0, dtype=np.int64), []
    keys = list(priors)
    ids = as_ids([key.item() if isinstance(key, np.generic) else key for key in keys], kind)
    rows = rows_of(ids, graph.nodes)
    if (rows < 0).any():
        node = keys[int(np.argmin(rows))]
        raise GraphError(f"the {kind} prior of node {node!r}: it is not in the graph")
    order = np.argsort(rows, kind="stable")
    items = [(f"the {kind} prior of node {keys[k]!r}", priors[keys[k]]) for k in order.tolist()]
    return rows[order], items


def _pair(what: str, value: Any) -> tuple[Any, Any]:
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise GraphError(f"{what} is {value!r}, expected a pair of what is known and its weight")
    return value[0], value[1]


def _rotation(what: str, value: Any) -> NDArray[np.float64]:
    R = as_floats(value, (3, 3), what)
    error = np.abs(R.T @ R - np.eye(3)).max()
    if not error <= 1e-3 or np.linalg.det(R) < 0:
        raise GraphError(f"{what} is no rotation, expected R^T R = I and det R = 1")
    return np.asarray(_core.nearest_rotation(R[None])[0])


def _direction(what: str, value: Any) -> NDArray[np.float64]:
    v = as_floats(value, (3,), what)
    size = np.abs(v).max()
    if not 0 < size < np.inf:
        raise GraphError(f"{what} is {v.tolist()}, expected a finite direction other than zero")
    return np.asarray(v / size / np.linalg.norm(v / size))


def _weight(what: str, value: Any) -> NDArray[np.float64]:
    if not (isinstance(value, (int, float, np.number)) and 1e-100 <= value <= 1e100):
        raise GraphError(f"{what} has the weight {value!r}, expected one from 1e-100 to 1e100")
    return np.asarray(float(value))


def _stack(items: list[NDArray[np.float64]], shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.array(items).reshape(len(items), *shape)
