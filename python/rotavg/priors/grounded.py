"""Priors of one graph, as the core takes them (cpp/include/rotavg/reduction), and what it tells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, expect
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.priors import Priors, Rigs, check_priors


class Weighed(Protocol):
    """What a robust loss made of priors of one kind."""

    @property
    def is_outlier(self) -> NDArray[np.bool_]:
        """(k,) in the order of the nodes of the graph."""


@dataclass(frozen=True, eq=False)
class Grounded:
    """A graph with what is known beforehand.

    Attributes:
        graph: the measurements.
        priors: what is known.
        core: the problem that is solved: free variables, and the world that is held.
        prior_weights: of absolute priors and of gravity, if a robust loss has changed them.
    """

    graph: MeasurementGraph
    priors: Priors
    core: _core.GroundedGraph
    prior_weights: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.graph, self.priors, self.prior_weights)

    def with_weights(self, weights: NDArray[np.float64]) -> _core.GroundedGraph:
        """The problem with other weights (m,) of the measurements."""
        return self.core.with_weights(np.ascontiguousarray(weights))

    def with_prior_weights(
        self, absolute: NDArray[np.float64] | None, gravity: NDArray[np.float64] | None
    ) -> Grounded:
        """The same problem with other weights of its priors, in the order of the nodes.

        None leaves those of a kind as they are.
        """
        if absolute is None and gravity is None:
            return self
        none = np.empty(0)
        weights = (none if absolute is None else absolute, none if gravity is None else gravity)
        core = self.core.with_prior_weights(*weights)
        return replace(self, core=core, prior_weights=weights)

    def eased(self) -> Grounded:
        """The same problem for a solver, without weights that cost it digits and time.

        A rotation that is all that is known of its component only turns it, whatever the weight:
        here none of such is larger than that of the heaviest edge.
        """
        priors, graph = self.priors, self.graph
        if priors.rigs or not priors.absolute:
            return self
        label = graph.components()
        rows = {
            kind: np.sort([known.row for known in of_nodes(graph, getattr(priors, kind), kind)])
            for kind in ("fixed", "absolute", "gravity")
        }
        known = np.bincount(label[np.concatenate(list(rows.values())).astype(np.int64)])
        alone = known[label[rows["absolute"]]] == 1
        absolute, gravity = self.weights
        lowered = np.where(alone, np.minimum(absolute, graph.weights.max()), absolute)
        return self if (lowered == absolute).all() else self.with_prior_weights(lowered, gravity)

    @property
    def weights(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Of absolute priors, and of gravity, in the order of the nodes."""
        if self.prior_weights is not None:
            return self.prior_weights

        def given(kind: str) -> NDArray[np.float64]:
            known = of_nodes(self.graph, getattr(self.priors, kind), kind)
            return _stack([item.second for item in sorted(known, key=lambda item: item.row)])

        return given("absolute"), given("gravity")

    def noise_variance(
        self,
        rotations: NDArray[np.float64],
        trusted: NDArray[np.bool_],
        absolute: Weighed | None,
        gravity: Weighed | None,
    ) -> float:
        """Variance per axis, radians^2, of the noise of an edge of weight 1, without outliers.

        Args:
            rotations: (n, 3, 3) world_from_node.
            trusted: (m,) the measurements that are no outliers.
            absolute: what a robust loss made of absolute priors; None: all are trusted.
            gravity: the same of gravity.
        """
        holds = self._holds(trusted, absolute, gravity)
        freedom = self.core.degrees_of_freedom(holds)
        cost = float(self.core.edge_costs(rotations)[holds].sum())
        return cost / (2 * freedom) if freedom > 0 else float("nan")

    def degrees_of_freedom(
        self, trusted: NDArray[np.bool_], absolute: Weighed | None, gravity: Weighed | None
    ) -> int:
        """Of the residuals of all measurements and priors; see `noise_variance`."""
        held = trusted.copy()
        held[self.core.kept] = False  # three equations each, and no unknown
        return 3 * int(held.sum()) + self.core.degrees_of_freedom(
            self._holds(trusted, absolute, gravity)
        )

    def _holds(
        self, trusted: NDArray[np.bool_], absolute: Weighed | None, gravity: Weighed | None
    ) -> NDArray[np.bool_]:
        """Which edges of the problem that is solved count."""
        return self.core.edges_where(
            trusted,
            np.ones(len(self.priors.absolute), bool) if absolute is None else ~absolute.is_outlier,
            np.ones(len(self.priors.gravity), bool) if gravity is None else ~gravity.is_outlier,
        )

    def prior_costs(
        self, rotations: NDArray[np.float64], *, logarithms: bool = False
    ) -> NDArray[np.float64]:
        """(n,) what the priors of every node add to the objective, or to that of logarithms."""
        costs = self.core.log_prior_costs if logarithms else self.core.prior_costs
        return costs(rotations)

    def rows(self, rotations: NDArray[np.float64], certified: bool) -> list[tuple[str, str]]:
        """Names and sentences for a printed report."""
        absolute, gravity = self.core.prior_residuals(rotations)
        known = [f"{len(self.priors.fixed)} fixed"] if self.priors.fixed else []
        for name, angles in (("absolute", absolute), ("gravity", gravity)):
            if len(angles) > 0:
                median = np.degrees(np.median(angles))
                known.append(f"{len(angles)} {name} (residuals {median:.3g} deg in the median)")
        if isinstance(self.priors.rigs, Mapping) and self.priors.rigs:
            frames = len({frame for frame, _ in self.priors.rigs.values()})
            known.append(f"{len(self.priors.rigs)} cameras of rigs in {frames} frames")
        text = ", ".join(known) + ("; the certificate covers them" if certified else "")
        rows = [("priors", text)]
        count = self.core.num_free_headings
        if count > 0:
            parts = "" if count == 1 else f" of {count} parts, each its own"
            rows.append(("heading", f"free{parts}: gravity alone holds them"))
        return rows


