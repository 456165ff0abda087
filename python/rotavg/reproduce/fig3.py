"""Fig. 3: how BCDSR converges, and where it comes to plateaus."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rotavg.reproduce import drawing
from rotavg.reproduce.experiment import Experiment, Outcome, Settings, markdown_table
from rotavg.reproduce.measure import BCD, BCDSR
from rotavg.simulation.simulate import simulate
from rotavg.solving.solve import solve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Kind of graph, noise in radians, iterations shown: as in Table 1, and two that are harder.
GRAPHS = (("complete", 0.5, 12), ("sphere", 0.2, 150), ("cycle", 0.2, 1000))
POINTS = 21  # at which f is evaluated
FLOOR = 1e-12
TITLES = {"complete": "complete graph", "sphere": "spiral around a sphere", "cycle": "cycle"}


@dataclass(frozen=True)
class Course:
    """Objectives over f* after 0, 1, … iterations on one graph, from random rotations.

    Attributes:
        kind: of graph, as `rotavg.simulate` knows it.
        n: nodes.
        noise: radians.
        relaxed: BCDSR's own objective (6).
        rounded: iterations, and f at the rotations that BCDSR would return after them.
        bcd: f of BCD, from the same rotations.
    """

    kind: str
    n: int
    noise: float
    relaxed: list[float]
    rounded: list[tuple[int, float]]
    bcd: list[float]

    @property
    def slowest(self) -> float:
        """The smallest part of what was left to gain that ten iterations have gained."""
        excess = np.array(self.relaxed) - 1
        excess = excess[excess > 1e-6]  # before rounding counts
        if len(excess) < 11:
            return 1.0
        return float(np.min(1 - excess[10:] / excess[:-10]))


def run(settings: Settings) -> Outcome:
    """Run BCDSR on the paper's kind of graph and on two badly connected ones."""
    n = settings.size(50)
    courses = [_course(*graph, n, settings) for graph in GRAPHS]
    return Outcome(
        _markdown(courses),
        {"graphs": [asdict(c) for c in courses]},
        drawing.pictures(lambda figure: _draw(figure, courses), height=2.8),
    )


EXPERIMENT = Experiment("fig3", "Fig. 3: convergence of BCDSR", run, draws=True)


def _course(kind: str, noise: float, iterations: int, n: int, settings: Settings) -> Course:
    graph = simulate(kind, n, noise=noise, seed=settings.seed).graph
    optimum = solve(graph, num_threads=1).objective
    options: dict[str, Any] = {"certify": False, "num_threads": 1, "tolerance": 0.0}
    start = solve(graph, init="random", seed=settings.seed, max_iterations=0, **options).rotations
    rounded = []
    for k in np.unique(np.linspace(0, iterations, POINTS).round().astype(int)).tolist():
        settings.progress(f"{TITLES[kind]}: {k} of {iterations} iterations")
        # Anew each time, as the trace holds (6), not f.
        last = solve(graph, init=start, max_iterations=k, **BCDSR.options, **options)
        rounded.append((k, last.objective / optimum))
    bcd = solve(graph, init=start, max_iterations=iterations, **BCD.options, **options)
    return Course(
        kind, n, noise,
        (last.trace.objective / optimum).tolist(), rounded,
        (bcd.trace.objective / optimum).tolist(),
    )  # fmt: skip


def _markdown(courses: list[Course]) -> str:
    rows = [
        [
            TITLES[c.kind],
            f"{c.n}",
            f"{c.noise:g}",
            f"{100 * c.slowest:.0f} %",
            f"{c.relaxed[-1] - 1:.1e}",
            f"{c.rounded[-1][1] - 1:.1e}",
            f"{len(c.relaxed) - 1}",
        ]
        for c in courses
    ]
    return (
        'BCDSR from Y = (I + RᵀR)/2 with random rotations R; BCD from the same R. "Gain": the '
        "smallest part of what was left of the objective (6) that ten iterations gained.\n\n"
        + markdown_table(
            ["graph", "n", "φ [rad]", "gain", "(6)/f* − 1 at the end", "f/f* − 1", "iterations"],
            rows,
        )
    )


def _draw(figure: Figure, courses: list[Course]) -> None:
    panels = figure.subplots(1, len(courses), sharey=True)
    for axes, course in zip(panels, courses):
        _panel(axes, course)
    top = 2 * max(max(c.relaxed + c.bcd) for c in courses)
    panels[0].set_ylim(FLOOR / 2, top)
    panels[0].set_ylabel("relative distance from $f^*$")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def _panel(axes: Axes, course: Course) -> None:
    every = range(len(course.relaxed))
    some, rounded = zip(*course.rounded)
    for x, y, look, name, label in (
        (every, course.relaxed, "-", "BCDSR", "BCDSR: objective (6)"),
        (some, rounded, "--.", "BCDSR", "BCDSR: $f$ of its rotations"),
        (range(len(course.bcd)), course.bcd, "-", "BCD", "BCD: $f$"),
    ):
        excess = np.maximum(np.array(y) - 1, FLOOR)
        axes.semilogy(x, excess, look, markersize=3, color=drawing.COLOURS[name], label=label)
    axes.set(
        xlabel="iteration (sweep)",
        title=f"{TITLES[course.kind]}\n$n = {course.n}$, $\\varphi = {course.noise:g}$ rad",
    )
    axes.set_xlim(0, len(course.relaxed) - 1)
    axes.locator_params(axis="x", integer=True, nbins=5)
