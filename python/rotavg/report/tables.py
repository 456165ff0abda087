"""The tables of the page: the worst edges, the components, who adds what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import rows_by_label
from rotavg.report.verdict import is_reweighted
from rotavg.solving.costs import edge_costs, prior_costs
from rotavg.solving.diagnosis import Diagnosis, Share
from rotavg.solving.solution import Solution
from rotavg.solving.uncertainty import beyond_half_a_turn, rms_degrees

Cell = Union[str, float]


@dataclass(frozen=True)
class Table:
    """A table that can be sorted by every column.

    Attributes:
        caption: what is in it, and what was left out.
        columns: their headings.
        rows: cells; a number is sorted as one and shown with four digits.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]


def worst_edges(solution: Solution, limit: int = 200) -> Table:
    """The edges with the largest residuals; of rare verdicts the worst as well."""
    graph = solution.graph
    degrees = np.degrees(solution.residual_angles)
    by_residual = np.argsort(-degrees, kind="stable")
    worst, further = by_residual[:limit], []
    if solution.robust is not None:
        verdicts = solution.edge_verdicts[by_residual[limit:]]
        for verdict in ("cycle_check", "weak_part", "bridge"):
            found = by_residual[limit:][verdicts == verdict][: limit // 2]
            worst = np.concatenate([worst, found])
            further += [f"{len(found)} of {verdict}"] * (len(found) > 0)
    columns = ["from", "to", "residual [deg]", "weight"]
    figures = [degrees, graph.weights]
    if solution.robust is not None or is_reweighted(solution):
        columns += ["final weight", "verdict"]
        figures += [solution.edge_weights, solution.edge_verdicts]
    if solution.num_components > 1:
        columns.append("component")
        figures.append(solution.component[graph.indices[:, 0]] + 1)
    rows = [
        [*map(str, graph.edges[k].tolist()), *(figure[k].item() for figure in figures), int(k)]
        for k in worst
    ]
    m = graph.num_edges
    shown = f"All {m} edges" if m <= limit else f"The {limit} worst of {m} edges"
    if further:
        shown += f", and further {', '.join(further)}"
    caption = f"{shown}; the row counts the edges of the input from 0."
    return Table(caption, [*columns, "row"], rows)


def uncertainty(solution: Solution, covariances: NDArray[np.float64], limit: int = 100) -> Table:
    """The rotations that are known least well, given their covariances (n, 3, 3), radians^2."""
    rms = rms_degrees(covariances)
    axes = np.degrees(np.sqrt(np.linalg.eigvalsh(covariances).clip(min=0)))
    least = np.argsort(-rms, kind="stable")[:limit]
    n = len(rms)
    shown = f"All {n} nodes" if n <= limit else f"The {limit} least certain of {n} nodes"
    caption = f"{shown}: RMS angle, and along the best and the worst axis, relative to the gauge."
    if rms.max() > 180.0:
        caption += f" ({beyond_half_a_turn(rms)}.)"
    rows = [
        [str(solution.graph.nodes[k].item()), rms[k].item(), axes[k, 0].item(), axes[k, 2].item()]
        for k in least
    ]
    return Table(caption, ["node", "RMS [deg]", "best axis [deg]", "worst axis [deg]"], rows)


def shares(diagnosis: Diagnosis, kind: str, limit: int = 100) -> Table | None:
    """The nodes, frames or sensors that add most to the objective; None where there are none."""
    of_kind: dict[Any, Share] = getattr(diagnosis, f"{kind}s")
    if not of_kind:
        return None
    costly = sorted(of_kind.items(), key=lambda item: -item[1].cost)[:limit]
    rows: list[list[Cell]] = [
        [
            str(name), share.edges, share.outliers, 100 * share.share,
            float(np.degrees(share.median_residual)), float(np.degrees(share.largest_residual)),
        ]
        for name, share in costly
    ]  # fmt: skip
    n = len(of_kind)
    shown = f"All {n} {kind}s" if n <= limit else f"The {limit} costliest of {n} {kind}s"
    return Table(
        f"{shown}: edges with an end there, outliers among them, and the share of the objective.",
        [
            kind, "edges", "outliers", "share [%]", "median residual [deg]",
            "largest residual [deg]",
        ],
        rows,
    )  # fmt: skip


def components(solution: Solution, limit: int = 100) -> Table:
    """The largest connected components, each with a gauge of its own."""
    graph, label = solution.graph, solution.component
    count = solution.num_components
    of_edge = label[graph.indices[:, 0]]
    nodes, edges = np.bincount(label, minlength=count), np.bincount(of_edge, minlength=count)
    objective = np.bincount(of_edge, edge_costs(solution), count)
    gauge = "In each, the first node has the identity."
    if solution.grounded is not None:
        objective += np.bincount(label, prior_costs(solution), count)
        gauge = "Component 1 is in the world of the priors. " + gauge.replace("each", "each other")
    degrees = np.degrees(solution.residual_angles)
    kept = ~solution.is_outlier if solution.robust is not None else np.ones(len(degrees), bool)
    first = np.unique(label, return_index=True)[1]
    edges_of = rows_by_label(of_edge, count)
    rows = []
    for k in np.argsort(-nodes, kind="stable")[:limit].tolist():
        own = degrees[edges_of[k][kept[edges_of[k]]]]
        residuals: list[Cell] = ["", ""]
        if len(own) > 0:
            residuals = [float(np.median(own)), float(own.max())]
        row: list[Cell] = [k + 1, int(nodes[k]), int(edges[k]), objective[k].item(), *residuals]
        rows.append([*row, str(graph.nodes[first[k]].item())])
    shown = f"All {count}" if count <= limit else f"The {limit} largest of {count}"
    return Table(
        f"{shown} components. {gauge}"
        + ("" if kept.all() else " Residuals are those of the edges that were kept."),
        [
            "component", "nodes", "edges", "objective", "median residual [deg]",
            "largest residual [deg]", "first node",
        ],
        rows,
    )  # fmt: skip
