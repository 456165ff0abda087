"""Positions against dense least squares, closed forms and the objective that they minimise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import GraphError

Floats = NDArray[np.float64]


def pose_graph(
    n: int, seed: int, noise: float = 0.0, isotropic: bool = False, parts: int = 1
) -> tuple[rotavg.MeasurementGraph, Floats, Floats]:
    """A random pose graph of so many components, its rotations and its positions."""
    rng = np.random.default_rng(seed)
    base = [rotavg.simulate("erdos_renyi", n, density=0.2, seed=seed + k) for k in range(parts)]
    edges = np.concatenate([k * n + part.graph.edges for k, part in enumerate(base)])
    R = np.concatenate([part.ground_truth for part in base])
    p = rng.normal(size=(parts * n, 3)) * 10
    i, j = edges.T
    moved = np.einsum("mba,mb->ma", R[i], p[j] - p[i]) + noise * rng.normal(size=(len(edges), 3))
    if isotropic:
        information = rng.uniform(0.1, 10, size=(len(edges), 1, 1)) * np.eye(3)
    else:
        factor = rng.normal(size=(len(edges), 3, 3))
        information = factor @ np.swapaxes(factor, 1, 2) + 0.01 * np.eye(3)
    graph = rotavg.MeasurementGraph(
        edges,
        np.concatenate([part.graph.rotations for part in base]),
        translations=rotavg.RelativeTranslations(moved, information),
    )
    return graph, R, p


def chi2(graph: rotavg.MeasurementGraph, R: Floats, p: Floats) -> float:
    """The translational part of g2o's chi^2, spelt edge by edge."""
    total = 0.0
    for k, (i, j) in enumerate(graph.indices):
        error = graph.rotations[k].T @ (R[i].T @ (p[j] - p[i]) - graph.translations.vectors[k])
        total += error @ graph.translations.information[k] @ error
    return total


@pytest.mark.parametrize("isotropic", [False, True])
def test_without_noise_they_are_exact(isotropic: bool) -> None:
    graph, R, p = pose_graph(40, seed=1, isotropic=isotropic)
    found = rotavg.positions(graph, R)
    np.testing.assert_allclose(found, p - p[0], atol=1e-11)
    assert (found[0] == 0).all()


@pytest.mark.parametrize("isotropic", [False, True])
def test_against_dense_least_squares(isotropic: bool) -> None:
    graph, R, _ = pose_graph(20, seed=2, noise=1.0, isotropic=isotropic)
    graph = rotavg.MeasurementGraph(
        graph.edges,
        rotavg.simulate("erdos_renyi", 20, density=0.2, noise=0.3, seed=2).graph.rotations,
        translations=graph.translations,
    )
    rows, right = [], []
    for k, (i, j) in enumerate(graph.indices):
        # chi^2 = |F^T e|^2 with Omega = F F^T.
        F = np.linalg.cholesky(graph.translations.information[k])
        turned = F.T @ graph.rotations[k].T @ R[i].T
        row = np.zeros((3, 60))
        row[:, 3 * j : 3 * j + 3], row[:, 3 * i : 3 * i + 3] = turned, -turned
        rows.append(row)
        right.append(F.T @ graph.rotations[k].T @ graph.translations.vectors[k])
    A, b = np.vstack(rows), np.concatenate(right)
    expected = np.linalg.lstsq(A[:, 3:], b, rcond=None)[0].reshape(-1, 3)
    found = rotavg.positions(graph, R)
    np.testing.assert_allclose(found[1:], expected, atol=1e-9)
    assert chi2(graph, R, found) == pytest.approx(np.sum((A @ found.ravel() - b) ** 2), rel=1e-9)
    rng = np.random.default_rng(3)
    for _ in range(20):
        other = found + 1e-3 * rng.normal(size=found.shape)
        assert chi2(graph, R, other) > chi2(graph, R, found)


def test_components_and_fixed_nodes() -> None:
    graph, R, p = pose_graph(15, seed=4, parts=3)
    found = rotavg.positions(graph, R, fixed={18: p[18], 20: p[20]})
    np.testing.assert_allclose(found[:15], (p - p[0])[:15], atol=1e-11)
    np.testing.assert_allclose(found[15:30], p[15:30], atol=1e-11)
    np.testing.assert_allclose(found[30:], (p - p[30])[30:], atol=1e-11)
    # Where fixed nodes contradict the measurements, they stay, and the others bend.
    bent = rotavg.positions(graph, R, fixed={18: p[18], 20: p[20] + 1})
    assert (bent[[18, 20]] == [p[18], p[20] + 1]).all()
    assert chi2(graph, R, bent) > 1e-3


def test_every_node_fixed_and_nodes_without_edges() -> None:
    translations = rotavg.RelativeTranslations([[1, 2, 3]])
    graph = rotavg.MeasurementGraph(
        [["a", "b"]], [np.eye(3)], nodes=["c", "a", "b"], translations=translations
    )
    R = np.broadcast_to(np.eye(3), (3, 3, 3))
    assert rotavg.positions(graph, R).tolist() == [[0, 0, 0], [0, 0, 0], [1, 2, 3]]
    everything = {0: [1, 1, 1], 1: [2, 2, 2], 2: [0, 0, 0]}
    assert rotavg.positions(graph, R, fixed=everything).tolist() == list(everything.values())


def test_the_graph_carries_its_translations_along() -> None:
    graph, _, _ = pose_graph(15, seed=5, parts=2)
    half = graph.largest_component()
    assert len(half.translations) == half.num_edges == len(half.translations.information)
    again = graph.with_weights(2 * graph.weights)
    np.testing.assert_array_equal(again.translations.vectors, graph.translations.vectors)


def test_bad_input() -> None:
    graph, R, _ = pose_graph(5, seed=6)
    bare = rotavg.MeasurementGraph(graph.edges, graph.rotations)
    with pytest.raises(GraphError, match="no relative translations"):
        rotavg.positions(bare, R)
    with pytest.raises(GraphError, match=r"shape \(4, 3, 3\), expected \(5, 3, 3\)"):
        rotavg.positions(graph, R[:4])
    for matrix in (5 * R[2], np.full((3, 3), np.nan), np.diag([1.0, 1, -1])):
        with pytest.raises(
            GraphError, match=r"the matrix of node 2 (is not a rotation|holds a NaN)"
        ):
            rotavg.positions(graph, [*R[:2], matrix, *R[3:]])
    for row in (5, -1, "a", 1.5):
        with pytest.raises(GraphError, match=f"fixed for row {row!r}, expected a row .* 0 to 4"):
            rotavg.positions(graph, R, fixed={row: [0, 0, 0]})  # type: ignore[dict-item]
    with pytest.raises(GraphError, match=r"position of row 1 is \[0.0, nan, 0.0\], expected"):
        rotavg.positions(graph, R, fixed={1: [0, np.nan, 0]})
    with pytest.raises(GraphError, match="there are 1 translations, expected"):
        rotavg.MeasurementGraph(
            graph.edges, graph.rotations, translations=rotavg.RelativeTranslations([[0, 0, 0]])
        )
    with pytest.raises(GraphError, match=r"translation 1 is .*expected finite"):
        rotavg.RelativeTranslations([[0, 0, 0], [0, np.nan, 0]])
    for bad in (np.diag([1, 1, -1]), np.zeros((3, 3)), [[1, 0, 0], [0.5, 1, 0], [0, 0, 1]]):
        with pytest.raises(GraphError, match="information 0 is not symmetric positive definite"):
            rotavg.RelativeTranslations([[0, 0, 0]], [bad])
