"""Plots: what is drawn is what the solution says, at every size."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from numpy.typing import NDArray

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

import rotavg
from rotavg import plot
from rotavg.drawing import figures
from rotavg.io.positions import positions
from rotavg.plot.spectrum import certificate_matrix, smallest_eigenvalues


@pytest.fixture(autouse=True)
def _close_figures() -> object:
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def solution() -> rotavg.Solution:
    return rotavg.solve(
        rotavg.simulate("erdos_renyi", 40, density=0.2, noise=0.1, outliers=0.1, seed=3).graph
    )


def pose_graph(folder: Path, n: int) -> rotavg.MeasurementGraph:
    """A g2o file with vertices at known places, and nothing measured between them, read back."""
    simulation = rotavg.simulate("sphere", n, noise=0.05, seed=1)
    path = folder / "poses.g2o"
    graph = rotavg.MeasurementGraph(simulation.graph.edges, simulation.graph.rotations)
    rotavg.write(path, rotavg.solve(graph, max_iterations=0, certify=False))
    assert simulation.positions is not None
    vertices, others = [], []
    for line in path.read_text().splitlines():
        tag, node, *rest = line.split()
        if tag == "VERTEX_SE3:QUAT":
            place = " ".join(map(repr, simulation.positions[int(node)].tolist()))
            vertices.append(f"{tag} {node} {place} {' '.join(rest[3:])}")
        else:
            others.append(line)
    path.write_text("\n".join([*others, *reversed(vertices)]) + "\n")  # any order will do
    return rotavg.read(path)


def heights(ax: Axes) -> list[float]:
    return [float(sum(bar.get_height() for bar in group)) for group in ax.containers]  # type: ignore[attr-defined]


def test_residuals_counts_every_edge_once(solution: rotavg.Solution) -> None:
    _, ax = plt.subplots()
    assert plot.residuals(solution, ax) is ax
    assert heights(ax) == [solution.graph.num_edges]
    assert "[deg]" in ax.get_xlabel()


def test_residuals_shows_what_robust_weights_are_left(
    solution: rotavg.Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = np.where(solution.residual_angles > 0.5, 0.01, 0.5)
    monkeypatch.setattr(rotavg.Solution, "edge_weights", property(lambda _: weights))
    assert 0 < np.count_nonzero(weights == 0.01) < len(weights)
    all_edges, left = heights(plot.residuals(solution))
    assert all_edges == solution.graph.num_edges
    assert left == pytest.approx(np.sum(weights / 0.5))


def test_residuals_of_far_outliers_are_on_a_logarithmic_axis() -> None:
    graph = rotavg.simulate("complete", 40, noise=1e-3, outliers=0.02, seed=1).graph
    solution = rotavg.solve(graph.with_weights(np.ones(graph.num_edges)))
    ax = plot.residuals(solution)
    assert ax.get_xscale() == "log"
    assert heights(ax) == [graph.num_edges]


def test_convergence_draws_the_trace(solution: rotavg.Solution) -> None:
    ax = plot.convergence(solution)
    x, y = (np.asarray(data) for data in ax.get_lines()[0].get_data())
    np.testing.assert_allclose(x, 1e3 * solution.trace.seconds)
    best = solution.trace.objective.min()
    np.testing.assert_allclose(
        y, np.maximum(solution.trace.objective / best - 1, 1e-16), atol=1e-15
    )
    twin = next(other for other in ax.figure.axes if other is not ax)
    np.testing.assert_allclose(
        np.asarray(twin.get_lines()[0].get_ydata()), solution.trace.relative_gradient
    )
    assert "[ms]" in ax.get_xlabel()
    assert "[rad]" in twin.get_ylabel()


def test_adjacency_shows_the_largest_residual_of_a_cell(solution: rotavg.Solution) -> None:
    graph, degrees = solution.graph, np.degrees(solution.residual_angles)
    n = graph.num_nodes
    for cells in (n, 7):
        side = min(n, cells)
        expected = np.full((side, side), np.nan)
        for (i, j), angle in zip(graph.indices.tolist(), degrees):
            for a, b in ((i, j), (j, i)):
                cell = a * side // n, b * side // n
                expected[cell] = np.nanmax([expected[cell], angle])
        np.testing.assert_array_equal(figures.largest_in_cells(graph, degrees, cells), expected)
        image = plot.adjacency(solution, cells=cells).get_images()[0]
        np.testing.assert_array_equal(image.get_array().filled(np.nan), expected)  # type: ignore[union-attr]


def test_trajectory_is_drawn_where_the_file_has_it(tmp_path: Path) -> None:
    graph = pose_graph(tmp_path, 60)
    place = rotavg.simulate("sphere", 60, noise=0.05, seed=1).positions
    np.testing.assert_array_equal(positions(graph), place)
    ax = plot.trajectory(graph, rotavg.solve(graph).rotations)
    dots = np.column_stack(ax.collections[1]._offsets3d)
    np.testing.assert_array_equal(dots, place)


def test_before_and_after_can_share_axes_colours_and_figure(tmp_path: Path) -> None:
    graph = pose_graph(tmp_path, 60)
    before = rotavg.solve(graph, init="spanning_tree", max_iterations=0, certify=False)
    figure = plt.figure()
    for k, (draw, R) in enumerate(
        (draw, s.rotations)
        for draw in (plot.trajectory, plot.orientations)
        for s in (before, rotavg.solve(graph))
    ):
        ax = figure.add_subplot(2, 2, k + 1, projection="3d")
        assert draw(graph, R, ax, top_deg=5.0) is ax
        assert ax.collections[-1 if draw is plot.orientations else 1].norm.vmax == 5.0


def test_orientations_are_where_the_z_axes_point(solution: rotavg.Solution) -> None:
    ax = plot.orientations(solution.graph, solution.rotations)
    dots = np.column_stack(ax.collections[-1]._offsets3d)
    np.testing.assert_array_equal(dots, solution.rotations @ [0.0, 0.0, 1.0])


def test_what_cannot_be_drawn_is_told(solution: rotavg.Solution, tmp_path: Path) -> None:
    graph = solution.graph
    with pytest.raises(rotavg.GraphError, match="pass positions="):
        plot.trajectory(graph, solution.rotations)
    with pytest.raises(rotavg.GraphError, match=r"positions have shape \(3, 3\)"):
        plot.trajectory(graph, solution.rotations, positions=np.eye(3))
    with pytest.raises(rotavg.GraphError, match="rotations have shape"):
        plot.orientations(graph, np.eye(3))
    with pytest.raises(rotavg.OptionError, match='projection="3d"'):
        plot.orientations(graph, solution.rotations, plt.subplots()[1])
    rotavg.write(tmp_path / "origin.g2o", solution)  # every vertex at zero: no positions
    assert positions(rotavg.read(tmp_path / "origin.g2o")) is None


def literal_certificate_matrix(
    graph: rotavg.MeasurementGraph, R: NDArray[np.float64]
) -> NDArray[np.float64]:
    """S = Lambda - Rt as Theorem 1 prints it, Lambda symmetrised block by block."""
    n = graph.num_nodes
    Rt = np.zeros((n, 3, n, 3))
    for (i, j), R_ij, w in zip(graph.indices, graph.rotations, graph.weights):
        Rt[i, :, j] += w * R_ij
        Rt[j, :, i] += w * R_ij.T
    S = -Rt
    for i in range(n):
        block = sum(Rt[i, :, j] @ R[j].T @ R[i] for j in range(n))
        S[i, :, i] += (block + block.T) / 2
    return S.reshape(3 * n, 3 * n)


@pytest.mark.parametrize("iterations", [0, 2, 1000])
def test_the_spectrum_is_that_of_the_certificate(iterations: int) -> None:
    graph = rotavg.simulate("grid", 27, noise=0.3, seed=5).graph
    graph = graph.with_weights(np.random.default_rng(1).uniform(0.5, 2, graph.num_edges))
    R = rotavg.solve(graph, method="bcd", max_iterations=iterations, certify=False).rotations
    S = certificate_matrix(graph, R)
    expected = np.linalg.eigvalsh(literal_certificate_matrix(graph, R))
    np.testing.assert_allclose(np.linalg.eigvalsh(S.toarray()), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "iterations"), [("sphere", 20000), ("complete", 20000), ("band", 20000), ("band", 1)]
)
def test_large_spectra_are_those_of_the_whole_matrix(kind: str, iterations: int) -> None:
    graph = rotavg.simulate(kind, 210, noise=0.2, seed=2).graph
    R = rotavg.solve(graph, max_iterations=iterations, certify=False).rotations
    S = certificate_matrix(graph, R)
    expected = np.linalg.eigvalsh(S.toarray())[:12]
    found = smallest_eigenvalues(graph, S, 12)
    np.testing.assert_allclose(found, expected, atol=1e-7 * S.diagonal().max())


def test_spectrum_colours_what_refutes(solution: rotavg.Solution) -> None:
    def colours(s: rotavg.Solution) -> dict[str, int]:
        lines = plot.spectrum(s).get_lines()
        return {str(line.get_color()): len(np.asarray(line.get_xdata())) for line in lines}

    assert colours(solution) == {"0.5": 3, "tab:blue": 9}
    start = rotavg.solve(solution.graph, init="random", max_iterations=0, certify=False)
    assert colours(start)["tab:red"] > 0


def test_spectrum_refuses_what_has_another_matrix(solution: rotavg.Solution) -> None:
    graph, R = solution.graph, solution.rotations
    node = graph.nodes[0].item()
    fixed = rotavg.solve(graph, priors=rotavg.Priors(fixed={node: R[0]}))
    spread = np.tile(0.01 * np.eye(3), (graph.num_edges, 1, 1))
    full = rotavg.MeasurementGraph(graph.edges, graph.rotations, covariances=spread)
    for other, what in (
        (fixed, "priors"),
        (rotavg.solve(full, anisotropic=True), "full covariances"),
    ):
        with pytest.raises(rotavg.OptionError, match=f"this solution has {what}"):
            plot.spectrum(other)


def test_spectrum_of_the_largest_component_and_of_the_smallest_graph() -> None:
    two = rotavg.MeasurementGraph.from_rotvecs(
        [(0, 1), (5, 6), (6, 7), (5, 7)], [[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0.5, 0]]
    )
    assert "of 9 eigenvalues" in plot.spectrum(rotavg.solve(two)).get_title()
    one = rotavg.MeasurementGraph.from_rotvecs([(0, 1)], [[0, 0, 1]])
    solution = rotavg.solve(one)
    assert "6 smallest of 6" in plot.spectrum(solution).get_title()
    for draw in (plot.residuals, plot.convergence, plot.adjacency):
        draw(solution).figure.canvas.draw()  # nothing to see, and no warning
    plot.trajectory(one, solution.rotations, positions=[[0, 0, 0], [1, 1, 1]]).figure.canvas.draw()


def test_pictures_of_a_hundred_thousand_edges_stay_small(tmp_path: Path) -> None:
    graph = rotavg.simulate("band", 11120, noise=0.05, seed=1).graph
    assert graph.num_edges > 100_000
    solution = rotavg.solve(graph, certify=False)
    place = np.cumsum(np.random.default_rng(0).standard_normal((graph.num_nodes, 3)), axis=0)
    figure = plt.figure(figsize=(15, 8))
    plot.residuals(solution, figure.add_subplot(231))
    plot.convergence(solution, figure.add_subplot(232))
    plot.adjacency(solution, figure.add_subplot(233))
    plot.orientations(graph, solution.rotations, figure.add_subplot(234, projection="3d"))
    plot.trajectory(
        graph, solution.rotations, figure.add_subplot(235, projection="3d"), positions=place
    )
    figure.savefig(tmp_path / "all.pdf", dpi=100)
    assert (tmp_path / "all.pdf").stat().st_size < 2_000_000


def test_without_matplotlib_the_extra_is_named(
    solution: rotavg.Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(rotavg.MissingExtraError, match=r"rotavg\[plot\]"):
        plot.residuals(solution)


def test_the_worst_are_drawn_last_and_never_left_out() -> None:
    values = np.random.default_rng(0).permutation(1000).astype(np.float64)
    rows = figures.worst_and_others(values, 100)
    assert len(rows) == len(set(rows.tolist())) == 100
    np.testing.assert_array_equal(values[rows][-25:], np.arange(975, 1000))
    assert (np.diff(values[rows]) > 0).all()
    np.testing.assert_array_equal(values[figures.worst_and_others(values, 5000)], np.arange(1000))
