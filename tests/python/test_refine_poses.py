"""Poses refined as a whole, against finite differences, SciPy's least squares and GTSAM."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.cli.main import commands
from rotavg.graph import se3
from rotavg.graph.conventions import matrices_from_rotvecs
from shared_data import shared_data
from test_positions import pose_graph

Floats = NDArray[np.float64]
WITHOUT = "gtsam is not installed: pip install rotavg[gtsam]"


def run(*arguments: Any) -> str:
    """What the command prints on stdout."""
    result = CliRunner().invoke(commands, [str(a) for a in arguments], standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    assert result.return_value == 0
    return result.stdout


def motions(count: int, seed: int, angle: float) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(count, 3))
    axes *= angle / np.linalg.norm(axes, axis=1, keepdims=True)
    return matrices_from_rotvecs(axes), rng.normal(size=(count, 3))


def exp_se3(xi: Floats) -> Floats:
    """The matrix exponential of one tangent vector, by its series."""
    A = np.zeros((4, 4))
    A[:3, :3], A[:3, 3] = se3.hat(xi[None, 3:])[0], xi[:3]
    term = result = np.eye(4)
    for k in range(1, 40):
        term = term @ A / k
        result = result + term
    return result


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.049, 0.051, 1.0, 3.0])
def test_logarithm_and_its_derivative(angle: float) -> None:
    R, t = motions(5, seed=1, angle=angle)
    xi = se3.log_se3(R, t)
    J = se3.inverse_right_jacobian_se3(xi)
    for k in range(5):
        T = exp_se3(xi[k])
        np.testing.assert_allclose(T[:3, :3], R[k], atol=1e-14)
        np.testing.assert_allclose(T[:3, 3], t[k], atol=1e-13)
        for axis in range(6):
            step = 1e-6 * np.eye(6)[axis]
            ends = [T @ exp_se3(sign * step) for sign in (1, -1)]
            logs = se3.log_se3(np.array([E[:3, :3] for E in ends]), [E[:3, 3] for E in ends])
            np.testing.assert_allclose(J[k, :, axis], (logs[0] - logs[1]) / 2e-6, atol=2e-8)


def test_adjoint() -> None:
    (R,), (t,) = motions(1, seed=2, angle=2.0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    xi = np.random.default_rng(3).normal(size=6)
    right = exp_se3(se3.adjoint(R[None], t[None])[0] @ xi) @ T
    np.testing.assert_allclose(T @ exp_se3(xi), right, atol=1e-12)


def noisy(n: int, seed: int, noise: float = 0.2, **graph: Any) -> rotavg.MeasurementGraph:
    """A pose graph with noise and full information, that between translation and rotation too."""
    exact, _, _ = pose_graph(n, seed)
    assert exact.num_edges > n  # there are cycles
    rng = np.random.default_rng(seed)
    m = exact.num_edges
    factor = rng.normal(size=(m, 6, 6))
    omega = factor @ np.swapaxes(factor, 1, 2) + np.eye(6)
    turned = exact.rotations @ matrices_from_rotvecs(noise * rng.normal(size=(m, 3)))
    moved = exact.translations.vectors + noise * rng.normal(size=(m, 3))
    return rotavg.MeasurementGraph(
        exact.edges,
        turned,
        covariances=np.linalg.inv(omega[:, 3:, 3:]),
        translations=rotavg.RelativeTranslations(moved, omega[:, :3, :3], cross=omega[:, :3, 3:]),
        **graph,
    )


def residuals(graph: rotavg.MeasurementGraph, R: Floats, p: Floats) -> Floats:
    """Whose squares add up to chi^2, spelt edge by edge, with 4 x 4 matrices."""
    result = []
    for k, (i, j) in enumerate(graph.indices):
        T = [np.block([[R[node], p[node][:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
             for node in (i, j)]  # fmt: skip
        Z = np.eye(4)
        Z[:3, :3], Z[:3, 3] = graph.rotations[k], graph.translations.vectors[k]
        E = np.linalg.inv(Z) @ np.linalg.inv(T[0]) @ T[1]
        e = se3.log_se3(E[None, :3, :3], E[None, :3, 3])[0]
        C = graph.translations.cross[k]
        omega = np.block(
            [[graph.translations.information[k], C], [C.T, np.linalg.inv(graph.covariances[k])]]
        )
        result.append(np.linalg.cholesky(omega).T @ e)
    return np.concatenate(result)


@pytest.mark.parametrize("seed", [2, 5])
def test_against_general_least_squares(seed: int) -> None:
    optimize = pytest.importorskip("scipy.optimize", reason="scipy is not installed")
    graph = noisy(10, seed)
    found = rotavg.refine_poses(rotavg.solve(graph))
    assert found.status.converged
    spelt = np.sum(residuals(graph, found.rotations, found.positions) ** 2)
    assert found.chi2 == pytest.approx(spelt, rel=1e-10)
    assert found.chi2 < found.chi2_start
    np.testing.assert_array_equal(found.rotations[0], np.eye(3))
    np.testing.assert_array_equal(found.positions[0], np.zeros(3))

    def moved(x: Floats) -> tuple[Floats, Floats]:
        step = np.vstack([np.zeros(6), x.reshape(-1, 6)])
        return found.rotations @ matrices_from_rotvecs(step[:, 3:]), found.positions + step[:, :3]

    best = optimize.least_squares(lambda x: residuals(graph, *moved(x)), np.zeros(6 * 9))
    assert 2 * best.cost == pytest.approx(found.chi2, rel=1e-9)
    np.testing.assert_allclose(best.x, 0, atol=1e-4)


def test_without_noise_nothing_moves() -> None:
    graph, R, p = pose_graph(30, seed=4)
    found = rotavg.refine_poses(rotavg.solve(graph))
    assert found.status.converged
    np.testing.assert_allclose(found.rotations, R[0].T @ R, atol=1e-12)
    np.testing.assert_allclose(found.positions, (p - p[0]) @ R[0], atol=1e-10)
    assert found[3] is not None
    np.testing.assert_array_equal(found[3], found.rotations[3])


def test_what_is_fixed_stays() -> None:
    graph, R, p = pose_graph(15, seed=5, noise=0.1, parts=3)
    solution = rotavg.solve(graph)
    held = {17: (R[17], p[17]), 20: (R[20], p[20]), 33: (R[33], p[33])}
    found = rotavg.refine_poses(solution, fixed=held)
    for node, (turned, moved) in held.items():
        np.testing.assert_array_equal(found[node], turned)
        np.testing.assert_array_equal(found.positions[node], moved)
    np.testing.assert_array_equal(found.positions[0], np.zeros(3))
    np.testing.assert_allclose(found.positions[15:], p[15:], atol=5)
    free = rotavg.refine_poses(solution)
    assert free.chi2 < found.chi2
    # Where one node of a part is held, it only moves as a whole.
    last = np.arange(30, 45)
    turn = found.rotations[30] @ free.rotations[30].T
    np.testing.assert_allclose(turn @ free.rotations[last], found.rotations[last], atol=1e-6)


def test_outliers_count_as_the_robust_weights_say() -> None:
    graph, R, p = pose_graph(30, seed=6)
    rotations = np.array(graph.rotations)
    rotations[5] = rotations[5] @ matrices_from_rotvecs([[0, 0, 2.0]])[0]
    moved = np.array(graph.translations.vectors)
    moved[5] += 30
    spoilt = rotavg.MeasurementGraph(
        graph.edges,
        rotations,
        translations=rotavg.RelativeTranslations(moved, graph.translations.information),
    )
    solution = rotavg.solve(spoilt, loss="tls")
    assert solution.is_outlier[5]
    found = rotavg.refine_poses(solution)
    np.testing.assert_allclose(found.positions, (p - p[0]) @ R[0], atol=1e-3)


def test_priors_of_positions_give_the_world() -> None:
    graph, R, p = pose_graph(20, seed=7)
    places = {node: (p[node], 100 * np.eye(3)) for node in (2, 5, 11, 17)}
    found = rotavg.refine_poses(rotavg.solve(graph), priors=rotavg.Priors(positions=places))
    np.testing.assert_allclose(found.rotations, R, atol=1e-9)
    np.testing.assert_allclose(found.positions, p, atol=1e-8)


def test_all_priors_together() -> None:
    graph, R, p = pose_graph(20, seed=8, noise=0.05)
    priors = rotavg.Priors(
        fixed={3: R[3]},
        absolute={4: (R[4], 2.0)},
        gravity={5: (R[5].T @ [0, 1, 0], 3.0)},
        positions={6: (p[6], np.diag([1.0, 2, 3]))},
    )
    solution = rotavg.solve(graph, priors=priors)
    found = rotavg.refine_poses(solution)
    assert found.status.converged
    np.testing.assert_array_equal(found[3], R[3])
    np.testing.assert_allclose(found.positions[6], p[6], atol=1e-6)  # nothing else pulls at it
    bare = rotavg.refine_poses(rotavg.solve(graph))
    assert found.chi2 >= bare.chi2 * (1 - 1e-12)


def test_a_line_of_positions_leaves_a_turn_open_and_that_is_no_trouble() -> None:
    graph, _, p = pose_graph(12, seed=9, noise=0.05)
    for nodes in ([3], [3, 7]):
        places = {node: (p[node], np.eye(3)) for node in nodes}
        found = rotavg.refine_poses(rotavg.solve(graph), priors=rotavg.Priors(positions=places))
        assert np.isfinite(found.positions).all()
        assert found.status.converged
        best = rotavg.refine_poses(rotavg.solve(graph)).chi2
        assert found.chi2 >= best * (1 - 1e-9)
    assert found.chi2 < 2 * best


def test_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = noisy(10, 2)
    solution = rotavg.solve(graph)
    bare = rotavg.solve(rotavg.MeasurementGraph(graph.edges, graph.rotations))
    with pytest.raises(rotavg.GraphError, match="no relative translations"):
        rotavg.refine_poses(bare)
    with pytest.raises(rotavg.GraphError, match="found a MeasurementGraph, expected a Solution"):
        rotavg.refine_poses(graph)  # type: ignore[arg-type]
    with pytest.raises(rotavg.GraphError, match="node 99 is not in the graph"):
        rotavg.refine_poses(solution, fixed={99: (np.eye(3), [0, 0, 0])})
    with pytest.raises(rotavg.GraphError, match=r"fixed pose of node 1 .*no rotation"):
        rotavg.refine_poses(solution, fixed={1: (2 * np.eye(3), [0, 0, 0])})
    with pytest.raises(rotavg.GraphError, match="expected a pair of a rotation and a position"):
        rotavg.refine_poses(solution, fixed={1: np.eye(3)})  # type: ignore[dict-item]
    with pytest.raises(rotavg.GraphError, match="information of the position prior of node 1"):
        rotavg.refine_poses(solution, priors=rotavg.Priors(positions={1: ([0, 0, 0], -np.eye(3))}))
    with pytest.raises(rotavg.OptionError, match="max_iterations is -1"):
        rotavg.refine_poses(solution, max_iterations=-1)
    rigs = rotavg.Priors(rigs={node: (node, np.eye(3)) for node in range(10)})
    with pytest.raises(rotavg.OptionError, match="rigs"):
        rotavg.refine_poses(solution, priors=rigs)
    moved = graph.translations
    cross = np.array(moved.cross)
    cross[3] *= 100
    spoilt = rotavg.MeasurementGraph(
        graph.edges,
        graph.rotations,
        covariances=graph.covariances,
        translations=rotavg.RelativeTranslations(moved.vectors, moved.information, cross=cross),
    )
    i, j = graph.edges[3]
    with pytest.raises(rotavg.GraphError, match=rf"edge 3 \({i} -> {j}\): the information"):
        rotavg.refine_poses(rotavg.solve(spoilt))
    stopped = rotavg.refine_poses(solution, max_iterations=1)
    assert stopped.status is rotavg.Status.ITERATION_LIMIT
    assert stopped.iterations == 1
    monkeypatch.setitem(__import__("sys").modules, "scipy.sparse", None)
    with pytest.raises(rotavg.MissingExtraError, match=r'pip install "rotavg\[scipy\]"'):
        rotavg.refine_poses(solution)


@pytest.mark.parametrize("name", ["smallGrid3D", "parking-garage", "sphere2500", "torus3D"])
def test_it_ends_where_gtsam_ends(name: str, tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    path = shared_data(f"g2o/{name}.g2o")
    found = rotavg.refine_poses(rotavg.solve(rotavg.read(path), certify=False))
    rotavg.write(tmp_path / "out.g2o", found)
    factors, _ = gtsam.readG2o(str(path), True)
    _, ours = gtsam.readG2o(str(tmp_path / "out.g2o"), True)
    assert 2 * factors.error(ours) == pytest.approx(found.chi2, rel=1e-7)
    held = gtsam.NonlinearFactorGraph(factors)
    first = min(ours.keys())
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    held.add(gtsam.PriorFactorPose3(first, ours.atPose3(first), tight))
    start = gtsam.InitializePose3.initialize(held)  # its own, not ours
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    end = gtsam.LevenbergMarquardtOptimizer(held, start, parameters).optimize()
    assert found.chi2 == pytest.approx(2 * factors.error(end), rel=1e-6)


def test_the_plane_of_gtsams_lago(tmp_path: Path) -> None:
    """GTSAM's largeGraphNoisy: within 1e-2 of the optimum in its data (testLago.cpp)."""
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    path = Path(gtsam.findExampleDataFile("noisyToyGraph.txt"))
    out = tmp_path / "out.g2o"
    poses = json.loads(run("solve", path, "--refine-poses", "-o", out, "--json"))["poses"]
    factors, _ = gtsam.readG2o(str(path), False)
    _, ours = gtsam.readG2o(str(out), False)
    assert poses["chi2"] == pytest.approx(2 * factors.error(ours), rel=1e-9)
    _, expected = gtsam.readG2o(gtsam.findExampleDataFile("optimizedNoisyToyGraph.txt"), False)
    for node in range(4):
        gap = expected.atPose2(node).between(ours.atPose2(node))
        assert np.abs([gap.x(), gap.y(), gap.theta()]).max() < 1e-2
    held = gtsam.NonlinearFactorGraph(factors)
    held.add(gtsam.PriorFactorPose2(0, ours.atPose2(0), gtsam.noiseModel.Isotropic.Sigma(3, 1e-4)))
    end = gtsam.LevenbergMarquardtOptimizer(held, ours).optimize()
    assert poses["chi2"] == pytest.approx(2 * factors.error(end), rel=1e-9)


