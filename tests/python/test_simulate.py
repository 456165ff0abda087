"""Simulated graphs are what they claim to be."""

from __future__ import annotations

import numpy as np
import pytest

from rotavg.base.errors import GraphError
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.simulation.simulate import KINDS, Simulation, simulate

SIZES = [3, 4, 9, 27, 50, 100, 343]


def error_angles(simulation: Simulation) -> np.ndarray:
    """Angle (m,) between each measurement and the truth, radians."""
    truth = simulation.ground_truth
    i, j = simulation.graph.indices.T
    error = np.swapaxes(truth[j], 1, 2) @ truth[i] @ simulation.graph.rotations
    q = quaternions_from_matrices(error)
    return 2 * np.arctan2(np.linalg.norm(q[:, :3], axis=1), q[:, 3])


def pairs(simulation: Simulation) -> set[tuple[int, ...]]:
    return {tuple(sorted(edge)) for edge in simulation.graph.edges.tolist()}


@pytest.mark.parametrize("noise", [-1.0, 1e7, np.nan, np.inf])
def test_noise_beyond_what_angles_can_be_is_refused(noise: float) -> None:
    with pytest.raises(GraphError, match=r"noise is .*expected .* from 0 to 1e\+06"):
        simulate("cycle", 5, noise=noise)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", SIZES)
def test_noiseless_graph_is_exact_and_connected(kind: str, n: int) -> None:
    simulation = simulate(kind, n, seed=n)
    graph = simulation.graph
    assert graph.nodes.tolist() == list(range(n))
    assert graph.components().max() == 0
    assert not simulation.is_outlier.any()
    assert error_angles(simulation).max() < 1e-14 * n
    assert len(pairs(simulation)) == graph.num_edges or kind == "band"
    truth = simulation.ground_truth
    np.testing.assert_allclose(np.linalg.det(truth), 1, atol=1e-14)
    np.testing.assert_allclose(truth @ np.swapaxes(truth, 1, 2) - np.eye(3), 0, atol=1e-14)
    assert (simulation.positions is not None) == (kind in ("grid", "sphere"))


@pytest.mark.parametrize("kind", KINDS)
def test_seed_decides(kind: str) -> None:
    arguments = {"noise": 0.1, "drop": 0.02, "outliers": 0.1, "loop_closures": 0.2}
    first, same, other = (simulate(kind, 60, seed=s, **arguments) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.graph.edges, same.graph.edges)
    np.testing.assert_array_equal(first.graph.rotations, same.graph.rotations)
    np.testing.assert_array_equal(first.is_outlier, same.is_outlier)
    assert not np.array_equal(first.graph.rotations, other.graph.rotations)


@pytest.mark.parametrize("kind", ["grid", "sphere"])
def test_translations_are_those_between_the_positions(kind: str) -> None:
    simulation = simulate(kind, 60, noise=0.2, outliers=0.2, seed=3)
    x, R, measured = simulation.positions, simulation.ground_truth, simulation.graph.translations
    assert x is not None
    assert measured is not None
    for (i, j), t in zip(simulation.graph.edges.tolist(), measured.vectors):
        np.testing.assert_allclose(t, R[i].T @ (x[j] - x[i]), atol=1e-12)


def test_shapes_of_the_graphs() -> None:
    assert pairs(simulate("complete", 6)) == {(i, j) for j in range(6) for i in range(j)}
    assert simulate("cycle", 4).graph.edges.tolist() == [[0, 1], [1, 2], [2, 3], [3, 0]]
    band = {(i, j) for j in range(30) for i in range(max(0, j - 9), j)}
    assert pairs(simulate("band", 30, loop_closures=0.0)) == band
    assert simulate("sphere", 2500).graph.num_edges == 4949  # as in sphere2500
    assert simulate("grid", 125).graph.num_edges == 300


@pytest.mark.parametrize("n", SIZES)
def test_grid_is_a_walk_on_a_lattice(n: int) -> None:
    simulation = simulate("grid", n)
    x = simulation.positions
    assert x is not None
    i, j = simulation.graph.indices.T
    np.testing.assert_array_equal(np.abs(x[i] - x[j]).sum(axis=1), 1)
    distance = np.abs(x[:, None] - x[None]).sum(axis=2)
    assert len(pairs(simulation)) == np.count_nonzero(distance == 1) // 2
    assert simulation.graph.edges[: n - 1].tolist() == [[k, k + 1] for k in range(n - 1)]
    heading = simulation.ground_truth[:-1, :, 0]
    np.testing.assert_allclose(heading, np.diff(x, axis=0), atol=1e-15)


