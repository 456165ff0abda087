"""Covariances against Monte Carlo, known cases and themselves in other gauges."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg import _core
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.solving.uncertainty import estimated_noise_variance

RING = [(k, (k + 1) % 6) for k in range(6)] + [(0, 3), (1, 4), (1, 5)]
WEIGHTS = np.array([1, 2, 0.5, 1, 3, 1, 1, 0.4, 2])
# Axis times angle of small rotations, from the matrix's skew part: exact to the third order.
LOG = ([2, 0, 1], [1, 2, 0])


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rotavg", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def small_rotvecs(R: NDArray[np.float64]) -> NDArray[np.float64]:
    return (R[..., LOG[0], LOG[1]] - R[..., LOG[1], LOG[0]]) / 2


def measured(
    rng: np.random.Generator, truth: NDArray[np.float64], sigma: float
) -> rotavg.MeasurementGraph:
    """The ring's rotations with isotropic Gaussian noise of the variance sigma^2 / weight."""
    i, j = np.array(RING).T
    noise = rng.normal(size=(len(RING), 3)) * (sigma / np.sqrt(WEIGHTS))[:, None]
    exact = np.swapaxes(truth[i], 1, 2) @ truth[j]
    return rotavg.MeasurementGraph(RING, exact @ matrices_from_rotvecs(noise), WEIGHTS)


@pytest.fixture
def truth() -> NDArray[np.float64]:
    R = matrices_from_rotvecs(np.random.default_rng(3).normal(size=(6, 3)))
    return R[0].T @ R


def test_covariances_predict_monte_carlo(truth: NDArray[np.float64]) -> None:
    runs, sigma = 500, 0.02
    rng = np.random.default_rng(1)
    errors = np.empty((runs, 6, 3))
    variances = np.empty(runs)
    for k in range(runs):
        solution = rotavg.solve(measured(rng, truth, sigma), certify=False, num_threads=1)
        errors[k] = small_rotvecs(solution.rotations @ np.swapaxes(truth, 1, 2))
        variances[k] = estimated_noise_variance(solution)
    assert variances.mean() == pytest.approx(sigma**2, rel=0.05)
    predicted = solution.covariances(noise_variance=sigma**2)
    for node in range(1, 6):
        scatter = errors[:, node].T @ errors[:, node] / runs
        assert np.trace(scatter) == pytest.approx(np.trace(predicted[node]), rel=0.1)
        assert np.abs(scatter - predicted[node]).max() < 0.2 * np.trace(predicted[node]) / 3
    between = errors[:, 4] - errors[:, 2]
    pair = solution.covariances([(2, 4)], noise_variance=sigma**2)[0]
    assert np.trace(between.T @ between) / runs == pytest.approx(np.trace(pair), rel=0.1)


def test_pairs_do_not_depend_on_the_gauge(truth: NDArray[np.float64]) -> None:
    graph = measured(np.random.default_rng(5), truth, 0.1)
    pairs = [(0, 1), (2, 5), (4, 3), (1, 1)]
    here = rotavg.solve(graph, tolerance=1e-12)
    other = rotavg.MeasurementGraph(RING, graph.rotations, WEIGHTS, nodes=[4, 2, 0, 1, 5, 3])
    there = rotavg.solve(other, tolerance=1e-12)
    scale = np.abs(here.covariances()).max()
    seen = here.covariances(pairs, frame="node")
    np.testing.assert_allclose(there.covariances(pairs, frame="node"), seen, atol=1e-7 * scale)
    assert not seen[3].any()
    turn = here[4].T  # from the one world to the other
    np.testing.assert_allclose(
        there.covariances(pairs), turn @ here.covariances(pairs) @ turn.T, atol=1e-7 * scale
    )
    gauge = here.covariances([(0, k) for k in range(6)])
    np.testing.assert_allclose(gauge, here.covariances(), rtol=1e-12)


def test_noise_variance_scales_and_weights_may_be_inverse_variances() -> None:
    graph = rotavg.MeasurementGraph([("a", "b"), ("b", "c")], [np.eye(3)] * 2, [4.0, 2.0])
    solution = rotavg.solve(graph)
    expected = np.array([0, 1 / 4, 1 / 4 + 1 / 2])[:, None, None] * np.eye(3)
    np.testing.assert_allclose(solution.covariances(noise_variance=1), expected, atol=1e-15)
    with pytest.raises(rotavg.SolverError, match=r"no cycles.*give noise_variance"):
        solution.covariances()


def test_the_uncertainty_is_printed_once_it_is_known(truth: NDArray[np.float64]) -> None:
    solution = rotavg.solve(measured(np.random.default_rng(2), truth, 0.05))
    assert "uncertainty" not in str(solution)
    rms = np.degrees(np.sqrt(np.trace(solution.covariances(), axis1=1, axis2=2).max()))
    assert f"largest {rms:.3g} (RMS angle" in str(solution)


