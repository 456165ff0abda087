"""Rotation averaging while data come in: the optimum and its proof, after every edge."""

from __future__ import annotations

from typing import Any, NoReturn, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg._core import OnlineState
from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError, OptionError, UnknownNodeError
from rotavg.graph import conventions
from rotavg.graph.conventions import Convention
from rotavg.graph.ids import IdArray, as_edges, as_ids, edge_error
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving import options
from rotavg.solving.certificate import Verdict
from rotavg.solving.online_solution import OnlineSolution
from rotavg.solving.robust import Loss

_LOSSES = tuple(loss for loss in get_args(Loss) if loss != "auto")


class Online:
    """Incremental rotation averaging: edges come and go, and the optimum is kept up to date.

    After every call the rotations are those of the optimum to the tolerance, and a bound tells how
    far they can be from it: as after `solve()`, but in a fraction of the time. An edge to a new
    node costs next to nothing and leaves the proof as it is; the cost of an edge that closes a
    cycle depends on how many nodes it moves.
    docs/online.md has the mathematics.

        online = rotavg.Online()
        online.add([("a", "b"), ("b", "c")], rotations)
        (closure,) = online.add([("c", "a")], rotation)
        online.verdict, online.gap, online["c"]
        online.remove([closure])

    Args:
        tolerance: of f(R) - f*, as a part of f, below 1: how near to the optimum they are. Changes
            that are proved to gain less wait for others: with 1e-2 most do, and a step takes a
            fraction of the time.
        certificate_tolerance: largest relative gap that is called optimal; `tolerance`, where that
            is larger.
        loss: "l2", or a robust loss of the edges that are not trusted; "auto" is none of those.
            "tls" leaves out edges that are proved to cost more than the loss lets them, and, one by
            one, those furthest beyond the scale; it takes them back where the rotations of a later
            time agree with them. What is proved is the optimum of the least squares with the
            weights in use.
        loss_scale: of a robust loss, radians.
        second_opinions: whether all edges are judged at once now and then, as by `solve`, since
            edges that came first are not always the right ones. Such a step takes as long as that
            does (docs/online.md says when there is one).

    Raises:
        OptionError: an option is out of range.
    """

    def __init__(
        self,
        *,
        tolerance: float = 1e-10,
        certificate_tolerance: float = 1e-6,
        loss: str = "l2",
        loss_scale: float | None = None,
        second_opinions: bool = True,
    ) -> None:
        if loss not in _LOSSES:
            raise OptionError(f"loss is {loss!r}; expected one of {', '.join(map(repr, _LOSSES))}")
        scale = options.angle("loss_scale", loss_scale, None)
        try:
            self._core = _core.Online(
                tolerance=options.share("tolerance", tolerance),
                certificate_tolerance=options.nonnegative(
                    "certificate_tolerance", certificate_tolerance
                ),
                loss=loss,
                loss_scale=scale,
                second_opinions=bool(second_opinions),
            )
        except ValueError as error:
            raise OptionError(str(error)) from None
        self._number_of: dict[Any, int] = {}  # of nodes with names
        self._names: list[str] = []

    def add(
        self,
        edges: ArrayLike,
        rotations: ArrayLike,
        weights: ArrayLike | None = None,
        *,
        nodes: ArrayLike | None = None,
        trusted: ArrayLike | str | None = None,
        convention: Convention = "pose",
    ) -> NDArray[np.int32]:
        """Add edges, and nodes where they are new.

        Args:
            edges: (m, 2) node ids: 64-bit integers or names (str), not mixed.
            rotations: (m, 3, 3), or (3, 3) of a single edge: i_from_j.
            weights: (m,), or a number of a single edge: 0 (not used, for now) or in
                [1e-100, 1e100]; by default 1.
            nodes: ids that are to be there whether or not an edge has them, in this order and
                before those of the edges.
            trusted: (m,) which edges a robust loss leaves alone; by default "odometry", those
                between consecutive integers. Of the edges of one call they count first.
            convention: of the rotations, as for `MeasurementGraph`.

        Returns:
            (m,) the numbers of the edges, for `remove` and `set_weights`.

        Raises:
            GraphError: anything breaks these rules; then nothing is changed. Its `edge` is the row
                of the edge to blame.
        """
        ids = as_edges(edges) if np.size(edges) else np.zeros((0, 2), dtype=np.int64)
        m = len(ids)
        given = rotations
        if m == 1 and np.ndim(rotations) == 2:
            given = np.asarray(rotations)[None]
        if m == 0 and np.size(given) == 0:
            given = np.zeros((0, 3, 3))
        matrices = as_floats(given, (m, 3, 3), "rotations", copy=False)
        conventions.check_family(convention)
        if convention == "vision":
            matrices = np.ascontiguousarray(np.swapaxes(matrices, 1, 2))
        if m == 1 and weights is not None and np.ndim(weights) == 0:
            weights = np.reshape(weights, 1)
        values = np.ones(m) if weights is None else as_floats(weights, (m,), "weights", copy=False)
        mask = self._trusted(ids, trusted)
        names_before = len(self._names)
        try:
            declared = self._numbers(np.zeros(0) if nodes is None else as_ids(nodes, "nodes"))
            numbers: NDArray[np.int32] = self._core.add(
                self._numbers(ids), matrices, values, mask, declared.ravel()
            )
        except BaseException as error:
            for name in self._names[names_before:]:
                del self._number_of[name]
            del self._names[names_before:]
            if isinstance(error, _core.InvalidEdge):
                edge, reason = error.args
                raise edge_error(ids, int(edge), reason) from None
            raise
        return numbers

    def remove(self, edges: ArrayLike) -> None:
        """Remove edges (k,), by the numbers that `add` returned. Nodes stay.

        Raises GraphError for a number that is none of an edge that is there.
        """
        self._change(self._core.remove, _edge_numbers(edges))

    def set_weights(self, edges: ArrayLike, weights: ArrayLike) -> None:
        """Give edges (k,) other weights (k,); 0 keeps an edge unused until it gets another one.

        Raises GraphError as `remove`, and for a weight out of bounds.
        """
        numbers = _edge_numbers(edges)
        values = as_floats(weights, numbers.shape, "weights", copy=False)
        self._change(self._core.set_weights, numbers, values)

    def _change(self, function: Any, numbers: NDArray[np.int32], *arguments: Any) -> None:
        try:
            function(numbers, *arguments)
        except _core.InvalidEdge as error:
            raise GraphError(str(error.args[1]), edge=int(error.args[0])) from None

    @property
    def state(self) -> OnlineState:
        """Sizes, objective, gap and verdict, and what the last call did."""
        return self._core.state

    @property
    def verdict(self) -> Verdict:
        """Whether the rotations are proved to be the optimum, to the tolerance of certificates."""
        return Verdict(self._core.state.verdict)

    @property
    def objective(self) -> float:
        """f(R), equation (3), with the weights in use."""
        return float(self._core.state.objective)

    @property
    def gap(self) -> float:
        """Bound on f(R) - f*."""
        return float(self._core.state.gap)

    @property
    def relative_gap(self) -> float:
        """The gap as a part of f, of the worst component."""
        return float(self._core.state.relative_gap)

    @property
    def num_nodes(self) -> int:
        """Nodes that are there."""
        return int(self._core.state.num_nodes)

    @property
    def num_edges(self) -> int:
        """Edges in use."""
        return int(self._core.state.num_edges)

    @property
    def num_outliers(self) -> int:
        """Edges that the robust loss leaves less than half their weight."""
        return int(self._core.state.num_outliers)

    @property
    def nodes(self) -> IdArray:
        """(n,) ids, in the order in which they came."""
        numbers = self._core.nodes()
        return np.array([self._names[k] for k in numbers]) if self._names else numbers

    @property
    def rotations(self) -> NDArray[np.float64]:
        """(n, 3, 3) world_from_node, the identity at the first node of every component."""
        return self._core.rotations()

    @property
    def edge_weights(self) -> NDArray[np.float64]:
        """The weights in use, by number, of all edges ever added; 0 of those removed."""
        return self._core.edge_weights()

    @property
    def solution(self) -> OnlineSolution:
        """All that is known now."""
        state = self._core.state
        return OnlineSolution(
            read_only(self.nodes),
            read_only(self.rotations),
            state.objective,
            Verdict(state.verdict),
            state.gap,
            state.relative_gap,
            state.num_components,
        )

    @property
    def graph(self) -> MeasurementGraph:
        """The edges in use, with these weights, and all nodes. GraphError where there is none."""
        numbers, ends, rotations, _ = self._core.edges()
        weights = self.edge_weights[numbers]
        used = weights > 0.0
        ends = ends[used]
        edges = np.array(self._names)[ends] if self._names else ends
        return MeasurementGraph(edges, rotations[used], weights[used], self.nodes)

    def __getitem__(self, node: Any) -> NDArray[np.float64]:
        """world_from_node (3, 3), at once however large the graph is.

        In a gauge of its own, where rotations change only with what moves them: it differs from
        that of `rotations` by one rotation of every component.
        """
        try:
            number = self._number_of[node] if self._names else int(node)
            rotation: NDArray[np.float64] = self._core.rotation(number)[0]
        except (KeyError, ValueError, TypeError):
            raise UnknownNodeError(f"there is no node {node!r}") from None
        return rotation

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        """Refuse copies and pickles, which would share its state or lose it."""
        raise TypeError("an Online cannot be copied or pickled; its `solution` can")

    def __repr__(self) -> str:
        """Sizes and verdict."""
        return (
            f"Online({self.num_nodes} nodes, {self.num_edges} edges, f = {self.objective:.6g}, "
            f"{self.verdict})"
        )

    def _numbers(self, ids: IdArray) -> NDArray[np.int64]:
        """Ids as the core has them: as they are, or the numbers of names."""
        kind = "names" if ids.dtype.kind == "U" else "integers"
        if ids.size == 0:
            return np.zeros(ids.shape, dtype=np.int64)
        if self.num_nodes and (kind == "names") != bool(self._names):
            raise GraphError(f"the ids are {kind}, unlike those of the nodes that are there")
        if kind == "integers":
            if ids.dtype.kind == "u":
                raise GraphError("ids beyond 2**63 - 1 are not supported here")
            return ids.astype(np.int64, copy=False)
        for name in ids.ravel().tolist():
            if name not in self._number_of:
                self._number_of[name] = len(self._names)
                self._names.append(name)
        flat = [self._number_of[name] for name in ids.ravel().tolist()]
        return np.array(flat, dtype=np.int64).reshape(ids.shape)

    @staticmethod
    def _trusted(ids: IdArray, trusted: ArrayLike | str | None) -> NDArray[np.bool_] | None:
        if isinstance(trusted, str) and trusted != "odometry":
            raise GraphError(f'trusted is {trusted!r}; expected "odometry" or booleans (m,)')
        if trusted is None or isinstance(trusted, str):
            if ids.dtype.kind == "U" and trusted is not None:
                raise GraphError("the nodes have names, and so no edge joins consecutive numbers")
            if ids.dtype.kind == "U":
                return None
            mask: NDArray[np.bool_] = np.abs(ids[:, 1] - ids[:, 0]) == 1
            return mask
        given = np.asarray(trusted)
        if given.dtype != np.bool_ or given.shape != (len(ids),):
            raise GraphError(f"trusted has shape {given.shape}, expected booleans ({len(ids)},)")
        return np.ascontiguousarray(given)  # as the core reads it


def _edge_numbers(edges: ArrayLike) -> NDArray[np.int32]:
    numbers = np.atleast_1d(np.asarray(edges))
    if numbers.size == 0:
        return np.zeros(0, dtype=np.int32)
    if numbers.dtype.kind not in "iu" or numbers.ndim != 1:
        raise GraphError("expected the numbers of edges (k,), as add() returned them")
    if not ((numbers >= 0) & (numbers < 2**31 - 1)).all():
        bad = numbers[(numbers < 0) | (numbers >= 2**31 - 1)][0].item()
        raise GraphError(f"number {bad} is that of no edge")
    return numbers.astype(np.int32)
