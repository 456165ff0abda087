"""The refinement on logarithms against finite differences and Monte Carlo; graphs' covariances."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.solving.uncertainty import estimated_noise_variance

EDGES = np.array([(k, (k + 1) % 6) for k in range(6)] + [(0, 3), (1, 4), (1, 5)])


def covariances(rng: np.random.Generator, sigma: float) -> NDArray[np.float64]:
    """One direction is much worse than the others."""
    axes = Rotation.random(len(EDGES), random_state=rng.integers(2**31)).as_matrix()
    return axes @ np.diag([25.0, 1.0, 1.0]) @ np.swapaxes(axes, 1, 2) * sigma**2


def measured(
    rng: np.random.Generator, truth: NDArray[np.float64], C: NDArray[np.float64]
) -> rotavg.MeasurementGraph:
    i, j = EDGES.T
    noise = np.einsum("kab,kb->ka", np.linalg.cholesky(C), rng.normal(size=(len(EDGES), 3)))
    rotations = np.swapaxes(truth[i], 1, 2) @ truth[j] @ matrices_from_rotvecs(noise)
    return rotavg.MeasurementGraph(EDGES, rotations, covariances=C)


def objective(graph: rotavg.MeasurementGraph, R: NDArray[np.float64]) -> float:
    """From its definition, by SciPy's logarithm."""
    assert graph.covariances is not None
    i, j = graph.indices.T
    E = np.swapaxes(R[i] @ graph.rotations, 1, 2) @ R[j]
    r = Rotation.from_matrix(E).as_rotvec()
    return float(np.einsum("ka,kab,kb->", r, np.linalg.inv(graph.covariances), r))


@pytest.fixture
def truth() -> NDArray[np.float64]:
    R = matrices_from_rotvecs(np.random.default_rng(3).normal(size=(6, 3)))
    return R[0].T @ R


