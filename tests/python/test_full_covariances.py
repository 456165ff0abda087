"""Certified averaging with full covariances: against definitions, restarts, an SDP, Monte Carlo."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from benchmarks.anisotropic_graphs import RATIOS, simulated, theory
from benchmarks.relaxation import accuracy, matrix_weights, relaxation
from random_graphs import graph_with_covariances
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.covariances import information

DATA = Path(os.environ.get("ROTAVG_DATA", Path(__file__).parents[3] / "shared" / "data"))


def objective(graph: rotavg.MeasurementGraph, R: NDArray[np.float64]) -> float:
    """Sum of 2 (tr M - tr(R_i R_ij M R_j^T)), M = tr(H) / 2 I - H."""
    M, (i, j) = matrix_weights(graph), graph.indices.T
    fit = np.einsum("kab,kbc,kcd,kad->k", R[i], graph.rotations, M, R[j])
    return float(np.sum(2 * (np.trace(M, axis1=1, axis2=2) - fit)))


def test_the_objective_is_as_defined_and_no_restart_is_lower() -> None:
    for seed in range(6):
        graph = graph_with_covariances(seed)
        solution = rotavg.solve(graph, anisotropic=True)
        assert solution.anisotropic == "chordal"
        assert solution.objective == pytest.approx(objective(graph, solution.rotations), rel=1e-9)
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved"
        assert "proved globally optimal" in str(solution)
        for start in range(5):
            other = rotavg.solve(graph, init="random", seed=start, method="bcd", anisotropic=True)
            assert other.objective >= solution.objective * (1 - 1e-9)
            assert other.certificate is not None
            bound = other.objective - other.certificate.gap
            assert bound <= solution.objective * (1 + 1e-9)


def test_certify_bounds_any_rotations() -> None:
    graph = graph_with_covariances(4, noise=0.3)
    best = rotavg.solve(graph, anisotropic=True)
    again = rotavg.certify(graph, best.rotations, anisotropic=True)
    assert again.verdict == "proved"
    rng = np.random.default_rng(0)
    for angle in (1e-6, 1e-2, 1.0):
        R = matrices_from_rotvecs(angle * rng.normal(size=(graph.num_nodes, 3))) @ best.rotations
        c = rotavg.certify(graph, R, anisotropic=True)
        assert objective(graph, R) - c.gap <= best.objective * (1 + 1e-9)
        # Without the covariances they are other rotations' gaps.
        assert c.gap != rotavg.certify(graph, R).gap


@pytest.mark.parametrize("part", range(4))
def test_no_bound_lies_above_the_relaxation(part: int) -> None:
    pytest.importorskip("clarabel", reason="no general solver to compare with: clarabel")
    proved = 0
    for seed in range(15 * part, 15 * part + 15):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 13))
        noise = float(rng.choice([0.05, 0.3, 0.6, 1.0]))
        graph, _ = simulated(rng, n, 0.5, RATIOS[seed % 4], noise)
        solution = rotavg.solve(graph, anisotropic=True, num_threads=1)
        c = solution.certificate
        assert c is not None
        optimum = relaxation(graph)
        # The rotations are feasible: by what lies above them the solver is off.
        slack = accuracy(graph, solution.objective) + max(0.0, optimum - solution.objective)
        assert solution.objective - c.gap <= optimum + slack, f"seed {seed}"
        if c.verdict == "proved":
            proved += 1
            assert optimum >= solution.objective - slack, f"seed {seed}"
    assert proved >= 8


def test_logarithms_are_told_apart() -> None:
    graph = graph_with_covariances(1)
    log = rotavg.solve(graph, anisotropic="log")
    assert log.certificate is None
    assert log.anisotropic == "log"
    assert log.isotropic is not None
    assert log.isotropic.anisotropic == "chordal"
    assert "not certified (where it started: proved globally optimal" in str(log)
    assert "logarithms" in str(log)
    chordal = rotavg.solve(graph, anisotropic=True)
    assert "full covariances, chords" in str(chordal)
    # Nearly the same where residuals are small.
    assert log.objective == pytest.approx(chordal.objective, rel=0.02)
    with pytest.raises(rotavg.OptionError, match="anisotropic is 'logs'"):
        rotavg.solve(graph, anisotropic="logs")  # type: ignore[arg-type]


@pytest.mark.parametrize("options", [{"method": "bcd"}, {"method": "sum"}, {"method": "newton"},
                                     {"method": "sum", "mu": "min_eigenvalue"},
                                     {"method": "staircase"}, {"method": "bcdsr"}])  # fmt: skip
def test_all_methods_meet_the_same_optimum(options: Any) -> None:
    graph = graph_with_covariances(2)
    best = rotavg.solve(graph, anisotropic=True)
    other = rotavg.solve(graph, anisotropic=True, **options)
    assert other.objective == pytest.approx(best.objective, rel=1e-9)
    assert other.certificate is not None
    assert other.certificate.verdict == "proved"


def wound(ratio: tuple[float, float, float], seed: int) -> tuple[Any, NDArray[np.float64]]:
    """A ring and rotations that wind around it once more than the truth."""
    n = 20
    graph, truth = simulated(np.random.default_rng(seed), n, 0.0, ratio, 0.1)
    assert graph.covariances is not None
    ring = rotavg.MeasurementGraph(
        [*graph.edges, (n - 1, 0)],
        np.concatenate([graph.rotations, (truth[n - 1].T @ truth[0])[None]]),
        covariances=np.concatenate([graph.covariances, graph.covariances[:1]]),
    )
    twist = np.outer(2 * np.pi * np.arange(n) / n, [0.36, 0.48, 0.8])
    return ring, matrices_from_rotvecs(twist) @ truth


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_staircase_unwinds_a_ring(ratio: tuple[float, float, float]) -> None:
    for seed in range(3):
        ring, twisted = wound(ratio, seed)
        best = rotavg.solve(ring, anisotropic=True)
        stuck = rotavg.solve(ring, anisotropic=True, init=twisted, method="newton")
        assert stuck.objective > 3 * best.objective
        for method in ("auto", "staircase"):
            solution = rotavg.solve(ring, anisotropic=True, init=twisted, method=method)
            assert solution.objective == pytest.approx(best.objective, rel=1e-9)
            assert solution.certificate is not None
            assert solution.certificate.verdict == "proved"
        assert "the staircase climbed to rank" in solution.reason
        assert solution.method == "staircase"


def test_a_staircase_never_does_worse_and_its_bound_is_one() -> None:
    refuted = bounded = 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        graph, _ = simulated(rng, 12, 0.3, RATIOS[1 + seed % 3], 0.6 + 0.2 * (seed % 4))
        without = rotavg.solve(graph, anisotropic=True, max_rank=0)
        solution = rotavg.solve(graph, anisotropic=True)
        assert solution.objective <= without.objective * (1 + 1e-12)
        c, before = solution.certificate, without.certificate
        assert c is not None
        assert before is not None
        assert c.gap <= before.gap * (1 + 1e-6)
        refuted += before.verdict != "proved"
        bounded += c.method == "relaxation"
        lowest = min(
            rotavg.solve(graph, anisotropic=True, init="random", seed=k, method="bcd").objective
            for k in range(5)
        )
        assert solution.objective - c.gap <= lowest * (1 + 1e-9)
    assert refuted > 0
    assert bounded > 0


def test_the_staircase_has_the_same_bits_for_any_threads() -> None:
    rng = np.random.default_rng(0)
    graph, _ = simulated(rng, 400, 0.4, (1, 3, 10), 0.3)
    assert graph.num_edges > 24576  # below, one thread does all
    one, three = (
        rotavg.solve(graph, anisotropic=True, method="staircase", init="random", num_threads=k)
        for k in (1, 3)
    )
    assert np.array_equal(one.rotations, three.rotations)
    assert one.certificate is not None
    assert three.certificate is not None
    assert one.certificate.gap == three.certificate.gap


def test_components_and_robust_losses() -> None:
    one, other = graph_with_covariances(1), graph_with_covariances(2, n=6)
    assert one.covariances is not None
    assert other.covariances is not None
    both = rotavg.MeasurementGraph(
        np.concatenate([one.indices, other.indices + 10]),
        np.concatenate([one.rotations, other.rotations]),
        covariances=np.concatenate([one.covariances, other.covariances]),
    )
    solution = rotavg.solve(both, anisotropic=True)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    parts = [rotavg.solve(graph, anisotropic=True) for graph in (one, other)]
    assert solution.objective == pytest.approx(sum(p.objective for p in parts), rel=1e-9)
    np.testing.assert_allclose(solution.rotations[10:], parts[1].rotations, atol=1e-7)
    # An outlier.
    rotations = one.rotations.copy()
    rotations[3] = rotations[3] @ matrices_from_rotvecs(np.array([[2.0, 0, 0]]))[0]
    bad = rotavg.MeasurementGraph(one.edges, rotations, covariances=one.covariances)
    robust = rotavg.solve(bad, anisotropic=True, loss="cauchy")
    assert robust.is_outlier[3]
    assert robust.certificate is not None
    assert robust.certificate.verdict == "proved"
    assert "of the least squares on the edges it kept" in str(robust)
    error = rotavg.compare(robust.rotations, parts[0].rotations).angles
    plain = rotavg.compare(rotavg.solve(bad).rotations, parts[0].rotations).angles
    assert error.max() < 0.5 * plain.max()
    assert np.isfinite(robust.covariances()).all()


def test_fixed_and_absolute_priors() -> None:
    graph = graph_with_covariances(3)
    free = rotavg.solve(graph, anisotropic=True)
    rng = np.random.default_rng(1)
    turn, known = matrices_from_rotvecs(rng.normal(size=(2, 3)))
    w = 30.0
    priors = rotavg.Priors(fixed={0: turn, 4: turn @ free.rotations[4]}, absolute={2: (known, w)})
    solution = rotavg.solve(graph, anisotropic=True, priors=priors)
    np.testing.assert_allclose(solution.rotations[0], turn, atol=1e-15)
    R = solution.rotations
    assert solution.certificate is not None
    gap = solution.certificate.gap

    def f(R: NDArray[np.float64]) -> float:
        return objective(graph, R) + w / 2 * float(np.sum((known - R[2]) ** 2))

    assert solution.objective == pytest.approx(f(R), rel=1e-9)
    for _ in range(100):
        e = matrices_from_rotvecs(10 ** rng.uniform(-4, 0) * rng.normal(size=(10, 3)))
        e[[0, 4]] = np.eye(3)
        assert f(e @ R) >= f(R) - gap - 1e-9 * f(R)


def test_the_error_falls_by_the_factor_that_theory_predicts() -> None:
    runs = 500
    rng = np.random.default_rng(7)
    graph, truth = simulated(rng, 10, 0.5, (1, 1, 100), 0.01)
    assert graph.covariances is not None
    i, j = graph.indices.T
    exact = np.swapaxes(truth[i], 1, 2) @ truth[j]
    root = np.linalg.cholesky(graph.covariances)
    squares = np.zeros(2)
    for _ in range(runs):
        e = np.einsum("kab,kb->ka", root, rng.normal(size=(len(i), 3)))
        noisy = rotavg.MeasurementGraph(
            graph.edges, exact @ matrices_from_rotvecs(e), covariances=graph.covariances
        )
        for k, anisotropic in enumerate((False, True)):
            R = rotavg.solve(noisy, anisotropic=anisotropic, certify=False, num_threads=1).rotations
            E = R @ np.swapaxes(truth, 1, 2) @ truth[0]
            squares[k] += np.sum((E - np.eye(3)) ** 2)
    predicted = theory(graph, truth)
    assert predicted[1] < 0.5 * predicted[0]
    assert squares[1] / squares[0] == pytest.approx(predicted[1] / predicted[0], rel=0.1)


@pytest.mark.parametrize("anisotropic", [True, "log"])
def test_a_saddle_has_no_covariances(anisotropic: Any) -> None:
    edges, turn = [(0, 1), (1, 2), (2, 0)], np.diag([-1.0, -1.0, 1.0])
    spread = np.tile(0.01 * np.eye(3), (3, 1, 1))
    graph = rotavg.MeasurementGraph(edges, np.tile(np.eye(3), (3, 1, 1)), covariances=spread)
    start = [np.eye(3), turn, np.eye(3)]
    solution = rotavg.solve(graph, init=start, anisotropic=anisotropic, max_iterations=0)
    with pytest.raises(rotavg.SolverError, match="no strict minimum"):
        solution.covariances(noise_variance=1.0)


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1e200, 1e305])
def test_extreme_covariances_are_named(size: float) -> None:
    graph = graph_with_covariances(1)
    assert graph.covariances is not None
    C = graph.covariances.copy()
    C[2] = size * np.eye(3)
    weighted = rotavg.MeasurementGraph(
        graph.edges, graph.rotations, weights=np.ones(len(C)), covariances=C
    )
    i, j = graph.edges[2].tolist()
    says = (
        rf"edge 2 \({i} -> {j}\): found a covariance whose largest entry is .*; expected it between"
    )
    for anisotropic in (True, "log"):
        with pytest.raises(rotavg.GraphError, match=says):
            rotavg.solve(weighted, anisotropic=anisotropic)
    with pytest.raises(rotavg.GraphError, match=says):
        rotavg.certify(weighted, graph.rotations[:1].repeat(10, axis=0), anisotropic=True)
    with pytest.raises(rotavg.GraphError, match=r"edge 2 .*found the weight"):
        rotavg.MeasurementGraph(graph.edges, graph.rotations, covariances=C)


@pytest.mark.parametrize("spread", [0.0, 1.0, 3.0, 6.0, 10.0])
def test_precisions_are_the_inverses(spread: float) -> None:
    rng = np.random.default_rng(int(spread))
    V = np.linalg.qr(rng.normal(size=(500, 3, 3)))[0]
    values = 10.0 ** rng.uniform(-spread, 0, (500, 3)) * 10.0 ** rng.uniform(-40, 40, (500, 1))
    C = V @ (values[:, :, None] * np.swapaxes(V, 1, 2))
    C = (C + np.swapaxes(C, 1, 2)) / 2
    H = information(C, np.full(500, 3.0))
    assert np.array_equal(H, np.swapaxes(H, 1, 2))
    scale = np.abs(H).max(axis=(1, 2)) * np.abs(C).max(axis=(1, 2))
    error = np.abs(C @ H - 3 * np.eye(3)).max(axis=(1, 2))
    assert (error <= 1e-12 * scale).all()


def test_single_precision_and_parallel_edges() -> None:
    graph = graph_with_covariances(1)
    assert graph.covariances is not None
    single = rotavg.MeasurementGraph(
        graph.edges.astype(np.int32),
        graph.rotations.astype(np.float32),
        covariances=graph.covariances.astype(np.float32),
    )
    expected = rotavg.solve(graph, anisotropic=True)
    solution = rotavg.solve(single, anisotropic=True)
    assert solution.objective == pytest.approx(expected.objective, rel=1e-4)
    # Each edge twice, once turned round, with half of what it knows.
    R, C = graph.rotations, 2 * graph.covariances
    twice = rotavg.MeasurementGraph(
        np.concatenate([graph.edges, graph.edges[:, ::-1]]),
        np.concatenate([R, np.swapaxes(R, 1, 2)]),
        covariances=np.concatenate([C, R @ C @ np.swapaxes(R, 1, 2)]),
        nodes=graph.nodes,
    )
    for method in ("auto", "staircase"):
        both = rotavg.solve(twice, anisotropic=True, method=method)
        assert both.objective == pytest.approx(expected.objective, rel=1e-9)
        assert both.certificate is not None
        assert both.certificate.verdict == "proved"


def test_lu_sphinx_is_proved_and_nearer_the_truth() -> None:
    path = DATA / "viewgraphs" / "lu_sphinx.npz"
    if not path.exists():
        pytest.skip(f"no {path}")
    d = np.load(path)
    spread = np.linalg.inv((d["precision"] + np.swapaxes(d["precision"], 1, 2)) / 2)
    spread = (spread + np.swapaxes(spread, 1, 2)) / 2
    graph = rotavg.MeasurementGraph(
        d["edges"], d["rotations"], covariances=spread, nodes=range(len(d["ground_truth"]))
    )
    known = d["has_ground_truth"]
    solution = rotavg.solve(graph, loss="auto", anisotropic=True)
    angles = rotavg.compare(solution.rotations[known], d["ground_truth"][known]).angles
    assert np.degrees(angles.mean()) <= 0.28
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
