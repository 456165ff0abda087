"""Solutions with the priors that stand in the files of pose graphs."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from pose_prior_files import (
    I3,
    IDENTITY,
    Floats,
    Scene,
    angle,
    g2o_prior,
    numbers,
    prior_factor,
    run,
    turn,
    upper,
)
from rotavg.graph.conventions import matrices_from_rotvecs


@pytest.mark.parametrize(("kind", "end"), [("g2o", "g2o"), ("jrl", "tum"), ("jrl", "g2o")])
def test_the_command_finds_the_world_of_the_priors(tmp_path: Path, kind: str, end: str) -> None:
    scene = Scene(seed=2, parts=2)
    heavy = 1e12 * np.eye(6)
    known = [(3, scene.R[3], scene.p[3]), (12, scene.R[12], scene.p[12])]
    if kind == "g2o":
        lines = [IDENTITY, *(g2o_prior(*pose_of, heavy) for pose_of in known)]
        path = scene.g2o(tmp_path / "a.g2o", *lines)
    else:
        factors = (prior_factor(*pose_of, np.linalg.inv(heavy)) for pose_of in known)
        path = scene.jrl(tmp_path / "a.jrl", *factors)
    out = tmp_path / f"b.{end}"
    for options in ([], ["--refine-poses"]):
        done = run("solve", path, "-o", out, *options)
        assert done.returncode == 0, done.stderr
        assert "verdict     proved" in done.stdout
        told = "note: priors of 2 rotations and 2 positions (which count with --refine-poses), as"
        assert told in done.stderr
        ids, rotations = rotavg.read_rotations(out)
        np.testing.assert_allclose(rotations[np.argsort(ids)], scene.R, atol=1e-8)
        places = {}
        for line in out.read_text().splitlines():
            fields = line.removeprefix("VERTEX_SE3:QUAT ").split()
            if line.startswith("VERTEX") or (end == "tum" and line[0] != "#"):
                places[int(fields[0])] = [float(x) for x in fields[1:4]]
        np.testing.assert_allclose([places[i] for i in range(16)], scene.p, atol=1e-7)
        if kind == "g2o":  # what is no pose stays, the priors' lines among it
            kept = [
                [s for s in f.read_text().splitlines() if s[:6] != "VERTEX"] for f in (path, out)
            ]
            assert kept[0] == kept[1]
    done = run("solve", path, "--no-priors", "-o", out)
    assert done.returncode == 0
    assert "note: priors of" not in done.stderr
    ids, rotations = rotavg.read_rotations(out)
    far = turn(1.0, 2.0, 0.5) if kind == "g2o" else scene.R[0].T
    assert angle(dict(zip(ids, rotations))[0], far @ scene.R[0]) < 1e-8


def test_given_rotations_and_gravity_hold_the_world_of_a_g2o_file(tmp_path: Path) -> None:
    scene = Scene(seed=3, noise=0.01)
    graph = rotavg.read(scene.g2o(tmp_path / "a.g2o"))
    down = {i: (R.T @ [0, 1, 0], 50.0) for i, R in enumerate(scene.R)}
    for priors in (rotavg.Priors(fixed={2: scene.R[2]}), rotavg.Priors(gravity=down)):
        solution = rotavg.solve(graph, priors=priors)
        for item in (solution, rotavg.refine_poses(solution)):
            rotavg.write(tmp_path / "b.g2o", item)
            ids, rotations = rotavg.read_rotations(tmp_path / "b.g2o")
            np.testing.assert_allclose(rotations[np.argsort(ids)], item.rotations, atol=1e-9)
            first = (tmp_path / "b.g2o").read_text().splitlines()[0].split()[2:5]
            start = (tmp_path / "a.g2o").read_text().splitlines()[0].split()[2:5]
            assert first == start  # no prior tells where


def test_a_fixed_vertex_stays(tmp_path: Path) -> None:
    scene = Scene(seed=4)
    prior = g2o_prior(3, scene.R[3], scene.p[3], np.eye(6))
    path = scene.g2o(tmp_path / "a.g2o", "FIX 1", IDENTITY, prior)
    assert run("solve", path, "-o", tmp_path / "b.g2o").returncode == 0
    before, after = ((tmp_path / f).read_text().splitlines()[1] for f in ("a.g2o", "b.g2o"))
    assert before == after


@pytest.mark.parametrize("noise", [0.0, 1e-8, 1e-3, 0.1])
@pytest.mark.parametrize("loss", ["l2", "auto"])
def test_a_heavy_prior_alone_only_turns_a_component(noise: float, loss: Any) -> None:
    rng = np.random.default_rng(5)
    parts = [
        rotavg.simulate(kind, 100, noise=noise, seed=k) for k, kind in enumerate(("sphere", "grid"))
    ]
    graph = rotavg.MeasurementGraph(
        np.vstack([part.graph.edges + 1000 * k for k, part in enumerate(parts)]),
        np.concatenate([part.graph.rotations for part in parts]),
        rng.uniform(0.5, 2.0, sum(part.graph.num_edges for part in parts)),
    )
    free = rotavg.solve(graph, loss=loss)
    assert free.certificate is not None
    P = matrices_from_rotvecs(rng.normal(size=(2, 3)))
    for weight in (0.1, 1e12, 1e15):
        priors = rotavg.Priors(absolute={7: (P[0], weight), 1003: (P[1], weight)})
        held = rotavg.solve(graph, loss=loss, priors=priors)
        assert held.certificate is not None
        assert held.objective == pytest.approx(free.objective, rel=1e-9, abs=1e-20)
        assert held.certificate.verdict == free.certificate.verdict == rotavg.Verdict.PROVED
        np.testing.assert_allclose([held[7], held[1003]], P, atol=1e-8)
        for first, anchor in ((0, 7), (1000, 1003)):
            turned = held[anchor] @ free[anchor].T @ free[first]
            np.testing.assert_allclose(held[first], turned, atol=1e-7)
        if held.robust is not None and held.robust.absolute_priors is not None:
            fit = held.robust.absolute_priors
            assert fit.given_weights.tolist() == [weight] * 2
            np.testing.assert_allclose(fit.weights, weight, rtol=1e-6)
        if loss == "l2":  # how certain the world is depends on the prior as it was given
            spread = held.covariances(noise_variance=1.0)
            np.testing.assert_allclose(weight * spread[7], I3, atol=1e-3)


def test_priors_that_are_not_alone_keep_their_weights() -> None:
    graph = rotavg.simulate("sphere", 50, noise=0.1, seed=6).graph
    P = matrices_from_rotvecs(np.random.default_rng(6).normal(size=(3, 3)))
    known = {4: (P[0], 1e9), 9: (P[1], 2e9)}
    solution = rotavg.solve(graph, priors=rotavg.Priors(absolute=known))
    assert solution.grounded is not None
    assert solution.grounded.eased() is solution.grounded
    with_gravity = rotavg.Priors(absolute={4: (P[0], 1e9)}, gravity={2: ([0, 1, 0], 1e9)})
    grounded = rotavg.solve(graph, priors=with_gravity).grounded
    assert grounded is not None
    assert grounded.eased() is grounded


@pytest.mark.parametrize("loss", ["l2", "tls"])
def test_anisotropic_answers_with_a_heavy_prior(tmp_path: Path, loss: Any) -> None:
    scene = Scene(seed=7, noise=0.01)
    prior = g2o_prior(3, scene.R[3], scene.p[3], 1e12 * np.eye(6))
    graph = rotavg.read(scene.g2o(tmp_path / "a.g2o", IDENTITY, prior))
    priors = rotavg.read_priors(tmp_path / "a.g2o", graph)
    free = rotavg.solve(graph, loss=loss, anisotropic=True)
    held = rotavg.solve(graph, loss=loss, anisotropic=True, priors=priors)
    assert free.certificate is not None
    assert held.certificate is not None
    assert held.objective == pytest.approx(free.objective, rel=1e-9)
    assert held.certificate.verdict == free.certificate.verdict == rotavg.Verdict.PROVED
    np.testing.assert_allclose(held[3], scene.R[3], atol=1e-9)


def rotation_optimum(gtsam: Any, path: Path, start: Floats) -> Floats:
    """GTSAM's for the chordal objective of a g2o file's edges and priors, read by hand."""
    factors = gtsam.NonlinearFactorGraph()

    def read(fields: list[str]) -> tuple[Any, Any]:
        x, y, z, w = map(float, fields[3:7])
        omega = np.zeros((6, 6))
        omega[np.triu_indices(6)] = [float(f) for f in fields[7:]]
        omega = np.maximum(omega, omega.T) if (omega >= 0).all() else omega + np.triu(omega, 1).T
        weight = 3 / (2 * np.trace(np.linalg.inv(omega[3:, 3:])))
        noise = gtsam.noiseModel.Isotropic.Precision(9, 2 * weight)
        return gtsam.Rot3.Quaternion(w, x, y, z), noise

    for line in path.read_text().splitlines():
        tag, *fields = line.split()
        if tag == "EDGE_SE3:QUAT":
            pair = int(fields[0]), int(fields[1])
            factors.add(gtsam.FrobeniusBetweenFactorRot3(*pair, *read(fields[2:])))
        elif tag == "EDGE_SE3_PRIOR":
            Z, noise = read(fields[2:])
            factors.add(gtsam.FrobeniusPriorRot3(int(fields[0]), Z.matrix(), noise))
    values = gtsam.Values()
    for k, R in enumerate(start):
        values.insert(k, gtsam.Rot3(R))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-16)
    parameters.setAbsoluteErrorTol(1e-16)
    found = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters).optimize()
    return np.array([found.atRot3(k).matrix() for k in range(len(start))])


def test_the_optimum_is_that_of_gtsam(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason='pip install "rotavg[gtsam]"')
    scene = Scene(seed=8, n=20, noise=0.1)
    lines = [IDENTITY]
    for node in (2, 7, 11, 19):
        A = scene.rng.normal(size=(6, 6))
        R = scene.R[node] @ turn(*scene.rng.normal(scale=0.2, size=3))
        lines.append(g2o_prior(node, R, scene.p[node], 100 * (A @ A.T + np.eye(6))))
    path = scene.g2o(tmp_path / "a.g2o", *lines)
    graph = rotavg.read(path)
    solution = rotavg.solve(graph, priors=rotavg.read_priors(path, graph))
    optimum = rotation_optimum(gtsam, path, scene.R)
    np.testing.assert_allclose(solution.rotations, optimum, atol=1e-6)
    without = rotavg.solve(graph)  # which is another answer
    turned = solution[0] @ without[0].T @ without.rotations
    assert np.abs(turned - optimum).max() > 1e-3


def test_refined_poses_are_those_of_gtsam(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam", reason='pip install "rotavg[gtsam]"')
    scene = Scene(seed=9, n=10, noise=0.05)
    priors = [prior_factor(3, scene.R[3], scene.p[3], 1e-12 * np.eye(6))]
    for node in (1, 8):
        place = scene.p[node] + scene.rng.normal(scale=0.1, size=3)
        priors.append(prior_factor(node, scene.R[node], place, 0.01 * np.eye(6)))
    path = scene.jrl(tmp_path / "a.jrl", *priors)
    factors = gtsam.NonlinearFactorGraph()
    for entry in json.loads(path.read_text())["measurements"]["a"][0]["measurements"]:
        told = entry.get("prior") or entry["measurement"]
        at = gtsam.Pose3(gtsam.Rot3.Quaternion(*told["rotation"]), np.array(told["translation"]))
        covariance = np.reshape(entry["covariance"], (6, 6))
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        if "prior" in entry:
            factors.add(gtsam.PriorFactorPose3(entry["key"], at, noise))
        else:
            factors.add(gtsam.BetweenFactorPose3(entry["key1"], entry["key2"], at, noise))
    graph = rotavg.read(path)
    poses = rotavg.refine_poses(rotavg.solve(graph, priors=rotavg.read_priors(path, graph)))
    values = gtsam.Values()
    for k in range(10):
        values.insert(k, gtsam.Pose3(gtsam.Rot3(scene.R[k]), scene.p[k]))
    optimum = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    for k in range(10):
        np.testing.assert_allclose(
            poses.rotations[k], optimum.atPose3(k).rotation().matrix(), atol=1e-4
        )
        np.testing.assert_allclose(poses.positions[k], optimum.atPose3(k).translation(), atol=1e-4)


def test_positions_alone_place_refined_poses(tmp_path: Path) -> None:
    scene = Scene(seed=10)
    priors = [
        f"EDGE_SE3_XYZ_PRIOR {k} 5 {numbers(p)} {upper(4.0 * I3)}" for k, p in enumerate(scene.p)
    ]
    path = scene.g2o(tmp_path / "a.g2o", *priors)
    graph = rotavg.read(path)
    known = rotavg.read_priors(path, graph)
    assert not known.absolute
    np.testing.assert_array_equal(known.positions[2][0], scene.p[2])
    np.testing.assert_array_equal(known.positions[2][1], 4 * I3)
    done = run("solve", path, "--refine-poses", "-o", tmp_path / "b.g2o")
    assert done.returncode == 0, done.stderr
    assert "note: priors of 8 positions (which count with --refine-poses), as" in done.stderr
    again = rotavg.read(tmp_path / "b.g2o").source.vertices  # type: ignore[union-attr]
    np.testing.assert_allclose([again[k][:3] for k in range(8)], scene.p, atol=1e-6)
    ids, rotations = rotavg.read_rotations(tmp_path / "b.g2o")
    np.testing.assert_allclose(rotations[np.argsort(ids)], scene.R, atol=1e-6)


def test_a_given_rotation_stands_before_a_prior(tmp_path: Path) -> None:
    scene = Scene(seed=16)
    prior = g2o_prior(3, turn(1, 0, 0), [0, 0, 0], np.eye(6))
    path = scene.g2o(tmp_path / "a.g2o", IDENTITY, prior)
    (tmp_path / "known.txt").write_text("# id qx qy qz qw\n3 0 0 0 1\n")
    done = run("solve", path, "--fixed", tmp_path / "known.txt", "-o", tmp_path / "b.csv")
    assert done.returncode == 0, done.stderr
    assert "1 fixed" in done.stdout
    ids, rotations = rotavg.read_rotations(tmp_path / "b.csv")
    np.testing.assert_allclose(dict(zip(ids, rotations))[3], I3, atol=1e-9)


def test_standard_input_has_its_priors(tmp_path: Path) -> None:
    scene = Scene(seed=21)
    prior = g2o_prior(3, scene.R[3], scene.p[3], np.eye(6))
    path = scene.g2o(tmp_path / "a.g2o", IDENTITY, prior)
    command = [sys.executable, "-m", "rotavg", "solve", "-", "-o", str(tmp_path / "b.csv")]
    done = subprocess.run(command, input=path.read_bytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    ids, rotations = rotavg.read_rotations(tmp_path / "b.csv")
    np.testing.assert_allclose(dict(zip(ids, rotations))[5], scene.R[5], atol=1e-8)
