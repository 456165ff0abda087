"""Fig. 2: how BCD and SUM converge from the shortest paths and from random starts."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.reproduce import drawing
from rotavg.reproduce.experiment import Experiment, Outcome, Settings, markdown_table
from rotavg.reproduce.measure import ADAPTIVE_SUM, BCD, SUM, Algorithm, timed_solve
from rotavg.simulation.simulate import simulate
from rotavg.solving.solve import solve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOISE = 0.5  # radians
RANDOM_STARTS = 5
REPEATS = 9  # of every solve; the times are those of the quickest
FLOOR = 1e-12  # relative to f*; below is rounding


_LABELS = {"SUM": "SUM, µ = −λ$_{min}$"}


@dataclass(frozen=True)
class Curve:
    """One run: the objective after 0, 1, … iterations and the seconds until then."""

    algorithm: str
    init: str
    seed: int
    objective: list[float]
    seconds: list[float]


def run(settings: Settings) -> Outcome:
    """Solve one graph from several starts, and draw how the objective falls."""
    n = settings.size(200)
    graph = simulate("complete", n, noise=NOISE, seed=settings.seed).graph
    settings.progress("f*")
    optimum = solve(graph, method="newton", num_threads=1).objective
    curves = []
    for algorithm in (BCD, SUM, ADAPTIVE_SUM):
        for init, seed in [("shortest_path", 0), *(("random", k) for k in range(RANDOM_STARTS))]:
            settings.progress(f"{algorithm.name} from {init} {seed}")
            curves.append(_curve(graph, algorithm, init, seed))
    return Outcome(
        _markdown(n, curves, optimum),
        {"n": n, "noise": NOISE, "optimum": optimum, "curves": [asdict(c) for c in curves]},
        drawing.pictures(lambda figure: _draw(figure, n, curves, optimum), height=4.6),
    )


EXPERIMENT = Experiment(
    "fig2", "Fig. 2: convergence from different initial values", run, draws=True
)


def _curve(graph: MeasurementGraph, algorithm: Algorithm, init: str, seed: int) -> Curve:
    runs = [timed_solve(graph, algorithm, init=init, seed=seed) for _ in range(REPEATS)]
    # The run that had most of the processor, and only that part of its time.
    solution, cpu_seconds = min(runs, key=lambda run: run[0].timings.total)
    share = min(1.0, cpu_seconds / solution.timings.total)
    trace = solution.trace
    return Curve(
        algorithm.name, init, seed, trace.objective.tolist(), (share * trace.seconds).tolist()
    )


def _markdown(n: int, curves: list[Curve], optimum: float) -> str:
    rows = []
    for algorithm in dict.fromkeys(c.algorithm for c in curves):
        for init in ("shortest_path", "random"):
            chosen = [c for c in curves if (c.algorithm, c.init) == (algorithm, init)]
            to = [_iterations_to(1e-6, c, optimum) for c in chosen]
            rows.append([
                algorithm,
                "shortest paths" if init == "shortest_path" else f"random, {len(chosen)} times",
                f"{np.median([c.objective[0] / optimum for c in chosen]):.3g}",
                " ".join("never" if t is None else f"{t}" for t in to),
                f"{1e3 * np.median([c.seconds[-1] for c in chosen]):.2g}",
            ])  # fmt: skip
    return (
        f"A complete graph, n = {n}, φ = {NOISE:g} rad. CPU time of one thread, the "
        f"quickest of {REPEATS} runs; without the time for the initial value, with that for SUM's "
        "µ = −λ_min(Rt).\n\n"
        + markdown_table(
            ["algorithm", "start", "f/f* there", "iterations to 1 + 10⁻⁶", "ms to the end"], rows
        )
    )


def _iterations_to(excess: float, curve: Curve, optimum: float) -> int | None:
    """Iterations until f <= (1 + excess) f*; None if that was not reached: another optimum."""
    near = np.array(curve.objective) <= (1 + excess) * optimum
    return int(np.argmax(near)) if near.any() else None


def _draw(figure: Figure, n: int, curves: list[Curve], optimum: float) -> None:
    panels = figure.subplots(2, 2, sharex="col", sharey="row")
    for curve in curves:
        first = curve.init == "shortest_path"
        look: dict[str, Any] = {
            "color": drawing.COLOURS[curve.algorithm],
            "linestyle": "-" if first else ":",
            "marker": "o" if first else None,
            "markersize": 3,
            "alpha": 1.0 if first else 0.7,
        }
        objective = np.array(curve.objective)
        excess = np.maximum(objective / optimum - 1, FLOOR)
        for column, x in enumerate((range(len(objective)), 1e3 * np.array(curve.seconds))):
            panels[0, column].plot(x, objective, **look)
            panels[1, column].semilogy(x, excess, **look)
    panels[0, 0].set_ylabel("objective $f$")
    panels[1, 0].set_ylabel("$(f - f^*)\\,/\\,f^*$")
    panels[1, 0].set_xlabel("iteration")
    panels[1, 1].set_xlabel("CPU time [ms]")
    panels[1, 0].set_ylim(FLOOR / 2, None)
    for axes in panels[:, 0]:
        axes.set_xlim(-0.3, max(len(c.objective) for c in curves) - 0.7)
    for axes in panels[:, 1]:
        axes.set_xscale("log")
        axes.margins(x=0.03)
    names = list(dict.fromkeys(c.algorithm for c in curves))
    line = panels[0, 0].plot
    handles = [
        line([], [], color=drawing.COLOURS[name], label=_LABELS.get(name, name))[0]
        for name in names
    ]
    handles += [
        line([], [], "o-", color="0.4", markersize=3, label="from the shortest paths")[0],
        line([], [], ":", color="0.4", label=f"from {RANDOM_STARTS} random starts")[0],
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(f"complete graph, $n = {n}$, $\\varphi = {NOISE:g}$ rad", fontsize=9)
