"""What a robust loss made of the edges: the section that only solutions with one have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.report.charts import log_axis
from rotavg.report.style import THIRD, VERDICTS
from rotavg.report.tables import Cell, Table
from rotavg.solving.robust import RobustFit
from rotavg.solving.solution import Solution

MEANINGS = {
    "inlier": "agrees with the others",
    "bridge": "no cycle passes through it: nothing checks it",
    "trusted": "taken as it is, as asked",
    "robust_weight": "outlier: its residual is beyond the threshold",
    "cycle_check": "outlier: no short cycle through it closes; it was left out",
    "weak_part": "outlier, and no inlier joins the two parts of the graph that it joins",
    "excluded": "left out, as asked",
}
_POINTS = 1000  # of each verdict


@dataclass(frozen=True)
class RobustSection:
    """The parts of the section.

    Attributes:
        figures: names and values.
        verdicts: how many edges have which.
        alternatives: the edges that decide between this answer and others; None without.
        said: sentences.
    """

    figures: list[tuple[str, str]]
    verdicts: Table
    alternatives: Table | None
    said: tuple[str, ...]


def robust_section(solution: Solution) -> RobustSection | None:
    """The section; None where no robust loss was used."""
    fit = solution.robust
    if fit is None:
        return None
    degrees = np.degrees([fit.scale, fit.noise, fit.threshold])
    return RobustSection(
        [
            ("loss", fit.loss),
            ("scale", f"{degrees[0]:.3g}°"),
            ("noise, estimated" if fit.noise_shows else "noise, at least", f"{degrees[1]:.3g}°"),
            ("outliers are beyond", f"{degrees[2]:.3g}°"),
            ("robust objective", f"{fit.objective:.9g}"),
            ("weighted objective", f"{solution.objective:.9g}"),
        ],
        _verdicts(fit),
        _alternatives(solution),
        _said(solution, fit),
    )


def weights(solution: Solution) -> Any:
    """What is left of every edge's weight, against its residual."""
    go = require("plotly.graph_objects", "report")
    fit = solution.robust
    assert fit is not None
    degrees = np.degrees(solution.residual_angles)
    left = solution.edge_weights / solution.graph.weights
    noise = max(float(np.degrees(fit.noise)), 1e-6)
    figure = go.Figure()
    for verdict, style in VERDICTS.items():
        rows = np.flatnonzero(fit.edge_verdicts == verdict)
        if len(rows) == 0:
            continue
        kept = _thinned(rows, degrees)
        count = f"{len(rows)}" if len(kept) == len(rows) else f"{len(kept)} of {len(rows)}"
        figure.add_scatter(
            # On a logarithmic axis, what fits exactly stands at its left end.
            x=np.maximum(degrees[kept], noise / 100),
            y=left[kept],
            customdata=np.column_stack([kept, degrees[kept]]),
            name=f"{verdict} ({count})",
            mode="markers",
            marker={**style, "opacity": 0.7},
            hovertemplate="row %{customdata[0]}: %{customdata[1]:.3g} deg, %{y:.3g} left"
            f"<extra>{verdict}</extra>",
        )
    figure.add_vline(np.degrees(fit.threshold), line={"color": THIRD, "width": 1.5, "dash": "dot"})
    figure.update_layout(
        xaxis={"type": "log", "dtick": 1, "title": "residual angle [deg]"},
        yaxis={
            **log_axis(left), "title": "final weight / given weight",
            "range": [np.log10(left.min()) - 0.4, 0.4],
        },
        legend={"orientation": "h", "x": 0, "y": -0.25, "yanchor": "top"},
    )  # fmt: skip
    return figure


def _verdicts(fit: RobustFit) -> Table:
    m = len(fit.edge_verdicts)
    rows: list[list[Cell]] = []
    for verdict, meaning in MEANINGS.items():
        count = int((fit.edge_verdicts == verdict).sum())
        if count > 0:
            rows.append([verdict, count, round(100 * count / m, 1), meaning])
    return Table(f"Verdicts on the {m} edges.", ["verdict", "edges", "%", "meaning"], rows)


def _said(solution: Solution, fit: RobustFit) -> tuple[str, ...]:
    said = [
        "The certificate is that of the final weighted problem: it says how near these rotations "
        "are to the least sum of squares with these weights. It does not say that the weights are "
        "the right ones, nor that the robust objective is nowhere lower: that is proved of no "
        "robust loss.",
    ]
    weak = fit.num_parts - solution.num_parts_given
    if weak > 0:
        said.append(
            f"{weak} part{'s' * (weak > 1)} of the graph {'are' if weak > 1 else 'is'} held by "
            "outliers alone: how such a part is turned against the rest rests on distrusted edges. "
            "Treat it as a model of its own."
        )
    said += [f"Another answer is possible: {a.sentence}." for a in fit.alternatives]
    if fit.alternatives:
        said.append(
            "Where one thing looks like another, either answer may be the folded one, and no cost "
            "can tell: look at the photographs of the pairs below."
        )
    return tuple(said)


def _alternatives(solution: Solution) -> Table | None:
    fit = solution.robust
    if fit is None or not fit.alternatives:
        return None
    rows: list[list[Cell]] = []
    for number, story in enumerate(fit.alternatives, 1):
        pairs = ", ".join(f"{i}-{j}" for i, j in story.missing[:8].tolist())
        for bundle in story.bundles:
            sizes = " / ".join(str(int((story.group == group).sum())) for group in bundle.groups)
            rows.append(
                [
                    number, sizes, bundle.edges, bundle.weight, bundle.alternative_edges,
                    bundle.alternative_weight, pairs,
                ]
            )  # fmt: skip
    return Table(
        "The edges that decide between this answer and others.",
        ["answer", "nodes in the groups", "edges for", "weight", "edges against", "weight ",
         "ought to match and do not"],
        rows,
    )  # fmt: skip


def _thinned(rows: NDArray[np.int64], degrees: NDArray[np.float64]) -> NDArray[np.int64]:
    """Of these edges so many as are drawn, evenly among the residuals, the ends included."""
    if len(rows) <= _POINTS:
        return rows
    by_residual = rows[np.argsort(degrees[rows], kind="stable")]
    return by_residual[np.linspace(0, len(rows) - 1, _POINTS).round().astype(np.int64)]
