"""The measurement graph: what was measured between which nodes, and how much it counts."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.base.errors import require
from rotavg.base.html import table
from rotavg.graph.contents import (
    Quaternions,
    Source,
    contents_of,
    given_quaternions,
    given_rotvecs,
    quaternions_of,
)
from rotavg.graph.conventions import Convention, QuaternionOrder
from rotavg.graph.ids import IdArray, as_edges
from rotavg.graph.nearest import TOLERANCE
from rotavg.graph.selection import among, in_large, in_largest, marked
from rotavg.graph.translations import RelativeTranslations


class MeasurementGraph:
    """Relative rotations between nodes; immutable, every array is read-only.

    Each edge (i, j) carries R_ij = i_from_j, which maps coordinates of j to coordinates of i, so
    that R_i R_ij = R_j for R_i = world_from_i (pose family). Parallel edges add up, several
    components are fine, an edge from a node to itself is not. An edge of weight 0 is not used: it
    is left out, and `notes` tells so.

    Args:
        edges: (m, 2) node ids: 64-bit integers or names (str), not mixed.
        rotations: (m, 3, 3) relative rotations; each is replaced by the nearest rotation, and
            refused if it is further away from one than `tolerance`.
        weights: (m,) weights, 0 or in [1e-100, 1e100]; by default 1, or 3 / tr of the covariances.
        nodes: (n,) ids in the order that all results follow; may hold nodes without an edge. By
            default the ids that occur, ascending.
        convention: family of `rotations`: "pose" as above, or "vision" with R_ij = R_j R_i^T for
            R_i = camera_from_world (COLMAP, GLOMAP, OpenCV), transposed on the way in.
        covariances: (m, 3, 3) radians^2, of the rotation vector e of every measurement's noise,
            `rotations` = truth exp([e]): in the frame of j, or with convention="vision" of i.
            They are for `solve(..., anisotropic=True)`.
        translations: of the edges, where they were measured; in the pose family.
        source: what a reader kept of the file, for a writer of the same format.
        notes: what a reader wants its user to know.
        tolerance: the largest entry of |R^T R - I| that is taken for a rotation's.
        skip_self_edges: whether to leave out edges from a node to itself, instead of refusing them;
            `notes` tells how many.

    Attributes:
        nodes: (n,) ids.
        covariances: (m, 3, 3), in the frame of j; or None.
        translations: as given, or None.
        source: as given, or None.
        notes: as given, and what was left out.

    An edge takes 64 bytes: a quaternion, its ends, its weight. The arrays that are made of these,
    `edges`, `indices`, `rotations`, `quaternions` and `weights`, are kept once they are asked for.

    Raises:
        GraphError: anything breaks these rules; its `edge` is the row of the edge to blame.
    """

    nodes: IdArray
    covariances: NDArray[np.float64] | None
    translations: RelativeTranslations | None
    source: Source | None
    notes: tuple[str, ...]

    def __init__(
        self,
        edges: ArrayLike,
        rotations: ArrayLike | Quaternions,
        weights: ArrayLike | None = None,
        nodes: ArrayLike | None = None,
        *,
        convention: Convention = "pose",
        covariances: ArrayLike | None = None,
        translations: RelativeTranslations | None = None,
        source: Source | None = None,
        notes: tuple[str, ...] = (),
        tolerance: float = TOLERANCE,
        skip_self_edges: bool = False,
    ) -> None:
        made = contents_of(
            edges, rotations, weights, nodes, convention, covariances, translations, source, notes,
            tolerance, skip_self_edges,
        )  # fmt: skip
        self._core = made.core
        self.nodes = made.nodes
        self.covariances = made.covariances
        self.translations = made.translations
        self.source = made.source
        self.notes = made.notes
        self._immutable = True

    def __setattr__(self, name: str, value: Any) -> None:
        if "_immutable" in self.__dict__:
            raise AttributeError(
                f"a MeasurementGraph cannot be changed ({name}); make a new one, for example by "
                "with_weights()"
            )
        super().__setattr__(name, value)

    @cached_property
    def edges(self) -> IdArray:
        """(m, 2) node ids; m counts the edges that are used."""
        return read_only(self.nodes[self.indices])

    @cached_property
    def indices(self) -> NDArray[np.int32]:
        """(m, 2) the edges as rows of `nodes`."""
        return read_only(self._core.indices)

    @cached_property
    def rotations(self) -> NDArray[np.float64]:
        """(m, 3, 3) i_from_j, pose family."""
        return read_only(self._core.rotations)

    @cached_property
    def quaternions(self) -> NDArray[np.float64]:
        """(m, 4) the same as xyzw, w >= 0."""
        return read_only(self._core.quaternions)

    @cached_property
    def weights(self) -> NDArray[np.float64]:
        """(m,)."""
        return read_only(self._core.weights)

    @classmethod
    def from_quaternions(
        cls,
        edges: ArrayLike,
        quaternions: ArrayLike,
        weights: ArrayLike | None = None,
        nodes: ArrayLike | None = None,
        *,
        order: QuaternionOrder = "xyzw",
        convention: Convention = "pose",
        covariances: ArrayLike | None = None,
        translations: RelativeTranslations | None = None,
        source: Source | None = None,
        notes: tuple[str, ...] = (),
        tolerance: float = TOLERANCE,
        skip_self_edges: bool = False,
    ) -> MeasurementGraph:
        """Graph from relative rotations as Hamilton quaternions (m, 4), of any length but zero.

        `order` is "xyzw" (SciPy, g2o, pycolmap) or "wxyz" (COLMAP's files, Eigen's constructor).
        All else, and the errors, are as in the constructor.
        """
        ids = as_edges(edges)
        return cls(
            ids,
            given_quaternions(ids, quaternions, order),
            weights,
            nodes,
            convention=convention,
            covariances=covariances,
            translations=translations,
            source=source,
            notes=notes,
            tolerance=tolerance,
            skip_self_edges=skip_self_edges,
        )

    @classmethod
    def from_rotvecs(
        cls,
        edges: ArrayLike,
        rotvecs: ArrayLike,
        weights: ArrayLike | None = None,
        nodes: ArrayLike | None = None,
        *,
        degrees: bool = False,
        convention: Convention = "pose",
        covariances: ArrayLike | None = None,
        translations: RelativeTranslations | None = None,
        source: Source | None = None,
        notes: tuple[str, ...] = (),
        tolerance: float = TOLERANCE,
        skip_self_edges: bool = False,
    ) -> MeasurementGraph:
        """Graph from relative rotations as rotation vectors (m, 3): axis times angle in radians.

        With `degrees` the angle is in degrees. Where some are longer than a full turn, `notes` asks
        whether they are, and a UserWarning, too, where most are. All else, and the errors, are as
        in the constructor.
        """
        ids = as_edges(edges)
        given, asked = given_rotvecs(ids, rotvecs, degrees=degrees)
        return cls(
            ids,
            given,
            weights,
            nodes,
            convention=convention,
            covariances=covariances,
            translations=translations,
            source=source,
            notes=(*notes, *asked),
            tolerance=tolerance,
            skip_self_edges=skip_self_edges,
        )

    @classmethod
    def from_scipy(
        cls,
        edges: ArrayLike,
        rotations: Any,
        weights: ArrayLike | None = None,
        nodes: ArrayLike | None = None,
        *,
        convention: Convention = "pose",
        covariances: ArrayLike | None = None,
        translations: RelativeTranslations | None = None,
        source: Source | None = None,
        notes: tuple[str, ...] = (),
        tolerance: float = TOLERANCE,
        skip_self_edges: bool = False,
    ) -> MeasurementGraph:
        """Graph from a `scipy.spatial.transform.Rotation` of m relative rotations.

        (The constructor understands these, too.) All else, and the errors, are as in the
        constructor.
        """
        return cls.from_quaternions(
            edges,
            quaternions_of(rotations),
            weights,
            nodes,
            convention=convention,
            covariances=covariances,
            translations=translations,
            source=source,
            notes=notes,
            tolerance=tolerance,
            skip_self_edges=skip_self_edges,
        )

    @classmethod
    def from_networkx(
        cls,
        graph: Any,
        rotation: str = "rotation",
        weight: str = "weight",
        *,
        covariance: str = "covariance",
        convention: Convention = "pose",
        skip_self_edges: bool = False,
    ) -> MeasurementGraph:
        """Graph from a `networkx.DiGraph` or `MultiDiGraph`; rows follow its order of nodes.

        Each edge (i, j) has an attribute `rotation` that holds R_ij as a matrix (3, 3) or a
        quaternion (4,) xyzw, and may have a `weight` (1 otherwise). All or none have a `covariance`
        (3, 3), radians^2; then all or none have a weight (3 / tr of it otherwise).
        """
        from rotavg.graph.networkx import arrays_from_networkx

        given = arrays_from_networkx(graph, rotation, weight, covariance)
        return cls(**given, convention=convention, skip_self_edges=skip_self_edges)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        *,
        nodes: ArrayLike | None = None,
        convention: Convention = "pose",
        skip_self_edges: bool = False,
    ) -> MeasurementGraph:
        """Graph from a `pandas.DataFrame` with a row for each edge.

        Its columns: `i` and `j`; the relative rotation as a quaternion `qx qy qz qw`, a rotation
        vector `rx ry rz` in radians, or a matrix `r00` ... `r22` by rows; if there are any,
        `weight` and the covariance `cxx cxy cxz cyy cyz czz`. Others are not looked at.
        `to_dataframe` makes such a frame.

        Raises GraphError if it lacks a column, and as the constructor does.
        """
        from rotavg.graph.dataframes import arrays_from_frame

        given = arrays_from_frame(frame)
        return cls(**given, nodes=nodes, convention=convention, skip_self_edges=skip_self_edges)

    def to_dataframe(self) -> Any:
        """A `pandas.DataFrame` of the edges: `i`, `j`, `qx qy qz qw` (pose family), `weight`.

        Where there are covariances, `cxx cxy cxz cyy cyz czz` (radians^2) as well. Needs pandas,
        the extra [pandas].
        """
        from rotavg.graph.dataframes import columns_of_covariances, frame_of_edges

        further = {"weight": self.weights, **columns_of_covariances(self.covariances)}
        return frame_of_edges(self.edges, self.rotations, further)

    def to_networkx(self) -> Any:
        """A `networkx.MultiDiGraph`, edges with `rotation` (3, 3), `weight`, any `covariance`."""
        from rotavg.graph.networkx import networkx_from_arrays

        return networkx_from_arrays(
            self.edges, self.rotations, self.weights, self.nodes, self.covariances
        )

    def to_scipy(self) -> Any:
        """The relative rotations as a `scipy.spatial.transform.Rotation` of length m."""
        return require("scipy.spatial.transform", "scipy").Rotation.from_matrix(self.rotations)

    @property
    def num_nodes(self) -> int:
        """Number of nodes, n."""
        return len(self.nodes)

    @property
    def num_edges(self) -> int:
        """Number of edges, m."""
        return self._core.num_edges

    @property
    def num_bytes(self) -> int:
        """Memory that the edges and nodes take, without the arrays made on request."""
        return self._core.bytes

    def components(self) -> NDArray[np.int32]:
        """Label (n,) of each node's connected component, numbered by their first nodes."""
        return np.asarray(_core.components(self._core), dtype=np.int32)

    def largest_component(self) -> MeasurementGraph:
        """The graph of the component with the most nodes (the first of equals)."""
        kept = in_largest(self.components())
        return self if kept.all() else self.subgraph(self.nodes[kept])

    def without_small_components(self, min_nodes: int) -> MeasurementGraph:
        """The components with at least `min_nodes` nodes. Raises GraphError if there are none."""
        kept = in_large(self.components(), min_nodes)
        return self if kept.all() else self.subgraph(self.nodes[kept])

    def subgraph(self, nodes: ArrayLike) -> MeasurementGraph:
        """The graph of these nodes, in this order, and of the edges between them.

        Raises GraphError for an unknown or repeated node, and where no edge is left.
        """
        rows, edges = among(nodes, self.nodes, self.indices)
        return self._selected(edges, self.nodes[rows])

    def edge_subgraph(self, edges: ArrayLike) -> MeasurementGraph:
        """The graph of all nodes and of the edges (m,) that are marked True.

        Raises GraphError for anything but m booleans, and where no edge is left.
        """
        return self._selected(marked(edges, self.num_edges), self.nodes)

    def _selected(self, edges: NDArray[np.bool_], nodes: IdArray) -> MeasurementGraph:
        return MeasurementGraph(
            self.edges[edges],
            Quaternions(self._core.scaled_quaternions[edges]),
            self.weights[edges],
            nodes,
            covariances=None if self.covariances is None else self.covariances[edges],
            translations=None if self.translations is None else self.translations.select(edges),
            source=None if self.source is None else self.source.select(edges),
            notes=self.notes,
        )

    def with_weights(self, weights: ArrayLike) -> MeasurementGraph:
        """The same graph with other weights (m,); without the edges whose weight is 0.

        Raises GraphError for a weight that the constructor refuses, or where none is left.
        """
        return _rebuild(*self._parts(weights))

    def with_notes(self, *notes: str) -> MeasurementGraph:
        """The same graph with more for its user to know."""
        result = object.__new__(MeasurementGraph)
        result.__dict__.update(self.__dict__, notes=self.notes + notes)
        return result

    def _repr_html_(self) -> str:
        parts = int(self.components().max()) + 1
        rows = [
            ("nodes", f"{self.num_nodes} in {parts} component{'s' if parts > 1 else ''}"),
            ("edges", str(self.num_edges)),
            ("weights", f"{self.weights.min():.4g} to {self.weights.max():.4g}"),
            *(("note", note) for note in self.notes),
        ]
        return table("Measurement graph", rows)

    def __repr__(self) -> str:
        return f"MeasurementGraph({self.num_nodes} nodes, {self.num_edges} edges)"

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, self._parts(self.weights)

    def _parts(self, weights: ArrayLike) -> tuple[Any, ...]:
        """What it is made of; quaternions of the length of their weights keep their bits."""
        return (
            self.edges, self._core.scaled_quaternions, weights, self.nodes, self.covariances,
            self.translations, self.source, self.notes,
        )  # fmt: skip


def _rebuild(
    edges: IdArray,
    quaternions: NDArray[np.float64],
    weights: ArrayLike,
    nodes: IdArray,
    covariances: NDArray[np.float64] | None,
    translations: RelativeTranslations | None,
    source: Source | None,
    notes: tuple[str, ...],
) -> MeasurementGraph:
    return MeasurementGraph(
        edges, Quaternions(quaternions), weights, nodes,
        covariances=covariances, translations=translations, source=source, notes=notes,
    )  # fmt: skip
