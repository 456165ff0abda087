"""What a robust loss makes of the edges, and signs that one is needed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import ReadOnly, read_only
from rotavg.base.errors import GraphError, OptionError
from rotavg.graph.ids import IdArray, as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.priors import Priors
from rotavg.solving import options
from rotavg.solving.stories import Alternative

# Above this share of cycles, what least squares leave of an edge's noise is nearly all of it; with
# more edges, finding how much would take too long.
_MUCH_CHECKED, _MANY_EDGES = 0.8, 20_000
_LEAST_REDUNDANCY = 1e-6  # below, rounding is seen

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
            count, and edges that lie on the same cycles count as one.
        threshold: edges with larger residuals are outliers: 3 times the noise; of "tls" the scale;
            of "l2" (with a cycle check) pi, as it takes no other edge for an outlier.
        edge_scales: (m,) factors by which scale, noise and threshold of an edge differ from these;
            infinite for trusted edges.
        objective: the robust objective; with priors, that of the measurements before these are met.
        edge_weights: (m,) the graph's weights times rho'(r) / (2 r), at least 1e-9 of them, so that
            the graph stays connected (of excluded edges, and those that the cycle check leaves out,
            1e-12).
        edge_verdicts: (m,) see `Solution.edge_verdicts`.
        part: (n,) label of the part of the graph that each node is in; parts are held together by
            edges that are no outliers, and by fixed nodes and absolute priors. Where a component
            has several, their rotations relative to each other rest on distrusted edges alone.
        absolute_priors: what became of absolute priors; None without, or if they were not judged.
        gravity_priors: the same of gravity.
        alternatives: other answers that the evidence does not rule out (loss "auto" alone looks for
            them, and not where an initial value is given).
    """

    loss: str
    scale: float
    noise: float
    threshold: float
    objective: float
    edge_weights: NDArray[np.float64]
    edge_scales: NDArray[np.float64]
    edge_verdicts: NDArray[np.str_]
    part: NDArray[np.int32]
    absolute_priors: PriorFit | None = None
    gravity_priors: PriorFit | None = None
    alternatives: tuple[Alternative, ...] = ()

    @classmethod
    def from_core(cls, core: dict[str, Any], graph: MeasurementGraph) -> RobustFit:
        """From what the core returns."""
        arrays: dict[str, Any] = {
            "edge_weights": read_only(core["edge_weights"]),
            "edge_scales": read_only(core["edge_scales"]),
            "edge_verdicts": read_only(np.array(core["edge_verdicts"], dtype=np.str_)),
            "part": read_only(core["part"]),
            "alternatives": tuple(Alternative.from_core(a, graph) for a in core["alternatives"]),
        }
        for kind in ("absolute_priors", "gravity_priors"):
            if core[kind] is not None:
                none = np.empty(0)
                arrays[kind] = PriorFit(nodes=none, given_weights=none, **core[kind])
        return cls(**{**core, **arrays})

    def with_priors(self, graph: MeasurementGraph, priors: Priors) -> RobustFit:
        """The same, with nodes and given weights of the priors."""
        named = {}
        for kind, of_nodes in (("absolute", priors.absolute), ("gravity", priors.gravity)):
            fit = getattr(self, f"{kind}_priors")
            if fit is not None:
                keys = [key.item() if isinstance(key, np.generic) else key for key in of_nodes]
                rows = rows_of(as_ids(keys, kind), graph.nodes)
                order = np.argsort(rows, kind="stable")
                weights = np.array([float(weight) for _, weight in of_nodes.values()])
                named[f"{kind}_priors"] = replace(
                    fit,
                    nodes=read_only(graph.nodes[rows[order]]),
                    given_weights=read_only(weights[order]),
                )
        return replace(self, **named)

    @property
    def num_parts(self) -> int:
        """Number of parts."""
        return int(self.part.max()) + 1

    def rows(self, num_components: int) -> list[tuple[str, str]]:
        """Names and sentences for a printed report.

        Args:
            num_components: how many parts there are if no edge is an outlier.
        """
        counts = Counter(self.edge_verdicts.tolist())
        reasons = [
            (counts["robust_weight"] + counts["weak_part"], "by their residuals"),
            (counts["cycle_check"], "by the cycle check"),
            (counts["excluded"], "excluded"),
        ]
        total = sum(count for count, _ in reasons)
        scales = self.edge_scales[np.isfinite(self.edge_scales)]
        of_what = " at the median weight" if len(scales) and np.ptp(scales) > 0 else ""
        how = ", ".join(f"{count} {reason}" for count, reason in reasons if count)
        rows = [
            (
                "loss",
                f"{self.loss}, scale {np.degrees(self.scale):.3g} deg, noise about "
                f"{np.degrees(self.noise):.3g} deg{of_what}, robust objective "
                f"{self.objective:.9g}",
            ),
            (
                "outliers",
                f"{total} of {len(self.edge_verdicts)} edges, beyond "
                f"{np.degrees(self.threshold):.3g} deg"
                + (f": {how}" if counts["cycle_check"] or counts["excluded"] else ""),
            ),
        ]
        for what, fit in (("absolute", self.absolute_priors), ("gravity", self.gravity_priors)):
            if fit is not None:
                rows.append(
                    (
                        what,
                        f"{int(fit.is_outlier.sum())} of {len(fit.nodes)} priors are outliers, "
                        f"beyond {np.degrees(fit.threshold):.3g} deg",
                    )
                )
        if counts["trusted"]:
            rows.append(("trusted", f"{counts['trusted']} edges that the loss does not touch"))
        if counts["bridge"]:
            some = "1 edge" if counts["bridge"] == 1 else f"{counts['bridge']} edges"
            rows.append(("bridges", f"{some} that no cycle checks"))
        weak = self.num_parts - num_components
        if weak > 0:
            edges = f" ({counts['weak_part']} edges)" if counts["weak_part"] else ""
            rows.append(
                (
                    "weak parts",
                    f"{weak} beside the main {'one' if num_components == 1 else 'ones'}: held by "
                    f"outliers alone{edges}",
                )
            )
        rows += [("alternative", alternative.sentence) for alternative in self.alternatives]
        return rows

    def proof_sentence(self, sentence: str, num_components: int, hanging: int = 0) -> str:
        """What a certificate proves of the answer, `sentence`, and what speaks against it.

        Args:
            sentence: what is proved.
            num_components: how many parts there are if no edge is an outlier.
            hanging: how many groups of nodes nothing checks against the rest.
        """
        rejected = int((~np.isin(self.edge_verdicts, ("inlier", "bridge", "trusted"))).sum())
        said = f"{sentence} of the least squares on the edges it kept"
        doubts = [f"{rejected} of {len(self.edge_verdicts)} edges rejected"]
        weak = self.num_parts - num_components
        if weak > 0:
            doubts.append(f"{weak} part{'s' * (weak > 1)} on rejected edges only")
        if hanging > 0:
            doubts.append(f"{hanging} group{'s' * (hanging > 1)} that nothing checks")
        if self.alternatives:
            some = len(self.alternatives)
            answers = "another answer is" if some == 1 else f"{some} other answers are"
            doubts.append(f"{answers} possible")
        return f"{said}; {', '.join(doubts)}"


