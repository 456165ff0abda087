"""What solving gives back: rotations, how they were found, and how good they are known to be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.base.errors import SolverError
from rotavg.base.html import table
from rotavg.graph import conventions
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.node_mapping import NodeMapping
from rotavg.priors.grounded import Grounded
from rotavg.priors.rigs import RigFit
from rotavg.solving.certificate import Certificate, Verdict
from rotavg.solving.printed import head, rows
from rotavg.solving.robust import RobustFit
from rotavg.solving.status import Status, Timings, Trace
from rotavg.solving.uncertainty import Frame, covariances
from rotavg.solving.unchecked import bridges, hanging_groups, unchecked_edges


@dataclass(frozen=True, eq=False)
class Solution(NodeMapping):
    """Absolute rotations for a measurement graph, and a mapping from its node ids to them.

    Every figure is evaluated at `rotations`.

    Attributes:
        graph: what was solved.
        rotations: (n, 3, 3) world_from_node, rows as in `graph.nodes`; the first node of every
            component that no prior holds has the identity (with rigs, its first frame), unless
            another gauge was asked for.
        objective: f = sum of w |R_i R_ij - R_j|_F^2, equation (3).
        gradient_norm: Euclidean norm of the gradient, per radian.
        relative_gradient: largest |gradient of node i| / degree of i, in radians:
            what the default stopping rule looks at.
        status: how the solver ended.
        iterations: sweeps over all nodes; of an accelerated "bcd" pairs of them, to and fro; steps
            of "newton".
        method: the method that was used, in the end.
        reason: what "auto" chose and why, in one line; empty for other methods.
        init: where it started: the name of an initial value, "given" (an array), or "solution"
            (a warm start).
        trace: the course of the iteration.
        timings: wall-clock seconds.
        certificate: how good the answer is known to be; None if it was not asked for.
        component: (n,) label of each node's connected component.
        robust: with a robust loss, what came of it; None for "l2". `objective`, the gradient and
            the certificate are then those of the problem with the final `edge_weights`, and
            `trace` is that of the robust objective at its final scale, which never rises.
        grounded: with priors, the problem that was solved: that of the measurements and the
            priors, whose figures `objective`, the gradient and the certificate are. The world
            is then no free gauge, and its component has the label 0.
        rigs: with `Rigs`, the sensors' rotations in them; the certificate is that of the frames
            with the sensors held, and `rigs.lower_bound` is for both together.
        anisotropic: whether the covariances C of the graph were honoured. "": no. "chordal": the
            objective, with its gradient and certificate, is sum of 4 v^T C^-1 v (see `solve`).
            "log": it is sum of r^T C^-1 r, r = log(R_ij^T R_i^T R_j), at a local minimum, which
            has no certificate.
        isotropic: then, where it started: of "chordal" the solution with one weight for each edge,
            without certificate; of "log" the "chordal" one, with it.
        upright: whether gravity was held and headings alone were free (`solve_headings`): the
            gradient and the certificate are theirs.
    """

    graph: MeasurementGraph
    rotations: NDArray[np.float64]
    objective: float
    gradient_norm: float
    relative_gradient: float
    status: Status
    iterations: int
    method: str
    reason: str
    init: str
    trace: Trace
    timings: Timings
    certificate: Certificate | None
    component: NDArray[np.int32]
    robust: RobustFit | None = None
    grounded: Grounded | None = None
    rigs: RigFit | None = None
    isotropic: Solution | None = None
    anisotropic: Literal["", "chordal", "log"] = ""
    upright: bool = False

    @cached_property
    def quaternions(self) -> NDArray[np.float64]:
        """(n, 4) Hamilton quaternions xyzw, w >= 0."""
        return read_only(conventions.quaternions_from_matrices(self.rotations))

    @cached_property
    def residual_angles(self) -> NDArray[np.float64]:
        """(m,) angle between R_i R_ij and R_j of every edge, radians."""
        return read_only(_core.residual_angles(self.graph._core, self.rotations))

    @property
    def edge_weights(self) -> NDArray[np.float64]:
        """(m,) weights that the edges had in the objective: the graph's, times the robust ones."""
        return self.graph.weights if self.robust is None else self.robust.edge_weights

    @property
    def edge_shares(self) -> NDArray[np.float64]:
        """(m,) what a robust loss has left of each edge's weight, from 0 to 1; 1 without one."""
        return np.minimum(self.edge_weights / self.graph.weights, 1.0)

    @cached_property
    def edge_verdicts(self) -> NDArray[np.str_]:
        """(m,) "inlier", "bridge" (no cycle checks it), "trusted", or why it is an outlier.

        "robust_weight": its residual is beyond the threshold. "cycle_check": no short cycle agrees
        with it. "weak_part": beyond the threshold, and no inlier joins the same two parts of the
        graph. "excluded": left out as asked. Without a robust loss no edge is an outlier.
        """
        if self.robust is not None:
            return self.robust.edge_verdicts
        return read_only(np.where(bridges(self.graph), "bridge", "inlier"))

    @cached_property
    def is_outlier(self) -> NDArray[np.bool_]:
        """(m,) whether the edge's verdict is that of an outlier."""
        return read_only(~np.isin(self.edge_verdicts, ("inlier", "bridge", "trusted")))

    @property
    def inlier_graph(self) -> MeasurementGraph:
        """The graph of all nodes, without the edges that are outliers; GraphError if all are."""
        return self.graph.edge_subgraph(~self.is_outlier) if self.is_outlier.any() else self.graph

    @cached_property
    def is_unchecked(self) -> NDArray[np.bool_]:
        """(m,) whether outliers alone check the edge: all cycles through it pass through some.

        Of edges in series that contradict the others, the one with the largest residual is named,
        which need not be the wrong one; the rest of the series is unchecked. So is an edge that
        alone holds a part after those that contradict it were rejected. Bridges are not, as
        nothing ever checked them. Priors do not count. Without a robust loss no edge is.
        """
        return unchecked_edges(self.graph, ~self.is_outlier)

    @cached_property
    def hanging_groups(self) -> list[NDArray[Any]]:
        """Groups of nodes (their ids) that checked edges hold together, but not to the rest.

        A group hangs on the largest of its component by edges that are bridges or unchecked
        (`is_unchecked`): if one of them is wrong, the group is turned as a whole, and no residual
        shows it. The largest group comes first. Fewer than three nodes, or two in a hundred, are
        none. Priors do not count. Without a robust loss there are none.
        """
        if self.robust is None:
            return []
        checks = ~self.is_outlier & ~self.is_unchecked & ~bridges(self.graph)
        checks |= self.edge_verdicts == "trusted"
        # What rigs alone join hangs on no edge.
        component = self.graph.components().astype(np.int64)
        part = self.robust.part + component * self.robust.num_parts
        return hanging_groups(self.graph, checks, part)

    def covariances(
        self,
        pairs: ArrayLike | None = None,
        *,
        noise_variance: float | None = None,
        frame: Frame = "world",
    ) -> NDArray[np.float64]:
        """Covariances (k, 3, 3), radians^2, of the errors of the rotations, to first order.

        The error is the rotation vector w with R = exp([w]) R_true (docs/uncertainty.md): of every
        node relative to the first node of its component, which is held and has zero; or of chosen
        pairs (i, j), that of R_j as seen from i, the covariance of w_j - w_i, whatever is held.
        They come from the inverse of the Hessian by selected inversion, and hold where the noise is
        small and independent, the same in all directions, and its variance inverse to the weight.
        With a robust loss the edges and priors that are no outliers count with their given weights;
        where priors contradict one another so much that there is no minimum, they count with what
        the loss has left of them, and the noise is estimated from the edges.

        Args:
            pairs: (k, 2) node ids, the nodes of each pair in one component; None for all nodes
                relative to the gauge, (n, 3, 3).
            noise_variance: per axis of the noise of an edge of weight 1: 1 where the weights are
                inverse variances, radians^-2; a half for the kappa of g2o files; None to
                estimate it from the residuals.
            frame: of w: "world", or "node" for R = R_true exp([w]), of a pair that of its second.

        Raises:
            SolverError: the rotations are no strict minimum; the noise cannot be estimated, as
                there are no cycles; or the factor does not fit in memory.
            GraphError: an unknown node, or a pair in two components.
            OptionError: an option out of range.
        """
        if self.upright:
            raise SolverError("headings alone were free: their covariances are not known")
        found = read_only(covariances(self, pairs, noise_variance, frame))
        if pairs is None and frame == "world":
            self.__dict__["_covariances"] = found
        return found

    @property
    def known_covariances(self) -> NDArray[np.float64] | None:
        """What `covariances()` has found of all nodes, for files and reports; None if not asked."""
        return self.__dict__.get("_covariances")

    def edges_to_dataframe(self) -> Any:
        """A `pandas.DataFrame` of the edges, as `graph.to_dataframe()`, and what came of them.

        Further columns: `residual` (radians), `final_weight` (`edge_weights`), `is_outlier`,
        `verdict`. Needs pandas, the extra [pandas].
        """
        from rotavg.graph.dataframes import frame_of_edges

        further = {
            "weight": self.graph.weights,
            "residual": self.residual_angles,
            "final_weight": self.edge_weights,
            "is_outlier": self.is_outlier,
            "verdict": self.edge_verdicts,
        }
        return frame_of_edges(self.graph.edges, self.graph.rotations, further)

    @property
    def verdict(self) -> Verdict | None:
        """The certificate's verdict; None if none was asked for."""
        return None if self.certificate is None else self.certificate.verdict

    @property
    def solved(self) -> bool:
        """Whether the answer is certified; converged, if no certificate was asked for."""
        if self.certificate is None:
            return self.status.converged
        return self.certificate.verdict != Verdict.NOT_CERTIFIED

    @property
    def num_components(self) -> int:
        """Number of connected components."""
        return int(self.component.max()) + 1

    @property
    def num_parts_given(self) -> int:
        """Number of parts if no edge, and no prior, is an outlier: gravity alone joins none."""
        return self.num_components if self.grounded is None else self.grounded.core.num_parts

    def __str__(self) -> str:
        return "\n".join([head(self), *(f"  {name:<11} {text}" for name, text in rows(self))])

    def _repr_html_(self) -> str:
        return table(head(self), rows(self))

    def __repr__(self) -> str:
        verdict = "no certificate" if self.certificate is None else str(self.certificate.verdict)
        return (
            f"Solution({self.graph.num_nodes} rotations, objective {self.objective:.9g}, "
            f"{self.status.name.lower()}, {verdict})"
        )


class Interrupted(KeyboardInterrupt):
    """Ctrl-C after the iteration had converged, before its certificate was there.

    Attributes:
        solution: what had been reached; its certificate says that it is missing.
    """

    def __init__(self, solution: Solution) -> None:
        super().__init__("interrupted before the certificate was there")
        self.solution = solution

    def __reduce__(self) -> tuple[Any, ...]:
        return Interrupted, (self.solution,)