def ground(graph: MeasurementGraph, priors: Priors) -> Grounded | None:
    """The problem of a graph and what is known; None if that is nothing.

    Raises:
        GraphError: names the prior that does not fit the graph, and why.
    """
    expect(graph, MeasurementGraph)
    if isinstance(priors, Priors) and isinstance(priors.rigs, Rigs):
        priors = replace(priors, rigs=cameras_of(priors.rigs))
    made = core_priors(graph, priors)
    if not (priors.hold_world or priors.rigs):
        return None
    try:
        core = _core.GroundedGraph(graph._core, made)
    except _core.InvalidPrior as error:
        raise prior_error(graph, error) from None
    except ValueError as error:
        raise GraphError(str(error)) from None
    return Grounded(graph, priors, core)


def cameras_of(rigs: Rigs) -> dict[Any, tuple[Any, Any]]:
    """The images of rigs all of whose sensors are known."""
    for node, value in rigs.images.items():
        if not isinstance(value, (tuple, list)) or len(value) != 2:
            found = f"the rig prior of node {node!r} is {value!r}"
            raise GraphError(f"{found}, expected a pair of frame and sensor")
        if value[1] not in rigs.rotations:
            raise GraphError(
                f"the rotation of sensor {value[1]!r} is not known, expected rigs all of whose "
                "sensors are (after solve(), solution.rigs.priors holds them)"
            )
    return {node: (frame, rigs.rotations[s]) for node, (frame, s) in rigs.images.items()}