@dataclass(frozen=True, eq=False)
class CycleEvidence(ReadOnly):
    """What the short cycles (of three edges, or of two parallel ones) say of every edge.

    Attributes:
        checked: (m,) cycles that were looked at: all, or some evenly spread ones.
        agreeing: (m,) of these, cycles that miss the identity by no more than the threshold.
        median_error: (m,) median of the angles, radians, by which they miss it; NaN without cycles.
        least_error: (m,) the least of these angles.
        bridge: (m,) whether no cycle of any length passes through the edge.
        min_cycles: how many cycles are enough to refute an edge.
    """

    checked: NDArray[np.int32]
    agreeing: NDArray[np.int32]
    median_error: NDArray[np.float64]
    least_error: NDArray[np.float64]
    bridge: NDArray[np.bool_]
    min_cycles: int = 3

    @property
    def share(self) -> NDArray[np.float64]:
        """(m,) (agreeing + 1) / (checked + 2): a factor for the weights; a half without cycles."""
        return np.asarray((self.agreeing + 1) / (self.checked + 2), dtype=np.float64)

    @property
    def refuted(self) -> NDArray[np.bool_]:
        """(m,) whether `min_cycles` cycles or more were looked at and none agrees."""
        return np.asarray((self.checked >= self.min_cycles) & (self.agreeing == 0))