def test_sphere_looks_ahead_and_out() -> None:
    simulation = simulate("sphere", 2500)
    x, frames = simulation.positions, simulation.ground_truth
    assert x is not None
    np.testing.assert_allclose(frames[:, :, 2], x, atol=1e-14)
    steps = np.diff(x, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    assert np.sum(frames[:-1, :, 0] * steps, axis=1).min() > 0.99
    i, j = simulation.graph.indices.T
    assert np.linalg.norm(x[i] - x[j], axis=1).max() < 0.15  # a closure is to a neighbour


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_is_the_papers(seed: int) -> None:
    simulation = simulate("complete", 200, noise=0.2, seed=seed)
    angles = error_angles(simulation)
    m = len(angles)
    assert abs(np.sqrt(np.mean(angles**2)) / 0.2 - 1) < 5 / np.sqrt(2 * m)
    assert abs(np.mean(angles < 0.2) - 0.6827) < 5 * np.sqrt(0.25 / m)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ground_truth_is_uniform(seed: int) -> None:
    # Under the uniform distribution every entry of a rotation has mean 0 and variance 1/3, and
    # the angle has density (1 - cos t) / pi, so that P(t < pi / 2) = 1/2 - 1/pi.
    truth = simulate("cycle", 20000, seed=seed).ground_truth
    assert np.abs(truth.mean(axis=0)).max() < 5 * np.sqrt(1 / 3 / 20000)
    assert np.abs((truth**2).mean(axis=0) - 1 / 3).max() < 0.015
    angle = np.arccos(np.clip((np.trace(truth, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert abs(np.mean(angle < np.pi / 2) - (0.5 - 1 / np.pi)) < 0.015


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("kind", "n", "drop"),
    [("complete", 20, 0.3), ("complete", 20, 0.9), ("grid", 125, 0.5), ("sphere", 100, 0.4)],
)
def test_drop_never_disconnects(kind: str, n: int, drop: float, seed: int) -> None:
    whole = simulate(kind, n, seed=seed)
    simulation = simulate(kind, n, drop=drop, seed=seed)
    m = whole.graph.num_edges
    assert simulation.graph.num_edges == m - round(drop * m)
    assert simulation.graph.components().max() == 0
    assert pairs(simulation) < pairs(whole)


@pytest.mark.parametrize("seed", [1, 2])
def test_outliers_are_marked(seed: int) -> None:
    simulation = simulate("complete", 60, noise=0.01, outliers=0.25, seed=seed)
    assert simulation.is_outlier.sum() == round(0.25 * simulation.graph.num_edges)
    angles = error_angles(simulation)
    assert angles[~simulation.is_outlier].max() < 0.1
    assert np.median(angles[simulation.is_outlier]) > 1.5


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("n", "density"), [(40, 1.0), (300, 0.4), (300, 0.02), (2000, 0.01)])
def test_erdos_renyi_density(n: int, density: float, seed: int) -> None:
    graph = simulate("erdos_renyi", n, density=density, seed=seed).graph
    total = n * (n - 1) / 2
    spread = 5 * np.sqrt(total * density * (1 - density))
    assert abs(graph.num_edges - total * density) <= spread + 3
    assert (graph.edges[:, 0] < graph.edges[:, 1]).all()
    # Uniform over pairs: each node has the expected degree on average over halves of the nodes.
    first_half = np.bincount(graph.indices.ravel(), minlength=n)[: n // 2].sum()
    expected = density * (n - 1) * (n // 2)
    assert abs(first_half - expected) < 5 * np.sqrt(2 * expected) + 3


@pytest.mark.parametrize("density", [0.0, 1e-6, 1e-4, 1e-3])
def test_erdos_renyi_is_connected_by_as_few_edges_as_it_takes(density: float) -> None:
    simulation = simulate("erdos_renyi", 500, density=density, seed=1)
    assert simulation.graph.components().max() == 0
    assert len(pairs(simulation)) == simulation.graph.num_edges
    if density == 0:
        assert simulation.graph.num_edges == 499


def test_large_sparse_graph_needs_no_table_of_pairs() -> None:
    graph = simulate("erdos_renyi", 100_000, density=4e-5, seed=1).graph
    assert abs(graph.num_edges - 200_000) < 5000
    assert graph.components().max() == 0
    assert len(np.unique(graph.edges @ [100_000, 1])) == graph.num_edges


@pytest.mark.parametrize("seed", [1, 2])
def test_band_with_loop_closures(seed: int) -> None:
    simulation = simulate("band", 1000, loop_closures=0.1, seed=seed)
    edges = simulation.graph.edges
    assert len(edges) == sum(1000 - d for d in range(1, 10))
    apart = np.abs(edges[:, 0] - edges[:, 1])
    assert abs(np.mean(apart > 9) - 0.1) < 0.01
    assert simulation.graph.components().max() == 0
