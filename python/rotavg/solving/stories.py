"""Other answers that explain a graph nearly as well as the one that was chosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import ReadOnly, read_only
from rotavg.graph.ids import IdArray
from rotavg.graph.measurement_graph import MeasurementGraph


class Bundle(NamedTuple):
    """The edges between two groups of cameras that decide between two answers.

    Attributes:
        groups: the labels of both, as in `Alternative.group`.
        edges: how many the answer explains and the alternative does not.
        weight: their given weights together.
        alternative_edges: how many the alternative explains and the answer does not.
        alternative_weight: their given weights together.
    """

    groups: tuple[int, int]
    edges: int
    weight: float
    alternative_edges: int
    alternative_weight: float


@dataclass(frozen=True, eq=False)
class Alternative(ReadOnly):
    """Another answer that the evidence does not rule out (docs/robust.md).

    Attributes:
        rotations: (n, 3, 3) world_from_node, in the gauge of the answer: the largest group that
            both share has the same rotations.
        group: (n,) labels of the groups that both answers turn alike; 0 is the largest.
        nodes: (k,) ids of the nodes in all other groups.
        bundles: the edges between groups that decide, the heaviest first, at most eight.
        voices: of the strongest edges (each camera has eight), how many only the answer explains,
            and how many only the alternative.
        lead_in_weight: by how many standard deviations the edges that only the answer explains are
            heavier, for how far they turn, than those that only the alternative explains; 0 where
            weights tell nothing.
        edges: the same of all edges.
        closure: of the pairs of cameras with a common neighbour across the edges that only the
            answer explains, the share that match; the same for the alternative. Where it is less,
            pairs that ought to match do not.
        missing: (p, 2) node ids of some of the pairs that ought to match if this were true and do
            not, at most sixteen.
    """

    rotations: NDArray[np.float64]
    group: NDArray[np.int32]
    nodes: IdArray
    bundles: tuple[Bundle, ...]
    voices: tuple[float, float]
    lead_in_weight: float
    edges: tuple[int, int]
    closure: tuple[float, float]
    missing: IdArray

    @property
    def sentence(self) -> str:
        """How the other answer differs, and what speaks for either, in one line."""
        few = ", ".join(str(node) for node in self.nodes[:3].tolist())
        more = ", ..." if len(self.nodes) > 3 else ""
        weights = ""
        if self.lead_in_weight:
            kind = "lighter" if self.lead_in_weight > 0.0 else "heavier"
            lead = abs(self.lead_in_weight)
            weights = f" ({kind} ones, by {lead:.1f} standard deviations)"
        return (
            f"if look-alike places were confused, {len(self.nodes)} of {len(self.group)} nodes "
            f"({few}{more}) have other rotations. Edges for it: {self.edges[1]}, which this answer "
            f"rejects{weights}; against it: {self.edges[0]}, which it would reject. Of every "
            f"node's strongest edges: {self.voices[1]:g} for it, {self.voices[0]:g} against. "
            "Of the pairs that should match if it were true, "
            f"{100 * self.closure[1]:.0f} % do; if this answer is, {100 * self.closure[0]:.0f} %"
        )

    def summary(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "nodes": self.nodes.tolist(),
            "groups": int(self.group.max()) + 1,
            "edges": {"answer": self.edges[0], "alternative": self.edges[1]},
            "voices": {"answer": self.voices[0], "alternative": self.voices[1]},
            "lead_in_weight": self.lead_in_weight,
            "closure": {"answer": self.closure[0], "alternative": self.closure[1]},
            "bundles": [bundle._asdict() for bundle in self.bundles],
            "missing": self.missing.tolist(),
            "rotations": self.rotations.tolist(),
            "sentence": self.sentence,
        }


def alternative_from_core(core: dict[str, Any], graph: MeasurementGraph) -> Alternative:
    """From what the core returns."""
    group = read_only(core["group"])
    missing = np.array(core["missing"], dtype=np.intp).reshape(-1, 2)
    return Alternative(
        read_only(core["rotations"]),
        group,
        read_only(graph.nodes[group > 0]),
        tuple(Bundle((a, b), *rest) for a, b, *rest in core["bundles"]),
        core["voices"],
        core["lead_in_weight"],
        core["edges"],
        core["closure"],
        read_only(graph.nodes[missing]),
    )