G2O = """VERTEX_SE3:QUAT 0 1 2 3 0 0 0.6 0.8
VERTEX_SE3:QUAT 1 2 2 3 0 0 0 1
VERTEX_SE3:QUAT 2 3 2 3 0 0 0 1
{fix}
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 0 0 0 0.3 0 1 0 0 0 0 1 0 0 0 9 0 0 9 0 9
EDGE_SE3:QUAT 1 2 1 0 0 0 0 0.1 0.995 1 0 0 0 0 0 1 0 0 0 0.2 1 0 0 0 9 0 0 9 0 9
EDGE_SE3:QUAT 0 2 2 0.3 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 9 0 0 9 0 9
"""


def numbers(line: str) -> list[float]:
    return [float(word) for word in line.split()[1:]]


@pytest.mark.parametrize("fix", ["", "FIX 1", "FIX 0 2"])
def test_back_into_the_file(tmp_path: Path, fix: str) -> None:
    path, out = tmp_path / "in.g2o", tmp_path / "out.g2o"
    path.write_text(G2O.format(fix=fix))
    graph = rotavg.read(path)
    assert graph.translations.cross is not None
    found = rotavg.refine_poses(rotavg.solve(graph))
    rotavg.write(out, found)
    lines, before = out.read_text().splitlines(), path.read_text().splitlines()
    for node in [int(word) for word in fix.split()[1:]] or [0]:
        np.testing.assert_allclose(numbers(lines[node]), numbers(before[node]), atol=1e-12)
    assert lines[3:] == before[3:]
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    factors, values = gtsam.readG2o(str(out), True)
    assert 2 * factors.error(values) == pytest.approx(found.chi2, rel=1e-9)
    # No pose that may move can do better.
    rng = np.random.default_rng(0)
    held = [int(word) for word in fix.split()[1:]]
    for _ in range(20):
        moved = gtsam.Values(values)
        for node in {0, 1, 2} - set(held):
            step = 1e-3 * rng.normal(size=6)
            moved.update(node, values.atPose3(node).retract(step))
        assert 2 * factors.error(moved) > found.chi2


