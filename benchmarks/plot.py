"""Time against what is left to gain, a panel for each graph."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from benchmarks.compare import GraphResult
from benchmarks.summary import rows

_FLOOR, _CEILING = 1e-12, 10.0  # what is closer to the optimum is drawn at the floor
_COLOURS = {
    "rotavg": "tab:blue",
    "gtsam": "tab:orange",
    "pytheia": "tab:green",
    "pycolmap": "tab:olive",
    "numpy": "tab:red",
    "scipy": "tab:purple",
    "pymanopt": "tab:brown",
}
_MARKERS = "osDv^<>ph8"


def save_plot(path: Path, results: Sequence[GraphResult]) -> None:
    """Draw all graphs into one picture, each solver on the fewest threads that it ran on."""
    columns = min(len(results), 2)
    lines = math.ceil(len(results) / columns)
    figure, panels = plt.subplots(
        lines,
        columns,
        figsize=(6.5 * columns, 4.2 * lines + 1.2),
        layout="constrained",
        squeeze=False,
    )
    for axes in panels.flat[len(results) :]:
        axes.set_axis_off()
    names = list(dict.fromkeys(run.solver for result in results for run in result.runs))
    looks = _looks(names)
    for axes, result in zip(panels.flat, results):
        _panel(axes, result, looks)
    handles = [Line2D([], [], linestyle="", label=name, **looks[name]) for name in names]
    figure.legend(handles=handles, loc="outside lower center", ncols=3 * columns, fontsize=8)
    figure.suptitle("Filled: certified by rotavg. Hollow: not certified.", fontsize=10)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _looks(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """A colour for each family of solvers, a marker for each of its members."""
    seen: dict[str, int] = {}
    looks = {}
    for name in names:
        family = name.partition("-")[0]
        seen[family] = seen.get(family, -1) + 1
        looks[name] = {
            "color": _COLOURS.get(family, "black"),
            "marker": _MARKERS[seen[family] % len(_MARKERS)],
        }
    return looks


def _panel(axes: Axes, result: GraphResult, looks: dict[str, dict[str, Any]]) -> None:
    fewest = min(run.threads for run in result.runs)
    failed = []
    for row in rows(result):
        if row.threads != fewest:
            continue
        if math.isnan(row.cpu_s):
            failed.append(row.solver)
            continue
        certified = row.verdict in ("proved", "estimated")
        axes.plot(
            row.cpu_s,
            max(row.excess, _FLOOR),
            fillstyle="full" if certified else "none",
            markersize=7,
            alpha=0.8,
            **looks[row.solver],
        )
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="CPU time [s]" + (f", {fewest} threads" if fewest > 1 else ""),
        ylabel=f"(f - f*) / f*, at least {_FLOOR:g}",
        title=f"{result.name}: {result.nodes} nodes, {result.edges} edges",
    )
    axes.set_ylim(_FLOOR / 4, _CEILING)
    # Whole decades, so that there are labels enough, and all of them legible.
    axes.set_xlim(*(10.0 ** f(np.log10(x)) for f, x in zip((np.floor, np.ceil), axes.get_xlim())))
    axes.grid(alpha=0.3)
    if failed:
        text = textwrap.fill("no answer: " + ", ".join(failed), 75, break_on_hyphens=False)
        axes.text(0.02, 0.98, text, transform=axes.transAxes, fontsize=8, va="top")
