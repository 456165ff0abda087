"""The certificate: true bounds, and wrong answers refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs

Array = NDArray[np.float64]


def dense_certificate_matrix(graph: rotavg.MeasurementGraph, R: Array) -> Array:
    """S = Lambda - Rt of Theorem 1, block by block from the definition, Lambda symmetrised."""
    n = graph.num_nodes
    Rt = np.zeros((n, n, 3, 3))
    for (i, j), R_ij, w in zip(graph.indices, graph.rotations, graph.weights):
        Rt[i, j] += w * R_ij
        Rt[j, i] += w * R_ij.T
    S = -Rt.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)
    for i in range(n):
        block = sum(Rt[i, j] @ R[j].T @ R[i] for j in range(n))
        S[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += 0.5 * (block + block.T)
    return S


def turned(R: Array, angle: float, rng: np.random.Generator) -> Array:
    """Every rotation turned by about `angle` radians."""
    from rotavg.graph.conventions import matrices_from_rotvecs

    return matrices_from_rotvecs(angle * rng.standard_normal((len(R), 3))) @ R


# i, j, rotation vector of R_ij, weight; and rotation vectors: here an iteration that does not renew
# the images of its vectors drifts off and ends at a positive eigenvalue.
SLOW_EDGES = [
    (1, 0, (-0.933, 2.543, 1.088), 0.046),
    (2, 0, (0.113, 0.717, -3.013), 0.005),
    (1, 3, (0.646, -1.371, 2.202), 0.079),
    (4, 0, (-1.852, 2.241, 0.899), 29.83),
    (5, 1, (1.038, -2.638, -0.083), 9.281),
    (3, 6, (0.835, 1.792, 0.9), 1.625),
    (2, 7, (0.161, -2.293, 1.734), 0.107),
    (8, 2, (-0.273, 2.296, 0.771), 1.882),
    (9, 8, (-0.691, -1.288, -2.632), 1.44),
    (4, 3, (0.003, 0.717, 3.009), 140.6),
    (6, 1, (0.589, -0.332, -2.266), 2.888),
    (9, 0, (2.088, 0.139, 1.075), 598.1),
    (9, 7, (1.526, 0.07, 1.889), 0.001),
]
SLOW_ROTATIONS = [
    (0.001, -0.01, 0.064),
    (-0.444, -0.982, -1.823),
    (-0.54, -1.791, -1.167),
    (-1.69, -1.408, 0.336),
    (1.764, -2.264, -1.044),
    (1.124, 1.684, -1.407),
    (-0.99, 0.661, -0.101),
    (2.148, 0.862, -1.093),
    (0.661, 1.808, 0.047),
    (-2.333, -0.171, -1.172),
]


def test_lambda_min_where_the_iteration_is_slow() -> None:
    from rotavg.graph.conventions import matrices_from_rotvecs

    i, j, rotvecs, weights = zip(*SLOW_EDGES)
    graph = rotavg.MeasurementGraph.from_rotvecs(
        np.column_stack([i, j]), np.array(rotvecs), weights=weights, nodes=range(10)
    )
    R = matrices_from_rotvecs(np.array(SLOW_ROTATIONS))
    smallest = np.linalg.eigvalsh(dense_certificate_matrix(graph, R))[0]
    assert smallest == pytest.approx(-17.98, abs=0.01)
    assert rotavg.certify(graph, R).lambda_min == pytest.approx(smallest, rel=1e-6)


@pytest.mark.parametrize("seed", range(50))
def test_lambda_min_and_gap_agree_with_a_dense_eigendecomposition(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 15))
    graph = rotavg.simulate(
        "erdos_renyi", n, density=0.6, noise=float(rng.uniform(0, 1)), seed=seed
    ).graph
    graph = graph.with_weights(10 ** rng.uniform(-1, 1, graph.num_edges))
    optimum = rotavg.solve(graph)
    for angle in (0.0, 1e-6, 1e-3, 0.3, 3.0):
        R = optimum.rotations if angle == 0 else turned(optimum.rotations, angle, rng)
        certificate = rotavg.certify(graph, R)
        eigenvalues = np.linalg.eigvalsh(dense_certificate_matrix(graph, R))
        scale = np.abs(eigenvalues).max()
        assert certificate.lambda_min == pytest.approx(eigenvalues[0], abs=1e-9 * scale), angle
        # The gap is never better than the truth, and never worse than the plain bound.
        f = rotavg.objective(graph, R)
        assert f - certificate.gap <= optimum.objective * (1 + 1e-9) + 1e-12
        plain = 3 * n * max(0.0, -eigenvalues[0])
        assert certificate.gap <= 1.01 * plain + 1e-9 * scale
        assert (certificate.verdict == "proved") == (certificate.relative_gap <= 1e-6)


def test_a_full_extra_twist_around_a_cycle_is_refuted() -> None:
    # n = 20 identical frames, measured without noise; turning each by 2 pi / n more than the last
    # closes the cycle again. All residuals are alike, so the gradient is zero: a local minimum.
    n = 20
    edges = [(i, (i + 1) % n) for i in range(n)]
    graph = rotavg.MeasurementGraph(edges, np.tile(np.eye(3), (n, 1, 1)))
    angle = 2 * np.pi / n * np.arange(n)
    twisted = np.tile(np.eye(3), (n, 1, 1))
    twisted[:, 0, 0] = twisted[:, 1, 1] = np.cos(angle)
    twisted[:, 1, 0], twisted[:, 0, 1] = np.sin(angle), -np.sin(angle)
    assert np.abs(rotavg.gradient(graph, twisted)).max() < 1e-14

    certificate = rotavg.certify(graph, twisted)
    assert certificate.verdict == "not_certified"
    eigenvalue = np.linalg.eigvalsh(dense_certificate_matrix(graph, twisted))[0]
    assert eigenvalue < -0.05
    assert certificate.lambda_min == pytest.approx(eigenvalue, rel=1e-9)
    assert certificate.gap >= rotavg.objective(graph, twisted) * (1 - 1e-12)

    # A descent method stays there, and says that the answer is not certified.
    stuck = rotavg.solve(graph, init=twisted, method="newton")
    assert stuck.status.converged
    assert not stuck.solved
    # The staircase leads out.
    free = rotavg.solve(graph, init=twisted)
    assert free.solved
    assert free.objective < 1e-20
    assert "not certified" in str(stuck)
    assert rotavg.solve(graph).certificate.verdict == "proved"  # type: ignore[union-attr]


@pytest.mark.parametrize("distance", [1e-2, 1e-3, 1e-4])
def test_points_near_the_optimum_are_not_proved_beyond_the_tolerance(distance: float) -> None:
    rng = np.random.default_rng(1)
    graph = rotavg.simulate("sphere", 400, noise=0.1, seed=1).graph
    optimum = rotavg.solve(graph)
    R = turned(optimum.rotations, distance, rng)
    excess = rotavg.objective(graph, R) - optimum.objective
    certificate = rotavg.certify(graph, R)
    assert certificate.gap >= excess
    if excess > 1e-6 * optimum.objective:
        assert certificate.verdict == "not_certified"


def test_the_tolerance_is_the_users() -> None:
    graph = rotavg.simulate("sphere", 400, noise=0.1, seed=1).graph
    early = rotavg.solve(graph, method="bcd", max_iterations=60)
    assert early.certificate is not None
    gap = early.certificate.relative_gap
    assert rotavg.certify(graph, early.rotations, tolerance=1.01 * gap).verdict == "proved"
    assert rotavg.certify(graph, early.rotations, tolerance=0.99 * gap).verdict == "not_certified"


def test_the_certificate_does_not_depend_on_the_gauge_or_on_who_found_the_rotations() -> None:
    simulation = rotavg.simulate("complete", 15, noise=0.3, seed=3)
    R = rotavg.solve(simulation.graph).rotations
    assert rotavg.certify(simulation.graph, simulation.ground_truth[4] @ R).verdict == "proved"
    assert rotavg.certify(simulation.graph, simulation.ground_truth).verdict == "not_certified"


def test_a_time_limit_leaves_the_verdict_open() -> None:
    graph = rotavg.simulate("sphere", 900, noise=0.1, seed=1).graph
    R = rotavg.solve(graph, certify=False).rotations
    certificate = rotavg.certify(graph, R, time_limit=0.0)
    assert certificate.verdict == "not_certified"
    assert np.isnan(certificate.lambda_min)
    assert certificate.gap == pytest.approx(rotavg.objective(graph, R), rel=1e-12)


def test_a_fit_without_residuals_is_proved_without_any_work() -> None:
    graph = rotavg.simulate("sphere", 900, seed=1).graph
    certificate = rotavg.certify(graph, rotavg.solve(graph).rotations, time_limit=0.0)
    assert certificate.verdict == "proved"
    assert certificate.method == "nonnegativity"


def test_what_is_not_a_rotation_is_refused() -> None:
    graph = rotavg.simulate("cycle", 4).graph
    with pytest.raises(rotavg.GraphError, match="node 0 is not a rotation"):
        rotavg.certify(graph, -np.tile(np.eye(3), (4, 1, 1)))


def test_solutions_and_dicts_have_rotations_by_id() -> None:
    graph = rotavg.simulate("erdos_renyi", 20, density=0.4, noise=0.1, seed=1).graph
    solution = rotavg.solve(graph)
    other = rotavg.MeasurementGraph(graph.edges, graph.rotations, nodes=graph.nodes[::-1])
    for rotations in (solution, dict(solution.items())):
        assert rotavg.certify(other, rotations).verdict == "proved"
        assert np.abs(rotavg.gradient(other, rotations)).max() < 1e-6
        assert rotavg.objective(other, rotations) == pytest.approx(solution.objective)
    assert rotavg.certify(other, solution.rotations).verdict != "proved"
    with pytest.raises(rotavg.GraphError, match="there is none of node 19"):
        rotavg.certify(other, {0: np.eye(3)})


@pytest.mark.parametrize("ratio", [1e-9, 1e-6, 1e6, 1e9, 1e12])
def test_a_fit_without_residuals_is_proved_however_weights_differ(ratio: float) -> None:
    rng = np.random.default_rng(3)
    truth = matrices_from_rotvecs(rng.normal(size=(7, 3)))
    edges = np.array([(0, 1), (1, 2), (2, 0), (2, 3), (3, 4), (4, 5), (5, 3), (5, 6)])
    rotations = np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]]
    for heavy in range(len(edges)):
        weights = np.ones(len(edges))
        weights[heavy] = ratio
        solution = rotavg.solve(rotavg.MeasurementGraph(edges, rotations, weights))
        assert solution.verdict == "proved", (heavy, solution.certificate)
    path = rotavg.MeasurementGraph(edges[:2], rotations[:2], [ratio, ratio**-0.5])  # 1e18 apart
    assert rotavg.solve(path).verdict == "proved"
    graph = rotavg.MeasurementGraph(edges, rotations)
    for loss in ("auto", "tls", "huber"):
        assert rotavg.solve(graph, loss=loss, excluded=[(2, 3)]).verdict == "proved"