def test_other_files_have_the_positions(tmp_path: Path) -> None:
    found = rotavg.refine_poses(rotavg.solve(noisy(10, 2)))
    rotavg.write(tmp_path / "out.tum", found)
    rows = np.loadtxt(tmp_path / "out.tum")
    np.testing.assert_array_equal(rows[:, 1:4], found.positions)
    rotavg.write(tmp_path / "images.txt", found)
    first = (tmp_path / "images.txt").read_text().splitlines()[4].split()
    t = np.array(first[5:8], dtype=float)
    np.testing.assert_allclose(-found.rotations[1] @ t, found.positions[1], atol=1e-12)
    rotavg.write(tmp_path / "out.npz", found)
    with np.load(tmp_path / "out.npz") as archive:
        np.testing.assert_array_equal(archive["positions"], found.positions)
    rotavg.write(tmp_path / "new.g2o", found)
    again = rotavg.read(tmp_path / "new.g2o")
    assert again.source.vertices[3][:3].tolist() == found.positions[3].tolist()
    graph = noisy(10, 2)
    rotavg.write(tmp_path / "graph.npz", graph)
    same = rotavg.read(tmp_path / "graph.npz")
    np.testing.assert_array_equal(same.translations.cross, graph.translations.cross)


def test_the_command(tmp_path: Path) -> None:
    path = tmp_path / "in.g2o"
    path.write_text(G2O.format(fix=""))
    assert "poses       chi^2" in run("solve", path, "--refine-poses")
    (tmp_path / "turns.txt").write_text("0 1 0 0 0 1\n")
    with pytest.raises(rotavg.FormatError, match=r"turns\.txt: the graph has no relative transl"):
        run("solve", tmp_path / "turns.txt", "--refine-poses")
