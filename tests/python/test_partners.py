"""GTSAM, NetworkX and SciPy: their objects and ours, on graphs where a wrong transpose shows."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import GraphError, MissingExtraError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.partners.gtsam import from_gtsam, priors_from_gtsam, to_gtsam
from shared_data import shared_data
from test_positions import pose_graph

WITHOUT = "gtsam is not installed: pip install rotavg[gtsam]"


def turns(seed: int = 1) -> MeasurementGraph:
    graph = rotavg.simulate("erdos_renyi", 25, density=0.3, seed=seed).graph
    return graph.with_weights(np.random.default_rng(seed).uniform(1e-2, 1e2, graph.num_edges))


def test_gtsam_rotations_there_and_back() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    graph = turns()
    factors = to_gtsam(graph)
    assert type(factors.at(0)) is gtsam.BetweenFactorRot3
    # Its own measure of how badly our solution fits: zero, as there is no noise.
    assert factors.error(to_gtsam(rotavg.solve(graph))) < 1e-20
    again = from_gtsam(factors)
    np.testing.assert_array_equal(again.edges, graph.edges)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
    np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-12)


@pytest.mark.parametrize("isotropic", [False, True])
def test_gtsam_poses_there_and_back(isotropic: bool) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    graph, R, p = pose_graph(20, seed=3, isotropic=isotropic)
    factors = to_gtsam(graph)
    assert type(factors.at(0)) is gtsam.BetweenFactorPose3
    assert factors.error(to_gtsam(rotavg.solve(graph))) < 1e-18
    truth = gtsam.Values()
    for k in range(20):
        truth.insert(k, gtsam.Pose3(gtsam.Rot3(R[k]), p[k]))
    assert factors.error(truth) < 1e-18
    factors.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Unit.Create(6)))
    again = from_gtsam(factors)
    assert again.notes == ("1 prior factor not in it: see priors_from_gtsam",)
    np.testing.assert_allclose(again.translations.vectors, graph.translations.vectors)
    np.testing.assert_allclose(
        again.translations.information, graph.translations.information, rtol=1e-9, atol=1e-12
    )


def test_gtsam_counts_small_errors_as_the_weights_say() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    # 2 error = theta^T (2 w I) theta for Rot3, and w |R_i R_ij - R_j|_F^2 = 2 w theta^2 nearly.
    graph = MeasurementGraph.from_rotvecs([[0, 1]], [[1e-4, 0, 0]], weights=[7])
    values = gtsam.Values()
    values.insert(0, gtsam.Rot3())
    values.insert(1, gtsam.Rot3())
    f = rotavg.objective(graph, [np.eye(3)] * 2)
    assert 2 * to_gtsam(graph).error(values) == pytest.approx(f, rel=1e-6)


@pytest.mark.parametrize("name", ["g2o", "toro"])
def test_gtsam_reads_what_we_write(name: str, tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    graph, _, _ = pose_graph(20, seed=4)
    path = tmp_path / ("a.g2o" if name == "g2o" else "a.graph")
    rotavg.write(path, rotavg.solve(graph))
    factors, values = gtsam.load3D(str(path))
    assert (factors.size(), values.size()) == (graph.num_edges, 20)
    # It takes TORO's information for rotation first; without noise that makes no difference.
    assert factors.error(values) < 1e-16
    for k, (i, j) in enumerate(graph.edges.tolist()):
        assert list(factors.at(k).keys()) == [i, j]
        R = factors.at(k).measured().rotation().matrix()
        np.testing.assert_allclose(R, graph.rotations[k], atol=1e-14)
    if name == "g2o":
        again = from_gtsam(factors)
        np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-9)
        np.testing.assert_allclose(
            again.translations.information, graph.translations.information, rtol=1e-9, atol=1e-12
        )


def test_we_read_what_gtsam_writes(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    graph, _, _ = pose_graph(20, seed=5)
    factors, values = to_gtsam(graph), to_gtsam(rotavg.solve(graph))
    gtsam.writeG2o(factors, values, str(tmp_path / "theirs.g2o"))
    again = rotavg.read(tmp_path / "theirs.g2o")
    np.testing.assert_array_equal(again.edges, graph.edges)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-5)  # six digits
    np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-5)


def test_gtsam_reads_the_plane(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    angles = np.array([0.0, 1.0, 2.5])
    lines = [
        f"EDGE_SE2 {i} {j} 0 0 {angles[j] - angles[i]} 1 0 0 1 0 4" for i, j in ((0, 1), (1, 2))
    ]
    (tmp_path / "in.g2o").write_text("\n".join(lines) + "\n")
    rotavg.write(tmp_path / "out.g2o", rotavg.solve(rotavg.read(tmp_path / "in.g2o")))
    _, values = gtsam.readG2o(str(tmp_path / "out.g2o"), False)
    assert values.atPose2(2).theta() == pytest.approx(2.5)


def test_gtsam_agrees_on_the_positional_chi2() -> None:
    """On real data, positions are where GTSAM finds no better ones for the same rotations."""
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    path = shared_data("g2o/smallGrid3D.g2o")
    factors, _ = gtsam.readG2o(str(path), True)
    values = to_gtsam(rotavg.solve(rotavg.read(path)))
    best = factors.error(values)
    rng = np.random.default_rng(0)
    for _ in range(20):
        moved = gtsam.Values(values)
        for k in range(values.size()):
            pose = values.atPose3(k)
            where = pose.translation() + 1e-3 * rng.normal(size=3)
            moved.update(k, gtsam.Pose3(pose.rotation(), where))
        assert factors.error(moved) > best


def test_bad_gtsam_input(monkeypatch: pytest.MonkeyPatch) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    with pytest.raises(GraphError, match="found the node 'a', expected integers >= 0"):
        to_gtsam(MeasurementGraph([["a", "b"]], [np.eye(3)]))
    with pytest.raises(GraphError, match="found the node -1, expected integers >= 0"):
        to_gtsam(MeasurementGraph([[-1, 2]], [np.eye(3)]))
    with pytest.raises(GraphError, match="0 BetweenFactorRot3, 0 BetweenFactorPose3, 0"):
        from_gtsam(gtsam.NonlinearFactorGraph())
    factors = gtsam.NonlinearFactorGraph()
    fixed = gtsam.noiseModel.Constrained.All(3)
    factors.add(gtsam.BetweenFactorRot3(0, 1, gtsam.Rot3(), fixed))
    with pytest.raises(GraphError, match="between factor 0 has a noise model without finite"):
        from_gtsam(factors)
    flat = gtsam.noiseModel.Gaussian.Information(np.diag([1.0, 1, 0]))
    with pytest.raises(GraphError, match="measurement 1 has information about some rotations"):
        from_gtsam([measurement(1, 2, I3, 1.0), measurement(2, 3, I3, flat)])
    with pytest.raises(GraphError, match="found a str, expected a NonlinearFactorGraph or a list"):
        from_gtsam("factors")
    noise = gtsam.noiseModel.Unit.Create(3)
    both = [gtsam.PriorFactorRot3(1, gtsam.Rot3.Rz(angle), noise) for angle in (0.0, 0.1)]
    refused = "factor 1 is a second prior of node 1, of another rotation than prior factor 0; exp"
    with pytest.raises(GraphError, match=refused):
        priors_from_gtsam(both)
    assert priors_from_gtsam(both[:1] * 2).absolute[1][1] == pytest.approx(1.0)  # half of 2
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(MissingExtraError, match=r'pip install "rotavg\[gtsam\]"'):
        to_gtsam(turns())


def test_robust_noise_counts_as_the_gaussian_inside_it() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    inside = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.0)
    noise = gtsam.noiseModel.Robust.Create(huber, inside)
    factors = gtsam.NonlinearFactorGraph()
    factors.add(gtsam.BetweenFactorRot3(0, 1, gtsam.Rot3(), noise))
    assert from_gtsam(factors).weights == pytest.approx([50])


I3 = np.eye(3)


def measurement(i: int, j: int, R: NDArray[np.float64], precision: Any) -> Any:
    """What GTSFM hands over: i_from_j."""
    import gtsam

    if isinstance(precision, float):
        precision = gtsam.noiseModel.Isotropic.Precision(3, precision)
    return gtsam.BinaryMeasurementRot3(i, j, gtsam.Rot3(R), precision)


@pytest.mark.parametrize("kind", [list, tuple])
def test_lists_of_measurements(kind: Any) -> None:
    pytest.importorskip("gtsam", reason=WITHOUT)
    graph = turns()
    given = [
        measurement(i, j, R, 2 * float(w))
        for (i, j), R, w in zip(graph.edges.tolist(), graph.rotations, graph.weights)
    ]
    again = from_gtsam(kind(given))
    np.testing.assert_array_equal(again.edges, graph.edges)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
    np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-12)


def test_without_information_there_is_no_edge() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    nothing = gtsam.noiseModel.Gaussian.Information(np.zeros((3, 3)))
    graph = from_gtsam([measurement(1, 2, I3, 1.0), measurement(2, 3, I3, nothing)])
    assert graph.edges.tolist() == [[1, 2]]
    assert graph.nodes.tolist() == [1, 2, 3]
    assert any("weight 0" in note for note in graph.notes)
    pose, unit = gtsam.Pose3(gtsam.Rot3(), [1, 2, 3]), gtsam.noiseModel.Unit.Create(6)
    nothing = gtsam.noiseModel.Isotropic.Precision(6, 0.0)
    half = gtsam.noiseModel.Gaussian.Information(np.diag([1.0, 1, 1, 0, 0, 0]))
    given = [
        gtsam.BetweenFactorPose3(0, 1, pose, unit),
        gtsam.BetweenFactorPose3(1, 2, pose, nothing),
    ]
    graph = from_gtsam(given)
    assert (graph.num_edges, len(graph.translations)) == (1, 1)
    graph = from_gtsam([*given, gtsam.BetweenFactorPose3(0, 2, pose, half)])
    assert graph.translations is None
    assert graph.notes[0] == (
        "translations not used: between factor 2 has no definite information about them"
    )


def test_the_plane_there_and_back() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    rng = np.random.default_rng(0)
    truth = [gtsam.Pose2(*rng.normal(size=3)) for _ in range(6)]
    poses, turns = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph()
    for i, j in [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 4)]:
        A = rng.normal(size=(3, 3))
        noise = gtsam.noiseModel.Gaussian.Information(A @ A.T + I3)
        step = truth[i].between(truth[j]).compose(gtsam.Pose2(*(0.1 * rng.normal(size=3))))
        poses.add(gtsam.BetweenFactorPose2(i, j, step, noise))
        precise = gtsam.noiseModel.Isotropic.Precision(1, 8.0)
        turns.add(gtsam.BetweenFactorRot2(i, j, step.rotation(), precise))
    graph = from_gtsam(turns)
    assert graph.translations is None
    np.testing.assert_allclose(graph.weights, 4.0)
    np.testing.assert_allclose(graph.rotations[:, 2, 2], 1)
    graph = from_gtsam(poses)
    solution = rotavg.solve(graph)
    assert to_gtsam(graph).error(to_gtsam(solution)) == pytest.approx(
        poses.error(to_gtsam(solution)), rel=1e-12
    )
    refined = rotavg.refine_poses(solution)
    values = to_gtsam(refined)
    assert 2 * poses.error(values) == pytest.approx(refined.chi2, rel=1e-10)
    poses.add(gtsam.PriorFactorPose2(0, values.atPose2(0), gtsam.noiseModel.Unit.Create(3)))
    end = gtsam.LevenbergMarquardtOptimizer(poses, values).optimize()
    assert 2 * poses.error(end) == pytest.approx(refined.chi2, rel=1e-9)


def test_all_the_information_goes_there_and_back() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    rng = np.random.default_rng(1)
    factors = gtsam.NonlinearFactorGraph()
    for i, j in [(0, 1), (1, 2), (2, 0)]:
        A = rng.normal(size=(6, 6))
        pose = gtsam.Pose3.Expmap(rng.normal(size=6))
        noise = gtsam.noiseModel.Gaussian.Information(A @ A.T + np.eye(6))
        factors.add(gtsam.BetweenFactorPose3(i, j, pose, noise))
    solution = rotavg.solve(from_gtsam(factors))
    again, values = to_gtsam(solution.graph), to_gtsam(solution)
    assert again.error(values) == pytest.approx(factors.error(values), rel=1e-12)
    assert 2 * factors.error(to_gtsam(rotavg.refine_poses(solution))) == pytest.approx(
        rotavg.refine_poses(solution).chi2, rel=1e-12
    )


def test_prior_factors_give_the_world() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    graph, R, p = pose_graph(12, seed=6)
    factors = to_gtsam(graph)
    for node in (2, 5, 7):
        A = np.random.default_rng(node).normal(size=(6, 6))
        noise = gtsam.noiseModel.Gaussian.Information(A @ A.T + np.eye(6))
        pose = gtsam.Pose3(gtsam.Rot3(R[node]), p[node])
        factors.add(gtsam.PriorFactorPose3(node, pose, noise))
    graph, priors = from_gtsam(factors), priors_from_gtsam(factors)
    assert graph.notes == ("3 prior factors not in it: see priors_from_gtsam",)
    assert sorted(priors.absolute) == sorted(priors.positions) == [2, 5, 7]
    solution = rotavg.solve(graph, priors=priors)
    np.testing.assert_allclose(solution.rotations, R, atol=1e-9)
    for item in (solution, rotavg.refine_poses(solution)):
        assert factors.error(to_gtsam(item)) < 1e-12
    one = [gtsam.PriorFactorRot3(4, gtsam.Rot3(R[4]), gtsam.noiseModel.Constrained.All(3))]
    np.testing.assert_array_equal(priors_from_gtsam(one).fixed[4], R[4])
    held = gtsam.PriorFactorPose3(
        4, gtsam.Pose3(gtsam.Rot3(R[4]), p[4]), gtsam.noiseModel.Constrained.All(6)
    )
    priors = priors_from_gtsam([held])
    found = rotavg.refine_poses(rotavg.solve(graph, priors=priors))
    np.testing.assert_allclose(found.positions, p, atol=1e-9)
    np.testing.assert_array_equal(found[4], R[4])
    angle = [gtsam.PriorFactorRot2(4, gtsam.Rot2(0.5), gtsam.noiseModel.Isotropic.Sigma(1, 0.5))]
    turn, weight = priors_from_gtsam(angle).absolute[4]
    assert (np.arctan2(turn[1, 0], turn[0, 0]), weight) == pytest.approx((0.5, 2.0))


@pytest.mark.parametrize("sigmas", [[0.0] * 6, [0.5] * 3 + [0.0] * 3, [0.0] * 3 + [0.5] * 3])
def test_constrained_priors_hold_what_they_constrain(sigmas: list[float]) -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    models, factors = gtsam.noiseModel, gtsam.NonlinearFactorGraph()
    for node, turn, x in ((0, 0.0, 0.0), (1, 1.1, 2.0)):
        noise = models.Isotropic.Sigma(6, 0.1)
        if node == 1:
            noise = models.Constrained.MixedSigmas(np.full(6, 1e3), np.array(sigmas))
        pose = gtsam.Pose3(gtsam.Rot3.Rz(turn), np.array([x, 0.0, 0.0]))
        factors.add(gtsam.PriorFactorPose3(node, pose, noise))
    step = gtsam.Pose3(gtsam.Rot3.Rz(0.5), np.array([1.0, 0.0, 0.0]))
    factors.add(gtsam.BetweenFactorPose3(0, 1, step, models.Isotropic.Sigma(6, 0.1)))
    solution = rotavg.solve(from_gtsam(factors), priors=priors_from_gtsam(factors))
    ours = to_gtsam(rotavg.refine_poses(solution))
    optimum = gtsam.LevenbergMarquardtOptimizer(factors, ours).optimize()
    assert factors.error(ours) == pytest.approx(factors.error(optimum), rel=1e-4)


def test_priors_that_hold_some_directions_alone_are_refused() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    noise = gtsam.noiseModel.Constrained.MixedSigmas(np.full(3, 1e3), np.array([0.0, 0.5, 0.5]))
    factor = gtsam.PriorFactorRot3(4, gtsam.Rot3(), noise)
    with pytest.raises(GraphError, match="prior factor 0 holds some directions alone"):
        priors_from_gtsam([factor])


def test_self_edges_are_skipped_on_request() -> None:
    gtsam = pytest.importorskip("gtsam", reason=WITHOUT)
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    factors = [gtsam.BetweenFactorRot3(*pair, gtsam.Rot3(), noise) for pair in ((0, 1), (1, 1))]
    with pytest.raises(GraphError, match="joins a node to itself"):
        from_gtsam(factors)
    graph = from_gtsam(factors, skip_self_edges=True)
    assert graph.edges.tolist() == [[0, 1]]
    assert graph.notes == ("1 edge from a node to itself is not used (it: 1 -> 1)",)
    with pytest.raises(GraphError, match="found a int, expected a graph or a solution"):
        to_gtsam(3)


def test_the_table_of_pose_graphs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("gtsam", reason=WITHOUT)
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    from benchmarks import pose_graphs

    path = shared_data("g2o/smallGrid3D.g2o")
    monkeypatch.setattr(sys, "argv", ["pose_graphs", str(path), "--out", str(tmp_path)])
    pose_graphs.main()
    cells = capsys.readouterr().out.splitlines()[-1].split(" | ")
    chi2 = [float(cell.split(",")[0].strip("| ")) for cell in cells[2:]]
    given, ours, chordal, *ends = chi2
    assert ours < chordal < given
    assert ends == pytest.approx([ends[0]] * 5, rel=1e-5)
    assert ends[0] < ours
    assert (tmp_path / "pose_graphs.png").stat().st_size > 1000


def test_networkx_there_and_back() -> None:
    pytest.importorskip("networkx", reason="networkx is not installed")
    graph = turns()
    parallel = MeasurementGraph(
        np.concatenate([graph.edges, graph.edges[:3]]),
        np.concatenate([graph.rotations, graph.rotations[3:6]]),
        nodes=[*range(24, -1, -1), 99],
    )
    again = MeasurementGraph.from_networkx(parallel.to_networkx())
    np.testing.assert_array_equal(again.nodes, parallel.nodes)
    # Of edges that are parallel, NetworkX keeps the order.
    expected, found = (np.lexsort(g.edges.T[::-1]) for g in (parallel, again))
    np.testing.assert_array_equal(again.edges[found], parallel.edges[expected])
    np.testing.assert_allclose(
        again.rotations[found], parallel.rotations[expected], rtol=0, atol=1e-15
    )


def test_scipy_there_and_back() -> None:
    pytest.importorskip("scipy", reason="scipy is not installed")
    graph = turns()
    again = MeasurementGraph.from_scipy(graph.edges, graph.to_scipy(), graph.weights)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