def test_it_ends_at_a_minimum_of_the_objective(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(1)
    graph = measured(rng, truth, covariances(rng, 0.1))
    solution = rotavg.solve(graph, anisotropic="log")
    f = objective(graph, solution.rotations)
    assert solution.objective == pytest.approx(f, rel=1e-12)
    assert solution.status.converged
    plain = rotavg.solve(graph)
    assert f < 0.9 * objective(graph, plain.rotations)
    assert solution.isotropic is not None  # the chords' optimum
    assert f <= objective(graph, solution.isotropic.rotations)
    h = 1e-5
    for node in range(6):
        for axis in np.eye(3):
            w = np.zeros((6, 3))
            w[node] = h * axis
            up = objective(graph, matrices_from_rotvecs(w) @ solution.rotations)
            down = objective(graph, matrices_from_rotvecs(-w) @ solution.rotations)
            curvature = (up + down - 2 * f) / h**2
            assert curvature > 0
            assert abs(up - down) / (2 * h) < 1e-6 * curvature  # radians from the minimum


def test_it_has_no_certificate_and_says_so(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(1)
    graph = measured(rng, truth, covariances(rng, 0.1))
    solution = rotavg.solve(graph, anisotropic="log")
    assert solution.certificate is None
    assert solution.isotropic is not None
    assert solution.isotropic.certificate is not None
    assert "locally optimal, not certified (where it started: proved" in str(solution)


def test_isotropic_covariances_change_little(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(2)
    graph = measured(rng, truth, np.tile(np.eye(3) * 1e-4, (len(EDGES), 1, 1)))
    np.testing.assert_allclose(graph.weights, 1e4)
    solution = rotavg.solve(graph, anisotropic="log")
    assert solution.isotropic is not None
    plain = rotavg.solve(graph)
    for one in (solution, solution.isotropic):
        np.testing.assert_allclose(one.rotations, plain.rotations, atol=1e-5)
        assert one.objective == pytest.approx(plain.objective / 2, rel=1e-3)
        np.testing.assert_allclose(
            one.covariances(noise_variance=1), plain.covariances(noise_variance=1), atol=2e-7
        )


def test_monte_carlo_agrees_and_is_better_than_isotropic(truth: NDArray[np.float64]) -> None:
    runs = 500
    rng = np.random.default_rng(7)
    C = covariances(rng, 0.005)
    errors, plain = np.empty((2, runs, 6, 3))
    variances = np.empty(runs)
    for k in range(runs):
        graph = measured(rng, truth, C)
        solution = rotavg.solve(graph, anisotropic="log", certify=False, num_threads=1)
        scalar = rotavg.solve(graph, certify=False, num_threads=1)
        for rows, R in ((errors, solution.rotations), (plain, scalar.rotations)):
            E = R @ np.swapaxes(truth, 1, 2)
            rows[k] = np.stack([E[:, 2, 1], E[:, 0, 2], E[:, 1, 0]], axis=1)
        variances[k] = estimated_noise_variance(solution)
    assert variances.mean() == pytest.approx(1, rel=0.06)
    predicted = solution.covariances(noise_variance=1)
    for node in range(1, 6):
        scatter = errors[:, node].T @ errors[:, node] / runs
        assert np.trace(scatter) == pytest.approx(np.trace(predicted[node]), rel=0.12)
    assert np.sum(errors**2) < 0.7 * np.sum(plain**2)


def test_both_families_say_the_same(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(4)
    graph = measured(rng, truth, covariances(rng, 0.05))
    assert graph.covariances is not None
    R = graph.rotations
    # R_ji = R_ij^T, whose noise in the frame of i is that of R_ij turned there.
    seen = R @ graph.covariances @ np.swapaxes(R, 1, 2)
    again = rotavg.MeasurementGraph(
        EDGES, np.swapaxes(R, 1, 2), convention="vision", covariances=seen
    )
    assert again.covariances is not None
    np.testing.assert_allclose(again.covariances, graph.covariances, atol=1e-15)


def test_graphs_keep_their_covariances(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(4)
    graph = measured(rng, truth, covariances(rng, 0.05))
    assert graph.covariances is not None
    for copy in (pickle.loads(pickle.dumps(graph)), graph.with_weights(np.ones(len(EDGES)))):
        assert np.array_equal(copy.covariances, graph.covariances)
    part = graph.subgraph([1, 4, 5])
    assert part.covariances is not None
    kept = [k for k, (i, j) in enumerate(EDGES) if {i, j} <= {1, 4, 5}]
    assert np.array_equal(part.covariances, graph.covariances[kept])


def test_two_components_and_a_robust_loss(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(4)
    one = measured(rng, truth, covariances(rng, 0.05))
    assert one.covariances is not None
    both = rotavg.MeasurementGraph(
        np.concatenate([EDGES, EDGES + 10]),
        np.tile(one.rotations, (2, 1, 1)),
        covariances=np.tile(one.covariances, (2, 1, 1)),
        nodes=range(17),
    )
    solution = rotavg.solve(both, anisotropic="log")
    alone = rotavg.solve(one, anisotropic="log").rotations
    np.testing.assert_allclose(solution.rotations[:6], alone, atol=1e-9)
    np.testing.assert_allclose(solution.rotations[10:16], alone, atol=1e-9)
    assert np.array_equal(solution.rotations[6], np.eye(3))
    robust = rotavg.solve(both, anisotropic="log", loss="huber")
    assert robust.status.converged
    assert np.isfinite(robust.covariances()).all()


def test_bad_requests_say_what_is_wrong(truth: NDArray[np.float64]) -> None:
    rotations = np.tile(np.eye(3), (9, 1, 1))
    C = np.tile(np.eye(3), (9, 1, 1))
    C[4, 2, 2] = -1
    with pytest.raises(rotavg.GraphError, match=r"edge 4 \(4 -> 5\).*not positive definite"):
        rotavg.MeasurementGraph(EDGES, rotations, covariances=C)
    C[4, 2, 2] = np.nan
    with pytest.raises(rotavg.GraphError, match=r"edge 4 .*NaN"):
        rotavg.MeasurementGraph(EDGES, rotations, covariances=C)
    with pytest.raises(rotavg.GraphError, match=r"covariances have shape \(3, 3\)"):
        rotavg.MeasurementGraph(EDGES, rotations, covariances=np.eye(3))
    plain = rotavg.MeasurementGraph(EDGES, rotations)
    with pytest.raises(rotavg.OptionError, match="needs a graph with covariances"):
        rotavg.solve(plain, anisotropic="log")


W = 40.0  # of priors


def with_priors(
    seed: int, truth: NDArray[np.float64]
) -> tuple[rotavg.MeasurementGraph, dict[str, Any]]:
    """Priors of every kind that contradict the measurements a little."""
    rng = np.random.default_rng(seed)
    graph = measured(rng, truth, covariances(rng, 0.1))

    def off(k: int) -> NDArray[np.float64]:
        noise = matrices_from_rotvecs(0.2 * rng.normal(size=(1, 3)))[0]
        return np.asarray(noise @ truth[k])

    down = np.array([0.0, 1.0, 0.0])
    gravity = {k: (off(k).T @ down, W) for k in (1, 2, 4)}
    return graph, {
        "fixed": {"fixed": {0: truth[0], 3: off(3)}},
        "absolute": {"absolute": {1: (off(1), W), 4: (off(4), W)}},
        "gravity": {"gravity": gravity},
        "all": {"fixed": {0: truth[0]}, "absolute": {3: (off(3), W)}, "gravity": gravity,
                "rigs": {4: (0, np.eye(3)), 5: (0, truth[4].T @ off(5))}},
    }  # fmt: skip


def prior_objective(
    graph: rotavg.MeasurementGraph, priors: rotavg.Priors, R: NDArray[np.float64]
) -> float:
    """From its definition: a prior of weight w has the precision u w."""
    assert graph.covariances is not None
    u = np.median(3 / (graph.weights * np.trace(graph.covariances, axis1=1, axis2=2)))
    f = objective(graph, R)
    for node, (known, w) in priors.absolute.items():
        f += u * w * Rotation.from_matrix(np.asarray(known).T @ R[node]).magnitude() ** 2
    for node, (d, w) in priors.gravity.items():
        f += u * w * np.arccos(np.clip((R[node] @ d) @ [0.0, 1.0, 0.0], -1, 1)) ** 2
    return f


@pytest.mark.parametrize("kind", ["fixed", "absolute", "gravity", "all"])
def test_priors_of_every_kind_go_with_logarithms(kind: str, truth: NDArray[np.float64]) -> None:
    for seed in range(3):
        graph, known = with_priors(seed, truth)
        priors = rotavg.Priors(**known[kind], down=[0.0, 1.0, 0.0])
        solution = rotavg.solve(graph, anisotropic="log", priors=priors)
        assert solution.status.converged
        assert solution.certificate is None
        assert solution.isotropic is not None
        assert solution.isotropic.certificate is not None  # the chords', which has one
        R = solution.rotations
        f = prior_objective(graph, priors, R)
        assert solution.objective == pytest.approx(f, rel=1e-9)
        assert f <= prior_objective(graph, priors, solution.isotropic.rotations) * (1 + 1e-12)
        for node, value in priors.fixed.items():
            np.testing.assert_allclose(R[node], np.asarray(value), atol=1e-12)
        # No step of what is free goes down.
        ties = [[k] for k in range(6) if k not in priors.fixed]
        if priors.rigs:
            ties = [[k] for k in (1, 2, 3)] + [[4, 5]]
        h = 1e-5
        for nodes in ties:
            for axis in np.eye(3):
                w = np.zeros((6, 3))
                w[nodes] = h * axis
                up = prior_objective(graph, priors, matrices_from_rotvecs(w) @ R)
                back = prior_objective(graph, priors, matrices_from_rotvecs(-w) @ R)
                curvature = (up + back - 2 * f) / h**2
                assert abs(up - back) / (2 * h) < 1e-5 * curvature
        costs = rotavg.diagnose(solution)
        assert np.isfinite(solution.covariances(noise_variance=1)).all()
        assert costs is not None


def test_g2o_holds_covariances(tmp_path: Path) -> None:
    path = tmp_path / "g.g2o"
    translation = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0"
    lines = [
        f"EDGE_SE3:QUAT {i} {j} 0 0 0 0.1 0 {k / 50} 1 {translation} 4 1 0 3 0 2"
        for k, (i, j) in enumerate([(0, 1), (1, 2), (2, 0)])
    ]
    path.write_text("\n".join(lines))
    graph = rotavg.read(path)
    omega = np.array([[4, 1, 0], [1, 3, 0], [0, 0, 2]])
    assert graph.covariances is not None
    np.testing.assert_allclose(graph.covariances[1], np.linalg.inv(omega), atol=1e-15)
    assert rotavg.read(path, unit_weights=True).covariances is None
    command = [sys.executable, "-m", "rotavg", "solve", str(path), "--anisotropic-log"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "locally optimal, not certified" in done.stdout
    refused = subprocess.run([*command, "--unit-weights"], capture_output=True, check=False)
    assert refused.returncode == 2
