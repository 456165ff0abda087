"""What every node, and every frame and sensor of rigs, adds to the objective; what contradicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import read_only
from rotavg.base.errors import expect
from rotavg.solving.costs import edge_costs, prior_costs
from rotavg.solving.solution import Solution


@dataclass(frozen=True)
class Share:
    """What some nodes have to do with the objective.

    Attributes:
        edges: how many edges have an end here.
        outliers: how many of these the solution takes for outliers.
        cost: what they add to the objective: half of every edge at each of its ends, and priors.
        share: of the objective, 0 to 1.
        median_residual: of the edges, radians; 0 where there are none.
        largest_residual: likewise.
    """

    edges: int
    outliers: int
    cost: float
    share: float
    median_residual: float
    largest_residual: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Who adds what to the objective of a solution."""

    solution: Solution

    @cached_property
    def edge_costs(self) -> NDArray[np.float64]:
        """(m,) w |R_i R_ij - R_j|_F^2 with the final weights, or 4 v^T C^-1 v."""
        return read_only(edge_costs(self.solution))

    @cached_property
    def node_costs(self) -> NDArray[np.float64]:
        """(n,) half of the costs of the edges at every node, and all of its priors'."""
        s = self.solution
        costs = np.zeros(s.graph.num_nodes)
        np.add.at(costs, s.graph.indices, 0.5 * self.edge_costs[:, None])
        return read_only(costs + prior_costs(s))

    @cached_property
    def nodes(self) -> dict[Any, Share]:
        """Of every node."""
        return self._of(self.solution.graph.nodes.tolist())

    @cached_property
    def frames(self) -> dict[Any, Share]:
        """Of every frame of a rig; empty where there are none."""
        return self._of_rigs(0)

    @cached_property
    def sensors(self) -> dict[Any, Share]:
        """Of every sensor of a rig, where rigs were given by their sensors (`Rigs`)."""
        return self._of_rigs(1)

    def contradictions(self, most: int | None = None) -> list[int]:
        """Edges that are outliers, the largest residual first, `most` at most; rows of the graph's.

        Without a robust loss, which alone tells outliers, those beyond three times the median.
        """
        s = self.solution
        if s.robust is None:
            wrong = s.residual_angles > 3 * np.median(s.residual_angles)
        else:
            wrong = s.is_outlier
        rows = np.flatnonzero(wrong)
        order = np.argsort(-s.residual_angles[rows], kind="stable")
        return [int(k) for k in rows[order][:most]]

    def _of_rigs(self, which: int) -> dict[Any, Share]:
        s = self.solution
        if s.rigs is None:
            rigs = {} if s.grounded is None else s.grounded.priors.rigs
            if which == 1 or not isinstance(rigs, dict):
                return {}
            pictures = {node: (frame, None) for node, (frame, _) in rigs.items()}
        else:
            pictures = dict(s.rigs.images)
        labels = [pictures[k][which] if k in pictures else None for k in s.graph.nodes.tolist()]
        return {label: share for label, share in self._of(labels).items() if label is not None}

    def _of(self, labels: Sequence[Any]) -> dict[Any, Share]:
        s = self.solution
        names = list(dict.fromkeys(labels))
        row = {name: k for k, name in enumerate(names)}
        of_node = np.array([row[label] for label in labels])
        costs = np.bincount(of_node, self.node_costs, minlength=len(names))
        ends = of_node[s.graph.indices]
        once = ends[:, 0] != ends[:, 1]  # an edge inside counts once
        label = np.concatenate([ends[:, 0], ends[once, 1]])
        edge = np.concatenate([np.arange(len(ends)), np.flatnonzero(once)])
        order = np.argsort(label, kind="stable")
        label, edge = label[order], edge[order]
        first = np.searchsorted(label, np.arange(len(names) + 1))
        total = float(costs.sum())
        found = {}
        for name, k in row.items():
            here = edge[first[k] : first[k + 1]]
            angles = s.residual_angles[here]
            found[name] = Share(
                edges=len(here),
                outliers=int(s.is_outlier[here].sum()),
                cost=float(costs[k]),
                share=float(costs[k] / total) if total > 0 else 0.0,
                median_residual=float(np.median(angles)) if len(here) else 0.0,
                largest_residual=float(angles.max()) if len(here) else 0.0,
            )
        return found


def diagnose(solution: Solution) -> Diagnosis:
    """Tell what every node, frame and sensor adds to the objective, and which edges contradict."""
    expect(solution, Solution)
    return Diagnosis(solution)