def test_outliers_count_for_nothing(truth: NDArray[np.float64]) -> None:
    rng = np.random.default_rng(8)
    pairs = [(i, j) for i in range(6) for j in range(i)] * 2
    i, j = np.array(pairs).T
    noise = matrices_from_rotvecs(rng.normal(size=(len(pairs), 3)) * 0.02)
    rotations = np.swapaxes(truth[i], 1, 2) @ truth[j] @ noise
    clean = rotavg.solve(rotavg.MeasurementGraph(pairs[1:], rotations[1:]))
    rotations[0] = rotations[0] @ matrices_from_rotvecs([0, 0, 2.0])
    robust = rotavg.solve(rotavg.MeasurementGraph(pairs, rotations), loss="tls", loss_scale=0.3)
    assert robust.is_outlier.tolist() == [True] + [False] * (len(pairs) - 1)
    np.testing.assert_allclose(
        robust.covariances([(1, 2), (0, 5)], frame="node"),
        clean.covariances([(1, 2), (0, 5)], frame="node"),
        rtol=1e-3, atol=1e-7,
    )  # fmt: skip


def test_bad_requests_say_what_is_wrong() -> None:
    eye = np.eye(3)
    graph = rotavg.MeasurementGraph([("a", "b"), ("c", "d")], [eye] * 2, nodes=list("abcde"))
    solution = rotavg.solve(graph)
    with pytest.raises(rotavg.GraphError, match="'a' and 'd' are in different components"):
        solution.covariances([("a", "d")], noise_variance=1)
    with pytest.raises(rotavg.GraphError, match="node 'x' is not in the graph"):
        solution.covariances([("a", "b"), ("a", "x")], noise_variance=1)
    with pytest.raises(rotavg.GraphError, match=r"shape \(2,\), expected \(k, 2\)"):
        solution.covariances(["a", "b"], noise_variance=1)
    with pytest.raises(rotavg.OptionError, match="noise_variance is 0, expected a positive"):
        solution.covariances(noise_variance=0)
    with pytest.raises(rotavg.OptionError, match="frame is 'body', expected 'world' or 'node'"):
        solution.covariances(frame="body")  # type: ignore[arg-type]
    alone = solution.covariances(noise_variance=2)
    assert [bool(block.any()) for block in alone] == [False, True, False, True, False]


def test_a_factor_that_does_not_fit_in_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise _core.TooLarge("the factor takes 1e20 bytes")

    solution = rotavg.solve(rotavg.simulate("complete", 5, noise=0.1).graph)
    monkeypatch.setattr(_core, "covariances", refuse)
    with pytest.raises(rotavg.SolverError, match="takes 1e20 bytes"):
        solution.covariances()


def test_a_saddle_has_no_covariances() -> None:
    ring = rotavg.MeasurementGraph([(k, (k + 1) % 5) for k in range(5)], [np.eye(3)] * 5)
    twist = matrices_from_rotvecs(np.outer(np.arange(5), [0, 0, 4 * np.pi / 5]))
    solution = rotavg.solve(ring, init=twist, method="bcd", max_iterations=0)
    with pytest.raises(rotavg.SolverError, match="no strict minimum"):
        solution.covariances()


def test_command_line_writes_covariances(tmp_path: Path, truth: NDArray[np.float64]) -> None:
    graph = measured(np.random.default_rng(2), truth, 0.05)
    names = [f"n,{k}" for k in range(6)]
    edges = [(names[i], names[j]) for i, j in RING]
    rotavg.write(tmp_path / "g.csv", rotavg.MeasurementGraph(edges, graph.rotations, WEIGHTS))
    arguments = ["solve", tmp_path / "g.csv", "-o", tmp_path / "s.npz"]
    wanted = ["--covariances", tmp_path / "c.csv"]
    result = run(*arguments, *wanted)
    assert result.returncode == 0, result.stderr
    assert "uncertainty" in result.stdout
    lines = (tmp_path / "c.csv").read_text().splitlines()
    assert lines[0] == "id,rms_deg,xx,xy,xz,yy,yz,zz,component"
    assert lines[1] == '"n,0",0.0,0.0,0.0,0.0,0.0,0.0,0.0,0'
    with np.load(tmp_path / "s.npz") as archive:
        covariances = archive["covariances"]
    row = [float(field) for field in lines[4].rsplit(",", 8)[1:-1]]
    assert row[1:] == [covariances[3][a, b] for a, b in zip(*np.triu_indices(3))]
    assert row[0] == pytest.approx(np.degrees(np.sqrt(np.trace(covariances[3]))))

    assert run(*arguments, *wanted, "--noise-variance", "1").returncode == 0
    alone = run(*arguments, "--noise-variance", "1")
    assert alone.returncode == 2
    assert "is for --covariances" in alone.stderr


def test_without_covariances_the_solution_is_written_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "tree.csv").write_text("i,j,qx,qy,qz,qw\n1,2,0,0,0,1\n")
    files = ["-o", tmp_path / "s.csv", "--covariances", tmp_path / "c.csv"]
    result = run("solve", tmp_path / "tree.csv", *files)
    assert result.returncode == 2
    assert "no cycles" in result.stderr
    assert (tmp_path / "s.csv").exists()
    assert not (tmp_path / "c.csv").exists()
