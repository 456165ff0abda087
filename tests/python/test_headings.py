"""Gravity is held, and headings alone are free: beside the definition, priors, and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import rotavg
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.io.gravity import write_gravity
from rotavg.report.verdict import statement

G = np.array([0.0, 1.0, 0.0])


def scene(
    noise: float, outliers: float = 0.0, seed: int = 1, tilt: float = 0.0
) -> tuple[rotavg.MeasurementGraph, NDArray[np.float64], dict[int, Any]]:
    s = rotavg.simulate("erdos_renyi", 40, density=0.2, noise=noise, outliers=outliers, seed=seed)
    T = np.asarray(s.ground_truth)
    rng = np.random.default_rng(seed)
    off = matrices_from_rotvecs(tilt * rng.standard_normal((40, 3)))
    return s.graph, T, {k: (off[k] @ T[k].T @ G, 1.0) for k in range(40)}


def turned(R: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return matrices_from_rotvecs(angles[:, None] * G) @ R


@pytest.mark.parametrize(("noise", "tilt"), [(0.0, 0.0), (0.05, 0.02), (0.5, 0.1)])
def test_every_node_hangs_and_no_heading_is_better(noise: float, tilt: float) -> None:
    graph, T, gravity = scene(noise, tilt=tilt)
    solution = rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity))
    assert solution.upright
    assert solution.status.converged
    assert solution.verdict == rotavg.Verdict.PROVED
    assert "of the headings, with gravity held" in str(solution)
    for k, (down, _) in gravity.items():
        np.testing.assert_allclose(solution[k] @ down, G, atol=1e-12)
    R, f = solution.rotations, solution.objective
    assert f == pytest.approx(rotavg.objective(graph, R), rel=1e-12, abs=1e-20)
    rng = np.random.default_rng(0)
    for size in (1e-3, 0.1, 3.0):
        for _ in range(30):
            other = rotavg.objective(graph, turned(R, size * rng.standard_normal(40)))
            assert other >= f - 1e-9 * max(f, 1e-9)
    if noise == 0.0:
        assert rotavg.compare(solution, T).rms < 1e-7
    else:  # a prior that is trusted beyond measure holds gravity, too
        heavy = {k: (down, 1e7) for k, (down, _) in gravity.items()}
        near = rotavg.solve(graph, priors=rotavg.Priors(gravity=heavy), certify=False)
        assert rotavg.compare(solution, near).rms < 1e-3
    with pytest.raises(rotavg.SolverError, match="headings alone were free"):
        solution.covariances()


def test_outliers_are_told() -> None:
    graph, T, gravity = scene(0.02, outliers=0.2, seed=3)
    solution = rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity), loss="auto")
    assert rotavg.compare(solution, T).rms < 0.02
    R = np.asarray(graph.rotations)
    i, j = graph.indices.T
    off = np.linalg.norm(T[i] @ R - T[j], axis=(1, 2)) / 8**0.5 > 0.5
    assert solution.is_outlier[off].mean() > 0.9
    assert solution.is_outlier[~off].mean() < 0.12  # noise about a random axis has long tails
    assert len(solution.edge_weights) == graph.num_edges


def test_frames_of_calibrated_rigs_and_components() -> None:
    rng = np.random.default_rng(2)
    C = matrices_from_rotvecs(rng.normal(size=(2, 3)))
    Q = matrices_from_rotvecs(rng.normal(size=(12, 3)))
    X = np.array([Q[f] @ C[s] for f in range(12) for s in range(2)])
    edges = [(i, j) for i in range(24) for j in range(i) if (i < 12) == (j < 12)]
    graph = rotavg.MeasurementGraph(edges, np.array([X[i].T @ X[j] for i, j in edges]))
    rigs = {k: (k // 2, C[k % 2]) for k in range(24)}
    gravity = {2 * f: (X[2 * f].T @ G, 1.0) for f in range(12)}  # of one camera of each frame
    solution = rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity, rigs=rigs))
    assert solution.num_components == 2
    assert rotavg.compare(solution, dict(enumerate(X))).rms < 1e-7
    images = {k: (k // 2, k % 2) for k in range(24)}
    known = rotavg.Rigs(images, {0: C[0], 1: C[1]})
    same = rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity, rigs=known))
    np.testing.assert_array_equal(same.rotations, solution.rotations)
    half = rotavg.Rigs(images, {0: C[0]})
    with pytest.raises(rotavg.GraphError, match="the rotation of sensor 1 is not known"):
        rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity, rigs=half))
    alone = rotavg.Priors(gravity=gravity)
    with pytest.raises(rotavg.GraphError, match="gravity of 12 of 24 nodes is not known"):
        rotavg.solve_headings(graph, alone)


def test_what_has_no_meaning_is_refused() -> None:
    graph, T, gravity = scene(0.1)
    priors = rotavg.Priors(gravity=gravity)
    for settings in ({"anisotropic": True}, {"gauge": "mean"}, {"trusted": None}):
        with pytest.raises(rotavg.OptionError, match="is not possible where headings"):
            rotavg.solve_headings(graph, priors, **settings)
    with pytest.raises(rotavg.OptionError, match="rotations are no start"):
        rotavg.solve_headings(graph, priors, init=T)
    for wrong in (
        rotavg.Priors(),
        rotavg.Priors(gravity=gravity, fixed={0: T[0]}),
        rotavg.Priors(gravity={**gravity, 99: (G, 1.0)}),
        rotavg.Priors(gravity={**gravity, 0: (0 * G, 1.0)}),
    ):
        with pytest.raises(rotavg.GraphError):
            rotavg.solve_headings(graph, wrong)
    for down in ([0, 0, 0], [0, np.nan, 1]):
        with pytest.raises(rotavg.GraphError, match=r"down is .*expected a finite direction"):
            rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity, down=down))


def test_the_command(tmp_path: Path) -> None:
    graph, _, gravity = scene(0.02)
    path, down, out = tmp_path / "g.csv", tmp_path / "gravity.txt", tmp_path / "out.csv"
    rotavg.write(path, graph)
    write_gravity(down, [str(k) for k in gravity], [d for d, _ in gravity.values()])
    arguments = ["solve", str(path), "--gravity", str(down), "--headings"]
    result = CliRunner().invoke(commands, [*arguments, "-o", str(out), "--json"])
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary["certificate"]["verdict"] == "proved"
    found = rotavg.read_rotations(out)
    for node, R in zip(found.nodes.tolist(), found.rotations):
        np.testing.assert_allclose(R @ gravity[node][0], G, atol=1e-12)
    report = tmp_path / "r.html"
    result = CliRunner().invoke(
        commands, [*arguments, "--loss", "auto", "--report", str(report), "--edges", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert "with gravity held" in result.stdout
    for more, message in (
        (["--anisotropic"], "--anisotropic is not possible with --headings"),
        (["--gauge", "mean"], "--gauge is not possible with --headings"),
        (["--gravity-weight", "3"], "--gravity-weight is not possible with --headings"),
    ):
        result = CliRunner().invoke(commands, [*arguments, *more])
        assert result.exit_code == 2
        assert message in " ".join(result.output.split())
    result = CliRunner().invoke(commands, ["solve", str(path), "--headings"])
    assert result.exit_code == 2
    assert "--headings is for --gravity" in result.output


def upright_cameras(rng: np.random.Generator) -> NDArray[np.float64]:
    """(30, 3, 3) rotations about y, of random headings."""
    turns = np.zeros((30, 3))
    turns[:, 1] = rng.uniform(-3, 3, 30)
    return np.asarray(Rotation.from_rotvec(turns).as_matrix())


def test_an_edge_that_gravity_refutes_is_an_outlier_whatever_its_heading() -> None:
    rng = np.random.default_rng(5)
    truth = upright_cameras(rng)
    edges = np.array([(i, j) for i in range(30) for j in range(i + 1, 30) if rng.random() < 0.4])
    i, j = edges.T
    noise = Rotation.from_rotvec(0.01 * rng.normal(size=(len(edges), 3))).as_matrix()
    measured = np.swapaxes(truth[i], 1, 2) @ truth[j] @ noise
    wrong = rng.random(len(edges)) < 0.2
    measured[wrong] = Rotation.random(int(wrong.sum()), random_state=7).as_matrix()
    tipped = int(np.flatnonzero(~wrong)[0])
    measured[tipped] = measured[tipped] @ Rotation.from_rotvec([2.0, 0, 0]).as_matrix()
    wrong[tipped] = True
    graph = rotavg.MeasurementGraph(edges, measured)
    priors = rotavg.Priors(gravity={k: ([0, 1, 0], 1.0) for k in range(30)})
    for loss in ("auto", "huber", "l1", "tls"):
        solution = rotavg.solve_headings(graph, priors, loss=loss)
        assert not (wrong & ~solution.is_outlier).any()
        assert (~wrong & solution.is_outlier).mean() < 0.06
        assert solution.objective < 0.2
        assert rotavg.compare(solution, truth).median < 0.01


def test_what_rigs_join_is_one_component() -> None:
    turns = np.zeros((6, 3))
    turns[:, 1] = np.linspace(-2, 2, 6)
    frames = Rotation.from_rotvec(turns).as_matrix()
    sensors = [np.eye(3), Rotation.from_rotvec([0, 1.0, 0]).as_matrix()]
    world = [frames[f] @ sensors[s] for s in range(2) for f in range(6)]
    edges = [(6 * s + f, 6 * s + g) for s in range(2) for f in range(6) for g in range(f + 1, 6)]
    graph = rotavg.MeasurementGraph(edges, np.array([world[a].T @ world[b] for a, b in edges]))
    priors = rotavg.Priors(
        gravity={f: ([0, 1, 0], 1.0) for f in range(6)},
        rigs={6 * s + f: (f, sensors[s]) for s in range(2) for f in range(6)},
    )
    solution = rotavg.solve_headings(graph, priors, loss="auto")
    assert solution.num_components == 1
    assert solution.robust is not None
    assert solution.robust.num_parts == 1
    assert solution.hanging_groups == []
    assert "gauge of its own" not in str(solution)


def test_gravity_does_not_refute_edges_for_being_heavy() -> None:
    rng = np.random.default_rng(2)
    truth = upright_cameras(rng)
    edges = np.array([(i, j) for i in range(30) for j in range(i + 1, 30) if rng.random() < 0.5])
    i, j = edges.T
    weights = 10 ** rng.uniform(0, 4, len(edges))
    noise = rng.normal(size=(len(edges), 3)) * (0.01 / np.sqrt(weights))[:, None]
    measured = np.swapaxes(truth[i], 1, 2) @ truth[j] @ Rotation.from_rotvec(noise).as_matrix()
    graph = rotavg.MeasurementGraph(edges, measured, weights)
    tips = Rotation.from_rotvec(np.radians(1) * rng.normal(size=(30, 3))).as_matrix()
    gravity = {k: (tips[k] @ truth[k].T @ [0, 1, 0], 1.0) for k in range(30)}
    solution = rotavg.solve_headings(graph, rotavg.Priors(gravity=gravity), loss="auto")
    heavy = weights > np.median(weights)
    assert solution.is_outlier[heavy].mean() < 0.25
    sentence = next(line for line in str(solution).splitlines() if "verdict" in line)
    assert "of the headings, with gravity held; on the edges it kept, " in sentence
    assert "of the headings, with gravity held" in statement(solution).headline
