"""Simulated graphs with full covariances, and what they ought to bring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs

RATIOS = ((1, 1, 1), (1, 2, 2.9), (1, 3, 10), (1, 1, 100))


def random_rotations(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    """(n, 3, 3) uniform."""
    q = rng.normal(size=(n, 4))
    return matrices_from_quaternions(q / np.linalg.norm(q, axis=1, keepdims=True))


def simulated(
    rng: np.random.Generator,
    n: int,
    density: float,
    ratio: tuple[float, float, float],
    noise: float,
) -> tuple[rotavg.MeasurementGraph, NDArray[np.float64]]:
    """A connected random graph whose edges know their axes as `ratio` says, and the truth.

    The axes are random; the RMS noise angle of every edge is `noise` radians.
    """
    i, j = np.triu_indices(n, 1)
    kept = (j == i + 1) | (rng.random(len(i)) < density)
    return measured(rng, np.stack([i[kept], j[kept]], axis=1), n, ratio, noise)


def measured(
    rng: np.random.Generator,
    edges: NDArray[np.int64],
    n: int,
    ratio: tuple[float, float, float],
    noise: float,
) -> tuple[rotavg.MeasurementGraph, NDArray[np.float64]]:
    """The same on given edges."""
    truth = random_rotations(rng, n)
    axes = random_rotations(rng, len(edges))
    variances = 1 / np.asarray(ratio, dtype=float)
    variances *= noise**2 / variances.sum()
    covariances = axes @ (variances[:, None] * np.swapaxes(axes, 1, 2))
    covariances = (covariances + np.swapaxes(covariances, 1, 2)) / 2
    e = np.einsum("kab,kb->ka", axes, np.sqrt(variances) * rng.normal(size=(len(edges), 3)))
    exact = np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]]
    graph = rotavg.MeasurementGraph(
        edges, exact @ matrices_from_rotvecs(e), covariances=covariances, nodes=range(n)
    )
    return graph, truth


def rotation_vectors(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3) of small rotations."""
    return (
        np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1) / 2
    )


def theory(graph: rotavg.MeasurementGraph, R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Traces of the errors' covariances, first node held: scalar weights, full ones."""
    assert graph.covariances is not None
    n, (i, j) = graph.num_nodes, graph.indices.T
    B = np.zeros((3 * graph.num_edges, 3 * n))
    for k in range(graph.num_edges):
        B[3 * k : 3 * k + 3, 3 * i[k] : 3 * i[k] + 3] = -R[j[k]].T
        B[3 * k : 3 * k + 3, 3 * j[k] : 3 * j[k] + 3] = R[j[k]].T
    B = B[:, 3:]
    C = np.zeros((3 * graph.num_edges, 3 * graph.num_edges))
    W = np.zeros_like(C)
    for k, covariance in enumerate(graph.covariances):
        rows = slice(3 * k, 3 * k + 3)
        C[rows, rows] = covariance
        W[rows, rows] = graph.weights[k] * np.eye(3)
    estimator = np.linalg.solve(B.T @ W @ B, B.T @ W)
    scalar = np.trace(estimator @ C @ estimator.T)
    full = np.trace(np.linalg.inv(B.T @ np.linalg.solve(C, B)))
    return np.array([scalar, full])
