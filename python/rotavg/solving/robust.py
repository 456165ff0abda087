"""What a robust loss makes of the edges, and signs that one is needed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.base.errors import GraphError, OptionError
from rotavg.graph.measurement_graph import MeasurementGraph

Loss = Literal["l2", "auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls"]


@dataclass(frozen=True, eq=False)
class RobustFit:
    """What a robust loss has found out.

    The residual r of an edge is the chord 2 sin(angle / 2) of its residual angle. What is
    minimised is 2 sum of w rho(r); rho is r^2 near zero.

    Attributes:
        loss: the loss that was used ("auto" has chosen one).
        scale: its scale, radians.
        noise: estimated standard deviation of the noise angle of one edge, radians.
        threshold: edges with larger residuals are outliers: 3 times the noise; of "tls" the scale;
            of "l2" (with a cycle check) pi, as it takes no other edge for an outlier.
        objective: the robust objective.
        edge_weights: (m,) the graph's weights times rho'(r) / (2 r), at least 1e-6 of them, so that
            the graph stays connected (of edges that the cycle check leaves out 1e-12).
        edge_verdicts: (m,) see `Solution.edge_verdicts`.
        part: (n,) label of the part of the graph that each node is in; parts are held together by
            edges that are no outliers. Where a component has several, their rotations relative to
            each other rest on distrusted edges alone.
    """

    loss: str
    scale: float
    noise: float
    threshold: float
    objective: float
    edge_weights: NDArray[np.float64]
    edge_verdicts: NDArray[np.str_]
    part: NDArray[np.int32]

    @classmethod
    def from_core(cls, core: dict[str, Any]) -> RobustFit:
        """From what the core returns."""
        arrays = {
            "edge_weights": read_only(core["edge_weights"]),
            "edge_verdicts": read_only(np.array(core["edge_verdicts"], dtype=np.str_)),
            "part": read_only(core["part"]),
        }
        return cls(**{**core, **arrays})

    @property
    def num_parts(self) -> int:
        """Number of parts."""
        return int(self.part.max()) + 1

    def rows(self, num_components: int) -> list[tuple[str, str]]:
        """Names and sentences for a printed report."""
        counts = Counter(self.edge_verdicts.tolist())
        reasons = [
            (counts["robust_weight"] + counts["weak_part"], "by their residuals"),
            (counts["cycle_check"], "by the cycle check"),
        ]
        total = sum(count for count, _ in reasons)
        how = ", ".join(f"{count} {reason}" for count, reason in reasons)
        rows = [
            (
                "loss",
                f"{self.loss}, scale {np.degrees(self.scale):.3g} deg, noise about "
                f"{np.degrees(self.noise):.3g} deg, robust objective {self.objective:.9g}",
            ),
            (
                "outliers",
                f"{total} of {len(self.edge_verdicts)} edges, beyond "
                f"{np.degrees(self.threshold):.3g} deg"
                + (f": {how}" if counts["cycle_check"] else ""),
            ),
        ]
        if counts["bridge"]:
            some = "1 edge" if counts["bridge"] == 1 else f"{counts['bridge']} edges"
            rows.append(("bridges", f"{some} that no cycle checks"))
        weak = self.num_parts - num_components
        if weak > 0:
            rows.append(
                (
                    "weak parts",
                    f"{weak} beside the main {'one' if num_components == 1 else 'ones'}: held by "
                    f"outliers alone ({counts['weak_part']} edges)",
                )
            )
        return rows


@dataclass(frozen=True, eq=False)
class CycleEvidence:
    """What the short cycles (of three edges, or of two parallel ones) say of every edge.

    Attributes:
        checked: (m,) cycles that were looked at: all, or some evenly spread ones.
        agreeing: (m,) of these, cycles that miss the identity by no more than the threshold.
        bridge: (m,) whether no cycle of any length passes through the edge.
    """

    checked: NDArray[np.int32]
    agreeing: NDArray[np.int32]
    bridge: NDArray[np.bool_]

    @property
    def share(self) -> NDArray[np.float64]:
        """(m,) (agreeing + 1) / (checked + 2): a factor for the weights; a half without cycles."""
        return np.asarray((self.agreeing + 1) / (self.checked + 2), dtype=np.float64)

    @property
    def refuted(self) -> NDArray[np.bool_]:
        """(m,) whether three or more cycles were looked at and none agrees."""
        return np.asarray((self.checked >= 3) & (self.agreeing == 0))


def cycle_evidence(graph: MeasurementGraph, threshold: float) -> CycleEvidence:
    """Check every edge by the short cycles through it (Zach, Klopschitz and Pollefeys 2010).

    Use `graph.with_weights(graph.weights * evidence.share)` to weight by it, or
    `solve(graph, cycle_threshold=...)` to leave out what it refutes.

    Args:
        graph: the measurements.
        threshold: angle in radians by which the rotations around a cycle may miss the identity.

    Raises:
        OptionError: for a threshold that is no angle.
    """
    if not isinstance(graph, MeasurementGraph):
        raise GraphError(f"found a {type(graph).__name__}, expected a MeasurementGraph")
    if not (isinstance(threshold, (int, float, np.number)) and 0 <= threshold <= np.pi):
        raise OptionError(f"threshold is {threshold!r}; expected an angle in radians, 0 to pi")
    checked, agreeing = _core.cycle_evidence(graph._core, float(threshold))
    return CycleEvidence(read_only(checked), read_only(agreeing), bridges(graph))


def bridges(graph: MeasurementGraph) -> NDArray[np.bool_]:
    """(m,) whether the graph falls apart without the edge: then no cycle checks what it says."""
    return read_only(_core.bridges(graph._core))


def contamination(
    angles: NDArray[np.float64], weights: NDArray[np.float64] | None = None
) -> str | None:
    """Advice to use a robust loss, if these residual angles (m,) in radians look contaminated.

    That is where more than 2 % of them lie beyond 3 standard deviations, estimated from the median
    as if they were half of a normal distribution (which has 0.3 % there, and rotation noise in all
    three directions none), or more than 1 % beyond 90 degrees. Angles are compared in units of
    their 1 / sqrt(weight).
    """
    if len(angles) < 20:
        return None
    scaled = angles if weights is None else angles * np.sqrt(weights / np.median(weights))
    noise = max(float(np.median(scaled)) / 0.6745, 1e-6)
    beyond, wild = float(np.mean(scaled > 3 * noise)), float(np.mean(angles > np.pi / 2))
    if beyond <= 0.02 and wild <= 0.01:
        return None
    found = (
        f"{100 * beyond:.2g} % lie beyond 3 times their noise of {np.degrees(noise):.2g} deg"
        if beyond > 0.02
        else f"{100 * wild:.2g} % lie beyond 90 deg"
    )
    return f'{found}: a robust loss (loss="auto", --loss auto) resists them'
