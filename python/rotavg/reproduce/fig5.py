"""Fig. 5: the solution of noiseless complete and cyclic graphs (Lemma 3), drawn and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotavg.reproduce import drawing
from rotavg.reproduce.experiment import Experiment, Outcome, Settings, markdown_table
from rotavg.simulation.simulate import Simulation, simulate
from rotavg.solving.objective import objective
from rotavg.solving.solve import solve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def run(settings: Settings) -> Outcome:
    """Check the closed forms that the figure gives on noiseless graphs, and draw it."""
    n = max(3, settings.size(6))
    checks = [_check(kind, n, settings.seed) for kind in ("complete", "cycle")]
    return Outcome(
        _markdown(n, checks),
        {"n": n, "graphs": checks},
        drawing.pictures(_draw, height=2.9),
    )


EXPERIMENT = Experiment("fig5", "Fig. 5: solutions of noiseless graphs", run, draws=True)


def _check(kind: str, n: int, seed: int) -> dict[str, Any]:
    """The closed form of the figure, against the ground truth and the shortest-path start."""
    simulation = simulate(kind, n, noise=0.0, seed=seed)
    R = _closed_form(kind, simulation)
    start = solve(simulation.graph, init="shortest_path", max_iterations=0, certify=False)
    # On a cycle shortest paths go both ways round; without noise all ways agree.
    truth = np.swapaxes(simulation.ground_truth[:1], 1, 2) @ simulation.ground_truth
    return {
        "kind": kind,
        "objective": objective(simulation.graph, R),
        "distance_from_truth": float(np.abs(R - truth).max()),
        "distance_from_shortest_paths": float(np.abs(R - start.rotations).max()),
    }


def _closed_form(kind: str, simulation: Simulation) -> NDArray[np.float64]:
    """R_1 = I; complete: R_i = R_1i; cycle: R_i = R_12 R_23 … R_(i-1)i."""
    graph = simulation.graph
    measured = {(i, j): R for (i, j), R in zip(graph.indices.tolist(), graph.rotations)}
    R = [np.eye(3)]
    for i in range(1, graph.num_nodes):
        R.append(measured[0, i] if kind == "complete" else R[-1] @ measured[i - 1, i])
    return np.stack(R)


def _markdown(n: int, checks: list[dict[str, Any]]) -> str:
    rows = [
        [
            c["kind"],
            f"{c['objective']:.1e}",
            f"{c['distance_from_truth']:.1e}",
            f"{c['distance_from_shortest_paths']:.1e}",
        ]
        for c in checks
    ]
    return (
        f"Noiseless measurements of {n} random rotations; the closed forms of the figure, and the "
        'largest entry by which they differ from the truth and from `init="shortest_path"`:\n\n'
        + markdown_table(["graph", "f", "from the truth", "from the shortest paths"], rows)
    )


# The drawing: nodes 1 … 4, … and n on a circle.


def _draw(figure: Figure) -> None:
    panels = figure.subplots(1, 2)
    titles = (
        "complete graph: $R_1 = I,\\; R_i = R_{1i}$",
        "cycle: $R_1 = I,\\; R_i = R_{12} R_{23} \\cdots R_{(i-1)i}$",
    )
    for axes, title in zip(panels, titles):
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set(xlim=(-2.1, 2.1), ylim=(-1.45, 1.8))
        axes.text(0, 1.65, title, ha="center")
    _draw_complete(panels[0])
    _draw_cycle(panels[1])


_NAMES = ("1", "2", "3", "4", "5", "n")
_Place = tuple[float, float]
_ON_PATH, _OFF_PATH = drawing.COLOURS["SUM"], "0.75"


def _places(radius: float = 1.0) -> list[_Place]:
    angles = np.pi / 2 - 2 * np.pi * np.arange(len(_NAMES)) / len(_NAMES)
    return [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles]


def _arrow(axes: Axes, a: _Place, b: _Place, label: str | None) -> None:
    """An edge of a shortest path, with its measurement's name; without a name, any other edge."""
    colour = _OFF_PATH if label is None else _ON_PATH
    style = {"arrowstyle": "-|>", "shrinkA": 11, "shrinkB": 11, "color": colour, "zorder": 1}
    axes.annotate("", b, a, arrowprops={**style, "linewidth": 0.8 if label is None else 1.5})
    if label is not None:
        x, y = (0.5 * (p + q) for p, q in zip(a, b))
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
        axes.text(x, y, label, ha="center", va="center", fontsize=8, bbox=box)


def _draw_nodes(axes: Axes, labels: list[str]) -> None:
    for (x, y), outside, name, label in zip(_places(), _places(1.25), _NAMES, labels):
        axes.plot(x, y, "o", markersize=17, color="white", markeredgecolor="black", zorder=3)
        axes.text(x, y, f"${name}$", ha="center", va="center", zorder=4)
        side = "center" if abs(x) < 0.1 else ("left" if x > 0 else "right")
        axes.text(*outside, f"${label}$", ha=side, va="center")


def _draw_complete(axes: Axes) -> None:
    places = _places()
    for i in range(1, len(places)):
        for j in range(i + 1, len(places)):
            _arrow(axes, places[i], places[j], None)
    for place, name in zip(places[1:], _NAMES[1:]):
        _arrow(axes, places[0], place, f"$R_{{1{name}}}$")
    _draw_nodes(axes, ["R_1 = I", *(f"R_{name} = R_{{1{name}}}" for name in _NAMES[1:])])


def _draw_cycle(axes: Axes) -> None:
    places = _places()
    for k in range(4):
        label = f"$R_{{{_NAMES[k]}{_NAMES[k + 1]}}}$"
        _arrow(axes, places[k], places[k + 1], label)
    _arrow(axes, places[4], places[5], "$\\cdots$")
    _arrow(axes, places[5], places[0], None)
    labels = ["R_1 = I", "R_2 = R_{12}", "R_3 = R_{12} R_{23}", "R_4 = R_3 R_{34}",
              "R_5 = R_4 R_{45}", "R_n = R_{n-1} R_{(n-1)n}"]  # fmt: skip
    _draw_nodes(axes, labels)