def cycle_evidence(
    graph: MeasurementGraph, threshold: float, *, min_cycles: int = 3
) -> CycleEvidence:
    """Check every edge by the short cycles through it (Zach, Klopschitz and Pollefeys 2010).

    Use `graph.with_weights(graph.weights * evidence.share)` to weight by it, or
    `solve(graph, cycle_threshold=...)` to leave out what it refutes.

    Args:
        graph: the measurements.
        threshold: angle in radians by which the rotations around a cycle may miss the identity.
        min_cycles: how many cycles are enough to refute an edge.

    Raises:
        OptionError: for a threshold that is no angle, or less than one cycle.
    """
    if not isinstance(graph, MeasurementGraph):
        raise GraphError(f"found a {type(graph).__name__}, expected a MeasurementGraph")
    if not (isinstance(threshold, (int, float, np.number)) and 0 <= threshold <= np.pi):
        raise OptionError(f"threshold is {threshold!r}; expected an angle in radians, 0 to pi")
    least = options.whole("min_cycles", min_cycles, 1, 2**31 - 1)
    checked, agreeing, median, smallest = _core.cycle_evidence(graph._core, float(threshold))
    return CycleEvidence(
        checked=read_only(checked),
        agreeing=read_only(agreeing),
        median_error=read_only(median),
        least_error=read_only(smallest),
        bridge=bridges(graph),
        min_cycles=least,
    )


def bridges(graph: MeasurementGraph) -> NDArray[np.bool_]:
    """(m,) whether the graph falls apart without the edge: then no cycle checks what it says."""
    return read_only(_core.bridges(graph._core))


def contamination_of(
    graph: MeasurementGraph, rotations: NDArray[np.float64], angles: NDArray[np.float64]
) -> str | None:
    """The same for the residual angles (m,) that least squares leave, as cycles check them.

    Bridges say nothing. Edges in series, which lie on the same cycles, say together one thing: the
    sum of their angles, of the variance of all of them. And of a graph that has few cycles every
    series is judged in units of what least squares leave of its noise: heavy edges are met nearly
    exactly where light ones can bend.
    """
    label, cycles = _core.series(graph._core)
    checked = label >= 0
    if not checked.any():
        return None
    variances = np.median(graph.weights) / graph.weights
    total = np.bincount(label[checked], angles[checked])
    variance = np.bincount(label[checked], variances[checked])
    if cycles < _MUCH_CHECKED * len(total) and graph.num_edges <= _MANY_EDGES:
        left = _core.covariances(
            graph._core, rotations, graph.indices, noise_variance=1.0, information=None,
            num_threads=1,
        )  # fmt: skip
        if left is not None:
            fitted = graph.weights * np.trace(left, axis1=1, axis2=2) / 3
            redundancy = np.bincount(label[checked], 1 - fitted[checked])
            variance *= np.clip(redundancy, _LEAST_REDUNDANCY, 1)
    return _advice(total / np.sqrt(variance), float(np.mean(angles[checked] > np.pi / 2)))


def contamination(
    angles: NDArray[np.float64], weights: NDArray[np.float64] | None = None
) -> str | None:
    """Advice to use a robust loss, if these residual angles (m,) in radians look contaminated.

    That is where more than 2 % of them lie beyond 3 standard deviations, estimated from the median
    as if they were half of a normal distribution (which has 0.3 % there, and rotation noise in all
    three directions none), or more than 1 % beyond 90 degrees. Angles are compared in units of
    their 1 / sqrt(weight).
    """
    if len(angles) == 0:
        return None
    scaled = angles if weights is None else angles * np.sqrt(weights / np.median(weights))
    return _advice(scaled, float(np.mean(angles > np.pi / 2)))


def _advice(scaled: NDArray[np.float64], wild: float) -> str | None:
    """The advice for angles in units of their noise, a share `wild` of which is beyond 90 deg."""
    if len(scaled) < 20:
        return None
    noise = max(float(np.median(scaled)) / 0.6745, 1e-6)
    beyond = float(np.mean(scaled > 3 * noise))
    if beyond <= 0.02 and wild <= 0.01 and 3 * noise <= np.pi:
        return None
    if 3 * noise > np.pi:  # no angle of noise; the median is
        found = f"half of them lie beyond {np.degrees(min(np.median(scaled), np.pi)):.2g} deg"
    elif beyond > 0.02:
        degrees = np.degrees(noise)
        found = f"{100 * beyond:.2g} % lie beyond 3 times their noise of {degrees:.2g} deg"
    else:
        found = f"{100 * wild:.2g} % lie beyond 90 deg"
    return f'{found}: a robust loss (loss="auto", --loss auto) resists them'
