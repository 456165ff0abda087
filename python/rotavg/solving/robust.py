"""What a robust loss makes of the edges and priors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import ReadOnly, read_only
from rotavg.graph.ids import IdArray, as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.priors import Priors
from rotavg.solving.stories import Alternative, alternative_from_core

Loss = Literal["l2", "auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls"]


@dataclass(frozen=True, eq=False)
class PriorFit(ReadOnly):
    """What a robust loss has made of absolute priors, or of gravity.

    Attributes:
        nodes: (k,) ids of the nodes that have one, in the order of the graph.
        noise: estimated standard deviation of the angle by which they are off, radians: of one
            with the median weight of its kind.
        threshold: of such a one; those further off are outliers, radians: 3 times the noise.
        given_weights: (k,) weights as they were given.
        weights: (k,) these times what the loss left of them.
        is_outlier: (k,) whether they are.
    """

    nodes: IdArray
    noise: float
    threshold: float
    given_weights: NDArray[np.float64]
    weights: NDArray[np.float64]
    is_outlier: NDArray[np.bool_]

    @property
    def believed_weights(self) -> NDArray[np.float64]:
        """(k,) the given weights, of outliers 1e-6 of them: as edges count in covariances."""
        return self.given_weights * np.where(self.is_outlier, 1e-6, 1.0)


@dataclass(frozen=True, eq=False)
class RobustFit(ReadOnly):
    """What a robust loss has found out.

    The residual r of an edge is the chord 2 sin(angle / 2) of its residual angle. What is
    minimised is 2 sum of w s^2 rho(r / s) with s the edge's scale, 1 where the weights are even;
    rho(r) is r^2 near zero.

    Attributes:
        loss: the loss that was used ("auto" has chosen one).
        scale: its scale, radians.
        noise: estimated standard deviation of the noise angle of one edge, radians: of one with
            the median weight, where the weights are precisions. Edges that no cycle checks do not
            count, and edges that lie on the same cycles count as one. Never below 1e-4.
        threshold: edges with larger residuals are outliers: 3 times the noise, up to 10 times
            where it has heavy tails, and no less than a scale that was given, within which half
            the weight is left; of "tls" the scale; of "l2" (with a cycle check) pi, as it takes no
            other edge for an outlier.
        edge_scales: (m,) factors by which scale, noise and threshold of an edge differ from these;
            infinite for trusted edges.
        is_favoured: (m,) odometry of which giving up one edge costs as much as six others
            (docs/robust.md, Trajectories): its scale, though not its noise and threshold, is
            larger by the root of six.
        objective: the robust objective, without edges that were left out; with priors, that of the
            measurements before these are met, and with `anisotropic`, before that.
        edge_weights: (m,) the graph's weights times rho'(r) / (2 r), at least 1e-9 of them over
            the edge's precision, so that no node is lost (docs/robust.md); of edges that were left
            out, 1e-12 of the lightest that was not, or of their own.
        edge_verdicts: (m,) see `Solution.edge_verdicts`.
        part: (n,) label of the part of the graph that each node is in; parts are held together by
            edges that are no outliers, and by fixed nodes and absolute priors. Where a component
            has several, their rotations relative to each other rest on distrusted edges alone.
        absolute_priors: what became of absolute priors; None without, or if they were not judged.
        gravity_priors: the same of gravity.
        alternatives: other answers that the evidence does not rule out (loss "auto" alone looks for
            them, and not where an initial value is given).
        num_strained: edges that were kept and within the threshold, theirs and that of the priors,
            and that lie beyond twice as much once the priors are met: a prior is wrong, or one of
            these edges.
        noise_shows: False where the noise would be half a radian or more: too few edges agree to
            tell it from errors.
    """

    loss: str
    scale: float
    noise: float
    threshold: float
    objective: float
    edge_weights: NDArray[np.float64]
    edge_scales: NDArray[np.float64]
    is_favoured: NDArray[np.bool_]
    edge_verdicts: NDArray[np.str_]
    part: NDArray[np.int32]
    absolute_priors: PriorFit | None = None
    gravity_priors: PriorFit | None = None
    alternatives: tuple[Alternative, ...] = ()
    num_strained: int = 0
    noise_shows: bool = True

    @property
    def num_parts(self) -> int:
        """Number of parts."""
        return int(self.part.max()) + 1


def robust_from_core(core: dict[str, Any], graph: MeasurementGraph) -> RobustFit:
    """From what the core returns."""
    arrays: dict[str, Any] = {
        "edge_weights": read_only(core["edge_weights"]),
        "edge_scales": read_only(core["edge_scales"]),
        "is_favoured": read_only(core["is_favoured"]),
        "edge_verdicts": read_only(np.array(core["edge_verdicts"], dtype=np.str_)),
        "part": read_only(core["part"]),
        "alternatives": tuple(alternative_from_core(a, graph) for a in core["alternatives"]),
    }
    for kind in ("absolute_priors", "gravity_priors"):
        if core[kind] is not None:
            none = np.empty(0)
            arrays[kind] = PriorFit(nodes=none, given_weights=none, **core[kind])
    return RobustFit(**{**core, **arrays})


def with_named_priors(
    fit: RobustFit,
    graph: MeasurementGraph,
    priors: Priors,
    used: NDArray[np.float64] | None = None,
) -> RobustFit:
    """The same, with nodes and given weights of the priors.

    It may have been found with other weights of absolute priors, `used` (k,).
    """
    named = {}
    for kind, of_nodes in (("absolute", priors.absolute), ("gravity", priors.gravity)):
        of_kind = getattr(fit, f"{kind}_priors")
        if of_kind is not None:
            keys = [key.item() if isinstance(key, np.generic) else key for key in of_nodes]
            rows = rows_of(as_ids(keys, kind), graph.nodes)
            order = np.argsort(rows, kind="stable")
            weights = np.array([float(weight) for _, weight in of_nodes.values()])
            if kind == "absolute" and used is not None:
                left = of_kind.weights * (weights[order] / used)
                of_kind = replace(of_kind, weights=read_only(left))
            named[f"{kind}_priors"] = replace(
                of_kind,
                nodes=read_only(graph.nodes[rows[order]]),
                given_weights=read_only(weights[order]),
            )
    return replace(fit, **named)