def core_priors(graph: MeasurementGraph, priors: Priors) -> _core.Priors:
    """Priors as the core takes them, nodes by their rows; rigs with all sensors known.

    Raises:
        GraphError: names the prior that is not of the graph, or not what it should be.
    """
    check_priors(priors)
    for name in ("fixed", "absolute", "gravity", "rigs", "positions"):
        if not isinstance(getattr(priors, name), Mapping):
            hint = " (read_gravity(path, graph) gives one)" if name == "gravity" else ""
            raise GraphError(f"{name} priors are no mapping from nodes, expected a dict{hint}")
    assert isinstance(priors.rigs, Mapping)
    fixed = of_nodes(graph, priors.fixed, "fixed")
    absolute = _pairs(of_nodes(graph, priors.absolute, "absolute"))
    gravity = _pairs(of_nodes(graph, priors.gravity, "gravity"))
    rigs = _pairs(of_nodes(graph, priors.rigs, "rig"), "a frame and the camera's rotation in it")
    for item in rigs:
        if not isinstance(item.first, (int, str, np.integer)):
            raise GraphError(
                f"{item.what} has the frame {item.first!r}, expected an integer or a name"
            )
    frame_rows = {frame: k for k, frame in enumerate(dict.fromkeys(p.first for p in rigs))}
    return _core.Priors(
        fixed=_rows(fixed),
        fixed_rotations=_stack([as_floats(p.value, (3, 3), p.entries) for p in fixed], (3, 3)),
        absolute=_rows(absolute),
        absolute_rotations=_stack(
            [as_floats(p.first, (3, 3), p.entries) for p in absolute], (3, 3)
        ),
        absolute_weights=_stack([_weight(p) for p in absolute]),
        gravity=_rows(gravity),
        gravity_downs=_stack([as_floats(p.first, (3,), p.entries) for p in gravity], (3,)),
        gravity_weights=_stack([_weight(p) for p in gravity]),
        rigs=_rows(rigs),
        rig_frames=np.array([frame_rows[p.first] for p in rigs], dtype=np.int64),
        rig_rotations=_stack([as_floats(p.second, (3, 3), p.entries) for p in rigs], (3, 3)),
        down=as_floats(priors.down, (3,), "down"),
    )


def prior_error(graph: MeasurementGraph, error: _core.InvalidPrior) -> GraphError:
    """What the core refuses, by the node's name."""
    kind, row, reason = error.args
    of = "down" if kind == "down" else _name(graph, kind, row)
    return GraphError(f"{of} {reason}")


def _restored(
    graph: MeasurementGraph,
    priors: Priors,
    weights: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
) -> Grounded:
    grounded = ground(graph, priors)
    assert grounded is not None
    return grounded if weights is None else grounded.with_prior_weights(*weights)


@dataclass(frozen=True)
class OfNode:
    """What is known of a node, under a name for errors."""

    row: int
    what: str
    value: Any

    @property
    def entries(self) -> str:
        """A name of its entries."""
        return f"the entries of {self.what}"

    @property
    def first(self) -> Any:
        """The first of a pair."""
        return self.value[0]

    @property
    def second(self) -> Any:
        """The second of a pair."""
        return self.value[1]


def _name(graph: MeasurementGraph, kind: str, row: int) -> str:
    return f"the {kind} prior of node {graph.nodes[row].item()!r}"


def of_nodes(graph: MeasurementGraph, priors: Mapping[Any, Any], kind: str) -> list[OfNode]:
    """What is known of nodes, with their rows; GraphError for one that is not in the graph."""
    if not priors:
        return []
    keys = list(priors)
    ids = as_ids([key.item() if isinstance(key, np.generic) else key for key in keys], kind)
    rows = rows_of(ids, graph.nodes)
    if (rows < 0).any():
        node = keys[int(np.argmin(rows))]
        raise GraphError(f"the {kind} prior of node {node!r}: it is not in the graph")
    return [
        OfNode(row, _name(graph, kind, row), priors[key]) for row, key in zip(rows.tolist(), keys)
    ]


def _pairs(items: list[OfNode], expected: str = "what is known and its weight") -> list[OfNode]:
    for item in items:
        if not isinstance(item.value, (tuple, list)) or len(item.value) != 2:
            raise GraphError(f"{item.what} is {item.value!r}, expected a pair of {expected}")
    return items


def _weight(item: OfNode) -> float:
    if not isinstance(item.second, (int, float, np.number)):
        raise GraphError(f"{item.what} has the weight {item.second!r}, expected a number")
    return float(item.second)


def _rows(items: list[OfNode]) -> NDArray[np.int64]:
    return np.array([item.row for item in items], dtype=np.int64)


def _stack(values: list[Any], shape: tuple[int, ...] = ()) -> NDArray[np.float64]:
    return np.array(values, dtype=np.float64).reshape(len(values), *shape)
