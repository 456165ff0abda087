"""How well rotations are known with priors: covariances, noise, degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg import Priors
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.priors.grounded import ground
from rotavg.solving.robust import Loss
from rotavg.solving.uncertainty import estimated_noise_variance
from test_priors import DOWN, downs


@pytest.fixture
def simulation() -> rotavg.Simulation:
    return rotavg.simulate("erdos_renyi", 20, density=0.3, noise=0.1, seed=4)


@pytest.fixture
def truth(simulation: rotavg.Simulation) -> NDArray[np.float64]:
    """In a world of its own."""
    return matrices_from_rotvecs([0.4, -1.0, 2.0]) @ simulation.ground_truth


def test_covariances_with_priors_predict_monte_carlo(truth: NDArray[np.float64]) -> None:
    """Gravity and an absolute prior: marginals relative to the world, and the noise."""
    T = truth[:5]
    edges = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (3, 4)])
    rng = np.random.default_rng(6)
    sigma, runs = 0.01, 500
    errors, variances = np.empty((runs, 5, 3)), np.empty(runs)
    for k in range(runs):
        noise = matrices_from_rotvecs(sigma * rng.normal(size=(len(edges), 3)))
        i, j = edges.T
        graph = rotavg.MeasurementGraph(edges, np.swapaxes(T[i], 1, 2) @ T[j] @ noise)
        d = downs(T, sigma / 2, seed=k)
        priors = Priors(
            absolute={4: (matrices_from_rotvecs(sigma * rng.normal(size=3)) @ T[4], 1.0)},
            gravity={node: (d[node], 4.0) for node in (1, 3)},
        )
        solution = rotavg.solve(graph, priors=priors, certify=False, num_threads=1)
        E = solution.rotations @ np.swapaxes(T, 1, 2)
        errors[k] = np.stack([E[:, 2, 1], E[:, 0, 2], E[:, 1, 0]], axis=1)
        variances[k] = estimated_noise_variance(solution)
    assert variances.mean() == pytest.approx(sigma**2, rel=0.07)
    predicted = solution.covariances(noise_variance=sigma**2)
    for node in range(5):
        scatter = errors[:, node].T @ errors[:, node] / runs
        assert np.trace(scatter) == pytest.approx(np.trace(predicted[node]), rel=0.12)
        assert scatter[1, 1] == pytest.approx(predicted[node][1, 1], rel=0.25)  # the heading


def test_covariances_where_gravity_leaves_the_heading_free(truth: NDArray[np.float64]) -> None:
    """As in the limit of a prior that holds the heading of the first node: pairs do not change."""
    edges = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)])
    i, j = edges.T
    graph = rotavg.MeasurementGraph(edges, np.swapaxes(truth[i], 1, 2) @ truth[j])
    gravity = {k: (truth[k].T @ DOWN, 3.0) for k in range(4)}
    loose = rotavg.solve(graph, priors=Priors(gravity=gravity))
    pairs = [(0, 1), (3, 1)]
    free = loose.covariances(pairs, noise_variance=1)
    held = loose.covariances(noise_variance=1)
    assert abs(DOWN @ held[0] @ DOWN) < 1e-9  # the first node's heading is the reference
    # Without noise H = 4 (L x I + gravity's w (I - g g^T) at the diagonal), here by hand.
    L = np.zeros((4, 4))
    for a, b in edges:
        L[[a, b], [a, b]] += 1
        L[a, b] -= 1
        L[b, a] -= 1
    H = np.kron(L, np.eye(3)) + np.kron(3.0 * np.eye(4), np.eye(3) - np.outer(DOWN, DOWN))
    S = np.linalg.pinv(H, rcond=1e-10).reshape(4, 3, 4, 3)
    for (a, b), found in zip(pairs, free):
        expected = S[a, :, a] + S[b, :, b] - S[a, :, b] - S[b, :, a]
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("loss", ["huber", "l1", "auto", "tls"])
def test_noise_and_covariances_without_the_priors_that_are_wrong(loss: Loss) -> None:
    """As if they had not been given."""
    sigma, n, wrong = 0.01, 40, 12
    simulation = rotavg.simulate("erdos_renyi", n, density=0.2, noise=sigma, seed=3)
    rng = np.random.default_rng(2)
    T = simulation.ground_truth
    absolute = {
        k: (matrices_from_rotvecs(sigma * rng.normal(size=3)) @ T[k], 1.0) for k in range(n)
    }
    gravity = {k: (v, 1.0) for k, v in enumerate(downs(T, sigma))}
    right = Priors(
        absolute={k: absolute[k] for k in range(wrong, n)},
        gravity={k: gravity[k] for k in range(wrong, n)},
    )
    for k in range(wrong):
        absolute[k] = (matrices_from_rotvecs(rng.normal(size=3)) @ T[k], 1.0)
        gravity[k] = (rng.normal(size=3), 1.0)
    solution = rotavg.solve(
        simulation.graph, loss=loss, priors=Priors(absolute=absolute, gravity=gravity)
    )
    assert solution.robust is not None
    for fit in (solution.robust.absolute_priors, solution.robust.gravity_priors):
        assert fit is not None
        assert fit.nodes[fit.is_outlier].tolist()[:wrong] == list(range(wrong))
    without = rotavg.solve(simulation.graph, loss=loss, priors=right)
    assert estimated_noise_variance(solution) == pytest.approx(
        estimated_noise_variance(without), rel=0.15
    )
    spread, expected = solution.covariances(), without.covariances()
    assert np.trace(spread, axis1=1, axis2=2) == pytest.approx(
        np.trace(expected, axis1=1, axis2=2), rel=0.3
    )
    assert "absolute    1" in str(solution)


def test_degrees_of_freedom_are_the_rank_of_the_equations(truth: NDArray[np.float64]) -> None:
    """By rank of the matrix, of parts that outliers alone hold, too."""
    rng = np.random.default_rng(1)
    edges = np.array([(0, 1), (1, 2), (0, 2), (2, 3), (3, 4), (4, 5), (3, 5), (0, 3), (6, 7)])
    i, j = edges.T
    graph = rotavg.MeasurementGraph(edges, np.swapaxes(truth[i], 1, 2) @ truth[j])
    priors = Priors(
        fixed={1: truth[1]},
        absolute={k: (truth[k], 1.0) for k in (4, 2, 6)},
        gravity={k: (truth[k].T @ DOWN, 1.0) for k in (1, 3, 5, 6)},
    )
    grounded = ground(graph, priors)
    assert grounded is not None
    across = np.eye(3)[[0, 2]]  # a tilt
    for _ in range(60):
        trusted = [rng.random(size) < rng.uniform(0.2, 1) for size in (9, 3, 4)]
        rows: list[NDArray[np.float64]] = []
        for (a, b), holds in zip(edges, trusted[0]):
            row = np.zeros((3, 8, 3))
            row[:, a], row[:, b] = -np.eye(3), np.eye(3)
            rows += [row] if holds else []
        for node, holds in zip((2, 4, 6), trusted[1]):
            row = np.zeros((3, 8, 3))
            row[:, node] = np.eye(3)
            rows += [row] if holds else []
        for node, holds in zip((1, 3, 5, 6), trusted[2]):
            row = np.zeros((2, 8, 3))
            row[:, node] = across
            rows += [row] if holds and node != 1 else []  # node 1 is fixed
        A = np.concatenate([np.zeros((1, 8, 3)), *rows])
        A = np.delete(A, 1, axis=1).reshape(len(A), -1)
        holds = grounded.core.edges_where(*trusted)
        assert grounded.core.degrees_of_freedom(holds) == len(A) - 1 - np.linalg.matrix_rank(A)
