"""Rigs some of whose sensors are where nobody knows; rigs from files; who adds what."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices

Array = NDArray[np.float64]


class Scene:
    """Node "left/003" is sensor "left" in frame 3."""

    def __init__(self, seed: int, noise: float = 0.0, wrong: float = 0.0, frames: int = 8) -> None:
        rng = np.random.default_rng(seed)
        names = ("left", "middle", "right")
        turns = matrices_from_rotvecs(rng.normal(size=(frames, 3)))
        self.C = dict(zip(names, matrices_from_rotvecs(rng.normal(size=(3, 3)) * [[0], [1], [1]])))
        self.images = {f"{s}/{f:03}": (f, s) for f in range(frames) for s in names}
        self.truth = {k: turns[f] @ self.C[s] for k, (f, s) in self.images.items()}
        edges, R = [], []
        nodes = list(self.images)
        for a, i in enumerate(nodes):
            for j in nodes[a + 1 :]:
                if self.images[i][0] != self.images[j][0] and rng.random() < 0.5:
                    turn = rng.normal(size=3) * (3 if rng.random() < wrong else noise)
                    edges.append((i, j))
                    R.append(self.truth[i].T @ self.truth[j] @ matrices_from_rotvecs(turn))
        self.graph = rotavg.MeasurementGraph(edges, np.array(R))

    def error(self, solution: rotavg.Solution) -> float:
        """RMS over nodes, degrees, at the best common turn."""
        return float(np.degrees(rotavg.compare(solution, self.truth).rms))


def sensors_off(solution: rotavg.Solution, C: dict[str, Array]) -> float:
    assert solution.rigs is not None
    found = solution.rigs.rotation_of
    return max(float(np.linalg.norm(found[s] - C[s])) for s in C)


def test_unknown_sensors_are_found_with_the_frames() -> None:
    scene = Scene(1)
    rigs = rotavg.Rigs(scene.images)
    solution = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=rigs))
    fit = solution.rigs
    assert fit is not None
    assert fit.sensors == ("left", "middle", "right")
    assert fit.origin == ("reference", "estimated", "estimated")
    assert fit.determined.all()
    assert fit.alone == ()
    assert sensors_off(solution, scene.C) < 1e-12
    assert "proved for frames and sensors together" in str(solution)
    assert "of the frames with the estimated sensors held" in str(solution)
    for node, (frame, sensor) in scene.images.items():
        np.testing.assert_allclose(
            fit.frames[frame] @ fit.rotation_of[sensor], solution[node], atol=1e-12
        )
    again = rotavg.certify(scene.graph, solution.rotations, priors=fit.priors)
    assert again.verdict == rotavg.Verdict.PROVED


@pytest.mark.parametrize("seed", range(5))
def test_rigs_beat_separate_cameras_with_noise_and_outliers(seed: int) -> None:
    scene = Scene(seed, noise=0.03, wrong=0.2, frames=15)
    rigs = rotavg.Rigs(scene.images, {"left": np.eye(3)})
    solution = rotavg.solve(scene.graph, loss="auto", priors=rotavg.Priors(rigs=rigs))
    plain = rotavg.solve(scene.graph, loss="auto")
    assert scene.error(solution) < scene.error(plain)
    assert solution.solved
    fit = solution.rigs
    assert fit is not None
    assert fit.joint_gap is not None
    assert fit.lower_bound is not None
    assert 0 < fit.lower_bound < solution.objective
    assert "other sensors could lower the objective of the rigs by at most" in fit.sentence


def test_the_lower_bound_is_below_every_other_answer() -> None:
    scene = Scene(3, noise=0.05)
    solution = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=rotavg.Rigs(scene.images)))
    assert solution.rigs is not None
    bound = solution.rigs.lower_bound
    plain = rotavg.solve(scene.graph)
    assert plain.certificate is not None
    assert bound is not None
    assert bound <= plain.objective
    assert bound == pytest.approx(plain.objective - plain.certificate.gap, rel=1e-9)
    # No sensor can be turned to advantage.
    C = solution.rigs.rotation_of
    for axis in np.eye(3):
        for step in (-1e-3, 1e-3):
            turned = {**C, "right": matrices_from_rotvecs(step * axis) @ C["right"]}
            held = {node: (f, turned[s]) for node, (f, s) in scene.images.items()}
            other = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=held))
            assert other.objective > solution.objective


def test_known_sensors_are_kept_bit_by_bit() -> None:
    scene = Scene(4, noise=0.02)
    given = scene.C["middle"] + 1e-9  # a rotation to rounding only
    rigs = rotavg.Rigs(scene.images, {"middle": given})
    solution = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=rigs))
    assert solution.rigs is not None
    assert solution.rigs.origin == ("estimated", "known", "estimated")
    assert (solution.rigs.rotation_of["middle"] == given).all()
    assert sensors_off(solution, scene.C) < 0.1
    known = rotavg.Rigs(scene.images, scene.C)
    all_known = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=known))
    cameras = {node: (f, scene.C[s]) for node, (f, s) in scene.images.items()}
    as_ever = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=cameras))
    assert (all_known.rotations == as_ever.rotations).all()
    assert all_known.rigs is not None
    assert all_known.rigs.lower_bound is None


def test_threads_and_repetition_change_no_bit() -> None:
    scene = Scene(5, noise=0.03, wrong=0.2)
    priors = rotavg.Priors(rigs=rotavg.Rigs(scene.images))
    first = rotavg.solve(scene.graph, loss="auto", priors=priors, num_threads=1)
    for threads in (1, 2, 3):
        again = rotavg.solve(scene.graph, loss="auto", priors=priors, num_threads=threads)
        assert (again.rotations == first.rotations).all()
        assert again.rigs is not None
        assert first.rigs is not None
        assert (again.rigs.rotations == first.rigs.rotations).all()


def test_a_sensor_in_no_frame_with_another_is_told() -> None:
    scene = Scene(6)
    images = {k: v for k, v in scene.images.items() if v[1] != "middle"}
    images |= {k: (100 + f, s) for k, (f, s) in scene.images.items() if s == "middle"}
    solution = rotavg.solve(scene.graph, priors=rotavg.Priors(rigs=rotavg.Rigs(images)))
    assert solution.rigs is not None
    assert solution.rigs.alone == ("middle",)
    assert "in no frame with another: 'middle'" in solution.rigs.sentence
    assert scene.error(solution) < 1e-5


def test_several_rigs_and_gravity() -> None:
    scene = Scene(7, noise=0.01)
    names = {s: f"{s} of rig {k}" for k in (0, 1) for s in scene.C}
    images = {k: (f, f"{s} of rig {f % 2}") for k, (f, s) in scene.images.items()}
    assert names
    down = {k: (R.T @ [0, 1, 0], 1.0) for k, R in scene.truth.items()}
    priors = rotavg.Priors(rigs=rotavg.Rigs(images), gravity=down)
    solution = rotavg.solve(scene.graph, priors=priors)
    assert solution.rigs is not None
    assert solution.rigs.origin.count("reference") == 2
    assert solution.solved
    tilt = [np.degrees(np.arccos(min(1, (R @ down[k][0])[1]))) for k, R in solution.items()]
    assert max(tilt) < 3
    assert scene.error(solution) < 1


def test_what_cannot_be_is_refused() -> None:
    scene = Scene(8)
    nodes = list(scene.images)

    def refused(message: str, images: Any, rotations: Any = None, **others: Any) -> None:
        def build_and_solve() -> None:
            priors = rotavg.Priors(rigs=rotavg.Rigs(images, rotations or {}), **others)
            rotavg.solve(scene.graph, priors=priors)

        with pytest.raises(rotavg.GraphError, match=message):
            build_and_solve()

    refused("rig prior of node 'x': it is not in the graph", {"x": (0, 0)})
    refused("is 3, expected a pair of frame and sensor", {nodes[0]: 3})
    refused(r"has the sensor \[1\], expected an integer or a name", {nodes[0]: (0, [1])})
    twice = {nodes[0]: (0, "a"), nodes[1]: (0, "a")}
    refused(f"{nodes[1]}' is the second of its sensor in one frame", twice)
    refused("rotation of sensor 'left' is not a rotation", scene.images, {"left": 2 * np.eye(3)})
    refused("have no images", {})
    refused("images of rigs are no mapping", [1])
    one_frame = {node: (0, node) for node in nodes}
    refused("all edges are between cameras of one frame", one_frame)
    fixed = {"right/000": np.eye(3)}
    refused("whose sensor has no known rotation", scene.images, fixed=fixed)
    # What needs no graph is told before there is one.
    for message, images, rotations in (
        ("is 3, expected a pair", {"a": 3}, {}),
        ("node 'b' is the second of its sensor", {"a": (0, "l"), "b": (0, "l")}, {}),
        ("'left' is not a rotation: R\\^T R differs", scene.images, {"left": 2 * np.eye(3)}),
        ("'left' is not a rotation: its determinant is -1", scene.images, {"left": -np.eye(3)}),
        ("'left' has shape", scene.images, {"left": np.eye(2)}),
        (r"no image has a sensor whose rotation is given \('Left'\); there are 'left', 'middle'",
         scene.images, {"Left": np.eye(3)}),
    ):  # fmt: skip
        with pytest.raises(rotavg.GraphError, match=message):
            rotavg.Rigs(images, rotations)
    rigs = rotavg.Rigs(scene.images, {"left": np.eye(3)})
    with pytest.raises(rotavg.GraphError, match="node 'right/000' is of an image whose sensor has"):
        rotavg.Priors(fixed=fixed, rigs=rigs)
    rotavg.Priors(fixed={"left/000": np.eye(3)}, rigs=rigs)
    priors = rotavg.Priors(rigs=rotavg.Rigs(scene.images))
    with pytest.raises(rotavg.GraphError, match="rotation of sensor 'left' is not known"):
        rotavg.certify(scene.graph, np.array([np.eye(3)] * 24), priors=priors)


def cli(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rotavg", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_rigs_from_files(tmp_path: Path) -> None:
    scene = Scene(9, noise=0.01)
    graph = tmp_path / "graph.csv"
    rotavg.write(graph, scene.graph)
    q = np.roll(quaternions_from_matrices(scene.C["right"].T), 1).tolist()  # cam_from_rig, w first
    cameras = [
        {"image_prefix": "left/", "ref_sensor": True},
        {"image_prefix": "middle/"},
        {"image_prefix": "right/", "cam_from_rig_rotation": q, "cam_from_rig_translation": [0] * 3},
    ]
    config = tmp_path / "rig_config.json"
    config.write_text(json.dumps([{"cameras": cameras}]))
    rigs = rotavg.read_rigs(config, scene.graph)
    assert rigs.images["middle/003"] == ("rig 1: 003", "middle/")
    np.testing.assert_allclose(rigs.rotations["right/"], scene.C["right"], atol=1e-14)
    table = tmp_path / "rigs.csv"
    rows = ["node,frame,sensor,qw,qx,qy,qz", "left/000,0,left,1,0,0,0"]
    rows += [f"{k},{f},{s},,,," for k, (f, s) in scene.images.items() if k != "left/000"]
    table.write_text("\n".join([*rows, "elsewhere,0,left,,,,", ""]))
    found = {}
    for path, known in ((config, 2), (table, 1)):
        result = cli("solve", str(graph), "--rigs", str(path), "--json")
        assert result.returncode == 0, result.stderr
        summary = json.loads(result.stdout)["rigs"]
        found[path] = {s["sensor"].strip("/"): s for s in summary["sensors"]}
        assert [s["origin"] for s in summary["sensors"]].count("known") == known
        assert summary["frames"] == 8
    for s in ("middle", "right"):
        q = found[table][s]["rig_from_sensor_xyzw"]
        expected = quaternions_from_matrices(scene.C[s])
        assert abs(float(np.dot(q, expected))) > np.cos(0.02)
    for text, message in (
        ("[1]", "rig 1 has no list of cameras"),
        ("{", "no JSON"),
        ('[{"cameras": [{}]}]', "rig 1, camera 1: found no image_prefix"),
        ('[{"cameras": [{"image_prefix": "left/"}]}]', "rig 1 has 0 reference sensors"),
        (json.dumps([{"cameras": [cameras[0], cameras[0]]}]), "'left/' stands twice"),
        ("node,frame\n", "found no header node,frame,sensor"),
        ("node,frame,sensor\nleft/000,1\n", ":2: found 2 fields, expected 3"),
        ("node,frame,sensor\nleft/000,1,a\nleft/000,2,a\n", ":3: the node 'left/000' stands"),
        (rows[0] + "\nleft/000,0,left,2,0,0,0\n", "expected a unit quaternion w x y z"),
        ("node,frame,sensor\nx,1,a\n", "none of the nodes in the file is in the graph"),
        (
            "node,frame,sensor\nleft/000,1,a\nleft/001,1,a\n",
            ":3: the node 'left/001' is the second of sensor 'a' in one frame, before in line 2",
        ),
    ):
        config.write_text(text)
        result = cli("solve", str(graph), "--rigs", str(config))
        assert result.returncode == 2
        assert message in " ".join(result.stderr.split()), (message, result.stderr)
    assert cli("solve", str(graph), "--rigs", str(table), "--no-rigs").returncode == 2
    text = table.read_text()
    table.write_text(text + "far/1,0,tele,,,,\n")
    config.write_text(json.dumps([{"cameras": [*cameras, {"image_prefix": "tele/"}]}]))
    for path in (table, config):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            rotavg.read_rigs(path, scene.graph)
        assert any("no image of 1 of the sensors: 'tele" in str(w.message) for w in caught)
    told = cli("solve", str(graph), "--rigs", str(table)).stderr
    assert "2 of 26 nodes are not in the graph" in told


def test_tables_of_rigs_may_have_semicolons(tmp_path: Path) -> None:
    graph = rotavg.MeasurementGraph([(0, 1), (1, 2)], [np.eye(3)] * 2)
    path = tmp_path / "rigs.csv"
    path.write_text("node;frame;sensor\n0;f;l\n1;f;r\n2;g;l\n")
    rigs = rotavg.read_rigs(path, graph)
    assert rigs.images == {0: ("f", "l"), 1: ("f", "r"), 2: ("g", "l")}
    path.write_text("")
    with pytest.raises(rotavg.FormatError, match="the file is empty, expected rigs"):
        rotavg.read_rigs(path, graph)


def test_who_adds_what(tmp_path: Path) -> None:
    scene = Scene(10, noise=0.02, wrong=0.1)
    priors = rotavg.Priors(rigs=rotavg.Rigs(scene.images))
    solution = rotavg.solve(scene.graph, loss="auto", priors=priors)
    diagnosis = rotavg.diagnose(solution)
    assert diagnosis.edge_costs.sum() == pytest.approx(solution.objective, rel=1e-9)
    for shares in (diagnosis.nodes, diagnosis.frames, diagnosis.sensors):
        assert sum(s.cost for s in shares.values()) == pytest.approx(solution.objective, rel=1e-9)
        assert sum(s.share for s in shares.values()) == pytest.approx(1)
    assert sum(s.edges for s in diagnosis.nodes.values()) == 2 * scene.graph.num_edges
    assert list(diagnosis.sensors) == ["left", "middle", "right"]
    rows = diagnosis.contradictions()
    assert sorted(rows) == np.flatnonzero(solution.is_outlier).tolist()
    assert (np.diff(solution.residual_angles[rows]) <= 0).all()
    assert diagnosis.contradictions(2) == rows[:2]
    path = tmp_path / "who.csv"
    rotavg.write_diagnostics(path, solution)
    lines = path.read_text().splitlines()
    assert lines[0].startswith("kind,id,edges,outliers,cost")
    assert len(lines) == 1 + 24 + 8 + 3
    gravity = {k: (R.T @ [0, 1, 0], 5.0) for k, R in scene.truth.items()}
    tilted = rotavg.solve(scene.graph, priors=rotavg.Priors(gravity=gravity))
    costs = rotavg.diagnose(tilted).node_costs
    assert costs.sum() == pytest.approx(tilted.objective, rel=1e-9)
    assert rotavg.diagnose(tilted).frames == {}
