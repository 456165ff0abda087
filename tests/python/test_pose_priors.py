"""Priors that stand in the files of pose graphs: what they say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from pose_prior_files import (
    I3,
    IDENTITY,
    Scene,
    g2o_prior,
    numbers,
    pose,
    prior_factor,
    run,
    turn,
    upper,
    value,
)


def test_three_formats_say_the_same(tmp_path: Path) -> None:
    scene = Scene(seed=1)
    A = scene.rng.normal(size=(6, 6))
    omega = A @ A.T + np.eye(6)
    R, p = turn(0.3, -0.2, 0.9), np.array([1.0, -2.0, 3.0])
    covariance = np.linalg.inv(omega)
    files: dict[Path, Any] = {
        scene.g2o(tmp_path / "a.g2o", IDENTITY, g2o_prior(3, R, p, omega)): 3,
        scene.jrl(tmp_path / "a.jrl", prior_factor(3, R, p, covariance)): 3,
        scene.pyfg(
            tmp_path / "a.pyfg",
            f"VERTEX_SE3:QUAT:PRIOR 0.5 A3 {pose(R, p)} {upper(covariance)}",
        ): "A3",
    }
    for path, node in files.items():
        graph = rotavg.read(path)
        line = f"rotavg.solve(graph, priors=rotavg.read_priors({str(path)!r}, graph))"
        assert graph.notes == (
            f"1 prior of poses; `rotavg solve` uses them where it can, in Python {line}",
        )
        assert eval(line, {"rotavg": rotavg, "graph": graph}).grounded is not None
        priors = rotavg.read_priors(path, graph)
        assert not priors.fixed
        assert list(priors.absolute) == list(priors.positions) == [node]
        found, weight = priors.absolute[node]
        np.testing.assert_allclose(found, R, atol=1e-12)
        about = omega[3:, 3:]  # the edges' weights, too, take the rotation's block of it
        assert weight == pytest.approx(1.5 / np.trace(np.linalg.inv(about)), rel=1e-9)
        where, information = priors.positions[node]
        np.testing.assert_allclose(where, p, atol=1e-12)
        np.testing.assert_allclose(information, R @ omega[:3, :3] @ R.T, rtol=1e-9)
        assert rotavg.read_priors(path, graph, unit_weights=True).absolute[node][1] == 1
        others = rotavg.MeasurementGraph([("x", "y")], [I3])
        assert not rotavg.read_priors(path, others).absolute


def test_without_information_about_the_rotation(tmp_path: Path) -> None:
    scene = Scene(seed=11)
    omega = np.diag([1.0, 2.0, 3.0, 0, 0, 0])
    path = scene.g2o(tmp_path / "a.g2o", IDENTITY, g2o_prior(3, turn(1, 2, 3), [1, 2, 3], omega))
    priors = rotavg.read_priors(path, rotavg.read(path), unit_weights=True)
    assert not priors.absolute
    assert list(priors.positions) == [3]
    rotation_only = np.diag([0, 0, 0, 5.0, 5.0, 5.0])
    path = scene.g2o(tmp_path / "b.g2o", IDENTITY, g2o_prior(3, I3, [1, 2, 3], rotation_only))
    priors = rotavg.read_priors(path, rotavg.read(path))
    assert priors.absolute[3][1] == pytest.approx(2.5)
    assert not priors.positions


def test_several_priors_of_a_node_become_one(tmp_path: Path) -> None:
    scene = Scene(seed=12)
    R = turn(0.1, 0.2, 0.3)
    one, two = scene.information(3.0), scene.information(5.0)
    gps = np.array([1e6, 2e6, 3.0]), np.array([1e6 + 1, 2e6, 5.0]), np.array([1e6, 2e6 - 1, 4.0])
    path = scene.g2o(
        tmp_path / "a.g2o",
        IDENTITY,
        g2o_prior(3, R, gps[0], one),
        g2o_prior(3, R, gps[1], two),
        f"EDGE_SE3_XYZ_PRIOR 3 0 {numbers(gps[2])} {upper(2.0 * I3)}",
    )
    priors = rotavg.read_priors(path, rotavg.read(path))
    assert priors.absolute[3][1] == pytest.approx((one[3, 3] + two[3, 3]) / 2)
    omegas = [R @ one[:3, :3] @ R.T, R @ two[:3, :3] @ R.T, 2.0 * I3]
    where, omega = priors.positions[3]
    np.testing.assert_allclose(omega, sum(omegas), rtol=1e-12)
    for place in where + scene.rng.normal(size=(5, 3)):  # the same up to a constant

        def cost(at: Any, pairs: Any) -> float:
            return float(sum((at - p) @ o @ (at - p) for p, o in pairs))

        apart = cost(place, zip(gps, omegas)) - cost(where, zip(gps, omegas))
        assert apart == pytest.approx(cost(place, [(where, omega)]), rel=1e-6)


def test_two_rotations_of_a_node_are_refused_by_both_places(tmp_path: Path) -> None:
    scene = Scene(seed=13)
    both = [turn(0.1, 0, 0), turn(0.1001, 0, 0)]
    priors = [g2o_prior(3, R, [0, 0, 0], np.eye(6)) for R in both]
    path = scene.g2o(tmp_path / "a.g2o", IDENTITY, *priors, vertices=False)
    graph = rotavg.read(path)
    told = (
        r"a\.g2o:19: the prior is a second prior of node 3, of another rotation than that in line "
        r"18; expected one at most"
    )
    with pytest.raises(rotavg.FormatError, match=told):
        rotavg.read_priors(path, graph)
    done = run("solve", path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "a.g2o:19: the prior is a second prior" in done.stderr
    assert "Traceback" not in done.stderr
    assert run("solve", path, "--no-priors").returncode == 0
    path = scene.jrl(tmp_path / "a.jrl", *(prior_factor(3, R, [0, 0, 0], np.eye(6)) for R in both))
    place = r"measurements\.a\[0\]\.measurements\[1{}\]"
    told = rf"{place.format(7)} is a second prior of node 3, .* than {place.format(6)}; expected"
    with pytest.raises(rotavg.FormatError, match=told):
        rotavg.read_priors(path, rotavg.read(path))


def test_offsets(tmp_path: Path) -> None:
    scene = Scene(seed=14, noise=0.01)
    turned, arm = turn(0.4, -1.0, 0.2), np.array([0.1, 0.2, 0.3])
    omega = scene.information(1e3)
    A = scene.rng.normal(size=(3, 3))
    omega[3:, 3:] = 1e3 * (A @ A.T + I3)
    R = scene.R[3]
    path = scene.g2o(
        tmp_path / "a.g2o",
        f"PARAMS_SE3OFFSET 7 {pose(turned, [0, 0, 0])}",
        g2o_prior(3, R @ turned, scene.p[3], omega, parameter=7),
    )
    priors = rotavg.read_priors(path, rotavg.read(path))
    np.testing.assert_allclose(priors.absolute[3][0], R, atol=1e-12)
    kappa = 1.5 / np.trace(np.linalg.inv(omega[3:, 3:]))
    assert priors.absolute[3][1] == pytest.approx(kappa)
    seen = R @ turned
    np.testing.assert_allclose(priors.positions[3][0], scene.p[3])
    np.testing.assert_allclose(priors.positions[3][1], seen @ omega[:3, :3] @ seen.T, rtol=1e-9)
    path = scene.g2o(
        tmp_path / "b.g2o",
        f"PARAMS_SE3OFFSET 7 {pose(turned, arm)}",
        g2o_prior(3, R @ turned, scene.p[3] + R @ arm, omega, parameter=7),
    )
    graph = rotavg.read(path)
    with pytest.warns(rotavg.IncompleteWarning, match="what 1 prior says of positions is not used"):
        priors = rotavg.read_priors(path, graph)
    np.testing.assert_allclose(priors.absolute[3][0], R, atol=1e-12)
    assert not priors.positions


def test_the_plane(tmp_path: Path) -> None:
    edges = [f"EDGE_SE2 {i} {i + 1} 1 0 0.3 100 0 0 100 0 50" for i in range(3)]
    path = tmp_path / "a.g2o"
    gps = "EDGE_PRIOR_SE2_XY 3 5 6 2 0.5 4"
    path.write_text("\n".join([*edges, "EDGE_PRIOR_SE2 1 7 8 0.5 3 1 0 5 0 20", gps]) + "\n")
    graph = rotavg.read(path)
    priors = rotavg.read_priors(path, graph)
    np.testing.assert_allclose(priors.absolute[1][0], turn(0, 0, 0.5), atol=1e-12)
    assert priors.absolute[1][1] == pytest.approx(10)  # half the information, as of edges
    solution = rotavg.solve(graph, priors=priors)
    for node in range(4):
        expected = turn(0, 0, 0.5 + 0.3 * (node - 1))
        np.testing.assert_allclose(solution[node], expected, atol=1e-9)
    where, omega = priors.positions[1]
    assert where.tolist() == [7, 8, 0]
    turned = turn(0, 0, 0.5)[:2, :2]
    np.testing.assert_allclose(omega[:2, :2], turned @ [[3, 1], [1, 5]] @ turned.T)
    assert omega[2].tolist() == pytest.approx([0, 0, 4])
    np.testing.assert_allclose(priors.positions[3][1], [[2, 0.5, 0], [0.5, 4, 0], [0, 0, 3]])
    pyfg, jrl = tmp_path / "a.pyfg", tmp_path / "a.jrl"
    pyfg.write_text(
        "EDGE_SE2 0 A0 A1 1 0 0.3 .01 0 0 .01 0 .02\n"
        "VERTEX_SE2:PRIOR 0 A1 7 8 0.5 .2 0 0 .2 0 .05\n"
    )
    flat = {"type": "Pose2", "x": 1, "y": 0, "theta": 0.3}
    eye = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    between = {"type": "BetweenFactorPose2", "key1": 0, "key2": 1, "measurement": flat}
    prior = {"type": "PriorFactorRot2", "key": 1, "prior": {"type": "Rot2", "theta": 0.5}}
    of_space = prior_factor(1, I3, [0, 0, 0], np.eye(6))
    log = [{**between, "covariance": eye}, {**prior, "covariance": [0.05]}, of_space]
    jrl.write_text(json.dumps({"measurements": {"a": [{"stamp": 0, "measurements": log}]}}))
    for file, node in ((pyfg, "A1"), (jrl, 1)):
        graph = rotavg.read(file)
        P, weight = rotavg.read_priors(file, graph).absolute[node]
        np.testing.assert_allclose(P, turn(0, 0, 0.5), atol=1e-12)
        assert weight == pytest.approx(10)
    assert graph.notes[0] == "1 other measurements skipped (PriorFactorPose3: 1)"


def test_rotations_in_jrl(tmp_path: Path) -> None:
    scene = Scene(seed=15)
    R = turn(0.1, 0.7, -0.4)
    told = {"type": "Rot3", "rotation": value(R, [0])["rotation"]}
    prior = {
        "type": "PriorFactorRot3",
        "key": 2,
        "prior": told,
        "covariance": (0.1 * I3).ravel().tolist(),
    }
    path = scene.jrl(tmp_path / "a.jrl", prior)
    priors = rotavg.read_priors(path, rotavg.read(path))
    np.testing.assert_allclose(priors.absolute[2][0], R, atol=1e-12)
    assert priors.absolute[2][1] == pytest.approx(5)
    assert not priors.positions


UNIT = upper(np.eye(6))


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (
            [f"EDGE_SE3_PRIOR 3 0 0 0 0 0 0 0 1 {UNIT}"],
            r"1: found the parameter 0, expected a line PAR",
        ),
        (
            [IDENTITY, f"EDGE_SE3_PRIOR 3 0 0 0 0 0 0 0 {UNIT}"],
            "2: found 27 numbers .* expected 28",
        ),
        ([IDENTITY, "EDGE_SE3_PRIOR 3"], "2: found only 1 values after"),
        ([IDENTITY, f"EDGE_SE3_PRIOR x 0 0 0 0 0 0 0 1 {UNIT}"], "2: found 'x'"),
        ([IDENTITY, f"EDGE_SE3_PRIOR 3 0 0 0 y 0 0 0 1 {UNIT}"], "2: found 'y', expected a number"),
        (
            [IDENTITY, f"EDGE_SE3_PRIOR 3 0 nan 0 0 0 0 0 1 {UNIT}"],
            "2: found nan, expected a finite",
        ),
        ([IDENTITY, f"EDGE_SE3_PRIOR 3 0 0 0 0 0 0 0 0 {UNIT}"], "2: the quaternion is zero"),
        (
            [IDENTITY, f"EDGE_SE3_PRIOR 3 0 0 0 0 0 0 0 2 {UNIT}"],
            "2: found a quaternion of length 2",
        ),
        (
            [IDENTITY, g2o_prior(3, I3, [0, 0, 0], np.diag([1.0, 1, 1, 1, 1, 0]))],
            "2: the prior has information about some rotations alone",
        ),
        (["EDGE_SE3_XYZ_PRIOR 3 0 1 2 3 1 0 0 1 0"], "1: found 8 numbers"),
        (["PARAMS_SE3OFFSET 0 1", g2o_prior(3, I3, [0, 0, 0], np.eye(6))], "1: found 1 numbers"),
    ],
)
def test_malformed_priors_of_g2o_name_their_lines(
    tmp_path: Path, lines: list[str], told: str
) -> None:
    path = Scene(seed=17).g2o(tmp_path / "a.g2o", vertices=False)
    path.write_text("\n".join([*lines, path.read_text()]))
    graph = rotavg.read(path)
    with pytest.raises(rotavg.FormatError, match=rf"a\.g2o:{told}"):
        rotavg.read_priors(path, graph)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("VERTEX_SE3:QUAT:PRIOR 0.5", "expected a time and a name after the tag"),
        (f"VERTEX_SE3:QUAT:PRIOR 0.5 A3 0 0 0 0 0 0 {UNIT}", "found 27 numbers"),
        (
            f"VERTEX_SE3:QUAT:PRIOR 0.5 A3 0 0 0 0 0 0 1 {numbers(np.zeros(21))}",
            "covariance is not pos",
        ),
        (f"VERTEX_SE3:QUAT:PRIOR 0.5 A3 0 0 0 0 0 0 3 {UNIT}", "found a quaternion of length 3"),
    ],
)
def test_malformed_priors_of_pyfg_name_their_lines(tmp_path: Path, line: str, told: str) -> None:
    path = Scene(seed=18).pyfg(tmp_path / "a.pyfg", line)
    graph = rotavg.read(path)
    with pytest.raises(rotavg.FormatError, match=rf"a\.pyfg:17: .*{told}"):
        rotavg.read_priors(path, graph)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"key": "x"}, r"measurements\[16\]\.key: found 'x', expected an integer"),
        ({"prior": {"translation": [0, 0, 0]}}, r'\[16\]\.prior: .* an object with "rotation"'),
        ({"covariance": [1.0]}, r"\[16\]\.covariance: .* expected 36 numbers"),
        ({"covariance": [0.0] * 36}, r"\[16\]: the covariance is not positive definite"),
    ],
)
def test_malformed_priors_of_jrl_name_their_places(
    tmp_path: Path, change: dict[str, Any], told: str
) -> None:
    prior = {**prior_factor(3, I3, [0, 0, 0], np.eye(6)), **change}
    path = Scene(seed=19).jrl(tmp_path / "a.jrl", prior)
    graph = rotavg.read(path)
    with pytest.raises(rotavg.FormatError, match=rf"a\.jrl: measurements\.a\[0\]\..*{told}"):
        rotavg.read_priors(path, graph)


def test_what_is_no_prior_of_a_pose_stays_counted(tmp_path: Path) -> None:
    scene = Scene(seed=20)
    path = scene.g2o(
        tmp_path / "a.g2o",
        IDENTITY,
        "EDGE_SE3_PRIORXYZ 3 1 2 3 1 0 0 1 0 1",
        "EDGE_PRIOR_SE2 1 7 8 0.5 3 1 0 5 0 20",
        "EDGE_POINTXYZ_PRIOR 99 1 2 3 1 0 0 1 0 1",
    )
    graph = rotavg.read(path)
    (note,) = graph.notes
    assert note.startswith("4 lines with unknown tags skipped (")
    for tag in ("EDGE_SE3_PRIORXYZ", "EDGE_PRIOR_SE2", "EDGE_POINTXYZ_PRIOR", "PARAMS_SE3OFFSET"):
        assert f"{tag}: 1" in note
    assert not rotavg.read_priors(path, graph).absolute
    path = scene.pyfg(tmp_path / "a.pyfg", "VERTEX_XYZ:PRIOR 0 L1 1 2 3 1 0 0 1 0 1")
    assert rotavg.read(path).notes == ("1 other lines skipped (VERTEX_XYZ:PRIOR: 1)",)
    point = {"type": "PriorFactorPoint3", "key": 3, "prior": {}, "covariance": []}
    path = scene.jrl(tmp_path / "a.jrl", point)
    assert rotavg.read(path).notes == ("1 other measurements skipped (PriorFactorPoint3: 1)",)


def test_priors_go_with_their_nodes(tmp_path: Path) -> None:
    scene = Scene(seed=22)
    lines = [g2o_prior(k, scene.R[k], scene.p[k], np.eye(6)) for k in (0, 3)]
    path = scene.g2o(tmp_path / "a.g2o", IDENTITY, *lines)
    graph = rotavg.read(path)
    rotavg.write(tmp_path / "b.g2o", graph.subgraph([0, 1, 2]))
    assert (tmp_path / "b.g2o").read_text().splitlines()[-2:] == [IDENTITY, lines[0]]
    done = run("convert", path, tmp_path / "c.csv")
    assert done.returncode == 0
    assert "2 priors of poses not in it" in done.stderr + done.stdout
    done = run("convert", path, tmp_path / "c.g2o")
    assert "not in it" not in done.stderr + done.stdout
    assert (tmp_path / "c.g2o").read_bytes() == path.read_bytes()
