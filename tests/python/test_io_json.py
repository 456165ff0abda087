"""Open3D's pose graphs, JRL and PyFG: small files spelt by hand, and what they are refused for."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices
from rotavg.io import losses

Floats = NDArray[np.float64]
PAIRS = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)]


def truth(dimension: int = 3) -> tuple[Floats, Floats]:
    """Four poses."""
    rng = np.random.default_rng(1)
    turns, where = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    if dimension == 2:
        turns[:, :2], where[:, 2] = 0, 0
    return matrices_from_rotvecs(turns), where


def relative(i: int, j: int, dimension: int = 3) -> tuple[Floats, Floats]:
    R, p = truth(dimension)
    return R[i].T @ R[j], R[i].T @ (p[j] - p[i])


def information(k: int, size: int = 6) -> Floats:
    """Of one edge, translation first."""
    A = np.random.default_rng(k).normal(size=(size, size))
    return A @ A.T + np.eye(size)


def pose(R: Floats, t: Floats) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def open3d() -> dict[str, Any]:
    R, p = truth()
    edges = []
    for k, (i, j) in enumerate(PAIRS):
        omega = information(k)[np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])]
        edges.append(
            {
                "class_name": "PoseGraphEdge",
                "confidence": 1.0,
                "information": omega.T.ravel().tolist(),
                "source_node_id": j,
                "target_node_id": i,
                "transformation": pose(*relative(i, j)).T.ravel().tolist(),
                "uncertain": k == 4,
                "version_major": 1,
                "version_minor": 0,
            }
        )
    nodes = [
        {"class_name": "PoseGraphNode", "pose": pose(R[k], p[k]).T.ravel().tolist()}
        for k in range(4)
    ]
    return {"class_name": "PoseGraph", "edges": edges, "nodes": nodes, "version_major": 1}


def jrl(dimension: int = 3) -> dict[str, Any]:
    measured = []
    for k, (i, j) in enumerate(PAIRS):
        R, t = relative(i, j, dimension)
        if dimension == 3:
            x, y, z, w = quaternions_from_matrices(R).tolist()
            value = {"type": "Pose3", "translation": t.tolist(), "rotation": [w, x, y, z]}
            order = [3, 4, 5, 0, 1, 2]
            covariance = np.linalg.inv(information(k))[np.ix_(order, order)]
        else:
            angle = float(np.arctan2(R[1, 0], R[0, 0]))
            value = {"type": "Pose2", "x": t[0], "y": t[1], "theta": angle}
            covariance = np.linalg.inv(information(k, 3))
        measured.append(
            {
                "type": f"BetweenFactorPose{dimension}",
                "key1": i,
                "key2": j,
                "measurement": value,
                "covariance": covariance.ravel().tolist(),
            }
        )
    others = [{"type": "PriorFactorPose3", "key": 0}, {"type": "RangeFactorPose3"}]
    entries = [
        {"stamp": 0, "measurements": [*measured[:3], others[0]]},
        {"stamp": 1, "measurements": []},
    ]
    return {
        "name": "made up",
        "robots": ["a", "b"],
        "measurements": {
            "a": entries,
            "b": [{"stamp": 0, "measurements": [*measured[3:], others[1]]}],
        },
    }


def pyfg(dimension: int = 3) -> str:
    lines = ["# made up", "VERTEX_XYZ L0 1 2 3", "EDGE_RANGE 0.5 A0 L0 1.0 0.1"]
    tag = "SE3:QUAT" if dimension == 3 else "SE2"
    lines += [
        f"VERTEX_{tag} 0.0 A{k} 0 0 0 {'0 0 0 1' if dimension == 3 else ''}" for k in range(4)
    ]
    size = 3 * dimension - 3
    for k, (i, j) in enumerate(PAIRS):
        R, t = relative(i, j, dimension)
        numbers = [*t.tolist(), *quaternions_from_matrices(R).tolist()]
        if dimension == 2:
            numbers = [*t[:2].tolist(), float(np.arctan2(R[1, 0], R[0, 0]))]
        covariance = np.linalg.inv(information(k, size))
        numbers += covariance[np.triu_indices(size)].tolist()
        lines.append(f"EDGE_{tag} 0.25 A{i} A{j} {' '.join(map(repr, numbers))}")
    return "\n".join([*lines, ""])


FILES = {
    "open3d": (".json", lambda dimension: json.dumps(open3d())),
    "jrl": (".jrl", lambda dimension: json.dumps(jrl(dimension))),
    "pyfg": (".pyfg", pyfg),
}


def put(folder: Path, name: str, dimension: int = 3) -> Path:
    suffix, content = FILES[name]
    path = folder / f"in{suffix}"
    path.write_text(content(dimension))
    return path


@pytest.mark.parametrize(
    ("name", "dimension"), [("open3d", 3), ("jrl", 3), ("jrl", 2), ("pyfg", 3), ("pyfg", 2)]
)
@pytest.mark.parametrize("told", [True, False], ids=["by its name", "by content"])
def test_what_is_read(tmp_path: Path, name: str, dimension: int, told: bool) -> None:
    path = put(tmp_path, name, dimension)
    if not told:
        path = path.rename(tmp_path / "nothing_told")
    graph = rotavg.read(path)
    prefix = "A" if name == "pyfg" else ""
    assert [f"{prefix}{i} {prefix}{j}" for i, j in PAIRS] == [
        f"{i} {j}" for i, j in graph.edges.tolist()
    ]
    R, p = truth(dimension)
    for k, (i, j) in enumerate(PAIRS):
        np.testing.assert_allclose(graph.rotations[k], R[i].T @ R[j], atol=1e-12)
        np.testing.assert_allclose(graph.translations.vectors[k], relative(i, j, dimension)[1])
        if dimension == 3:
            omega = information(k)
            np.testing.assert_allclose(np.linalg.inv(graph.covariances[k]), omega[3:, 3:])
            np.testing.assert_allclose(graph.translations.information[k], omega[:3, :3])
            np.testing.assert_allclose(graph.translations.cross[k], omega[:3, 3:], atol=1e-9)
            kappa = 1.5 / np.trace(np.linalg.inv(omega[3:, 3:]))
        else:
            omega = information(k, 3)
            np.testing.assert_allclose(graph.translations.information[k][:2, :2], omega[:2, :2])
            np.testing.assert_allclose(graph.translations.cross[k][:2, 2], omega[:2, 2])
            kappa = omega[2, 2] / 2
        assert graph.weights[k] == pytest.approx(kappa, rel=1e-9)
    assert graph.translations.dimension == dimension
    found = rotavg.refine_poses(rotavg.solve(graph))
    assert found.chi2 < 1e-18
    np.testing.assert_allclose(found.positions, (p - p[0]) @ R[0], atol=1e-9)
    assert set(rotavg.read(path, unit_weights=True).weights) == {1.0}
    if name != "open3d":
        assert any("skipped" in note for note in graph.notes)


def test_open3d_there_and_back(tmp_path: Path) -> None:
    graph = rotavg.read(put(tmp_path, "open3d"))
    found = rotavg.refine_poses(rotavg.solve(graph))
    rotavg.write(tmp_path / "out.json", found)
    again = rotavg.read(tmp_path / "out.json")
    np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-12)
    np.testing.assert_allclose(again.covariances, graph.covariances, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(again.translations.cross, graph.translations.cross, atol=1e-12)
    ids, rotations = rotavg.read_rotations(tmp_path / "out.json")
    assert ids.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(rotations, found.rotations, atol=1e-14)
    value = json.loads((tmp_path / "out.json").read_text())
    assert [edge["uncertain"] for edge in value["edges"]] == [False, False, False, True, True]
    poses = np.array([node["pose"] for node in value["nodes"]]).reshape(4, 4, 4)
    np.testing.assert_allclose(poses[:, 3, :3], found.positions, atol=1e-14)
    graph = rotavg.MeasurementGraph([["a", "b"]], [np.eye(3)])
    for item in (graph, rotavg.solve(graph)):
        with pytest.warns(
            rotavg.IncompleteWarning, match="the ids are not in it: open3d counts the nodes, from 0"
        ):
            rotavg.write(tmp_path / "out.json", item)
    assert losses(tmp_path / "out.json", graph) == ()
    with pytest.warns(rotavg.IncompleteWarning, match="the ids are not in it"):
        rotavg.write(tmp_path / "out.json", graph)
    assert rotavg.read(tmp_path / "out.json").edges.tolist() == [[0, 1]]


def spoilt(value: Any, keys: str, new: Any) -> Any:
    """A copy with another value at the place that these words name."""
    result = copy.deepcopy(value)
    here = result
    *path, last = [int(key) if key.isdigit() else key for key in keys.split()]
    for key in path:
        here = here[key]
    if new is None:
        del here[last]
    else:
        here[last] = new
    return result


A2 = "measurements a 0 measurements 2"


@pytest.mark.parametrize(
    ("name", "keys", "new", "message"),
    [
        ("open3d", "class_name", "PointCloud", "found the class_name 'PointCloud', expected"),
        ("open3d", "nodes", {}, "nodes: found .*expected a list"),
        ("open3d", "edges", [], "no edges"),
        ("open3d", "edges 1", 7, r"edges\[1\]: found 7, expected an object"),
        ("open3d", "edges 1 source_node_id", 4, r"edges\[1\].source_node_id: found 4, expected 0"),
        ("open3d", "edges 1 source_node_id", "1", r"source_node_id: found '1', expected an int"),
        ("open3d", "edges 2 transformation", None, r'edges\[2\]: .*object with "transformation"'),
        ("open3d", "edges 2 transformation", [1.0], "transformation: .*expected 16 numbers"),
        ("open3d", "edges 2 transformation 0", 9.0, "the matrix in row 2"),
        ("open3d", "edges 2 transformation 0", "x", "found 'x', expected a finite number"),
        ("open3d", "edges 2 information 0", float("nan"), "found nan, expected a finite number"),
        ("open3d", "edges 2 information 0", 1e999, "found inf, expected a finite number"),
        ("open3d", "edges 2 information 0", -5.0, r"edges\[2\]: the rotation part of the infor"),
        ("open3d", "edges 3 target_node_id", 0, r"edges\[3\]: .*edge"),
        ("jrl", "measurements", [], "expected an object of robots"),
        ("jrl", "measurements a", 3, "measurements.a: found 3, expected a list"),
        ("jrl", f"{A2} type", None, r"measurements.a\[0\].measurements\[2\]: .*with \"type\""),
        ("jrl", f"{A2} key1", 2**63, r"measurements\[2\].key1: .*expected an integer"),
        ("jrl", f"{A2} measurement rotation", [0, 0, 0, 0], r"measurements\[2\]: the quaternion"),
        ("jrl", f"{A2} measurement rotation", [2, 0, 0, 0], r"measurements\[2\]: .*of length 2"),
        ("jrl", f"{A2} measurement rotation", [1, 0, 0], "expected 4 numbers"),
        ("jrl", f"{A2} covariance 0", -1.0, r"\[2\]: the covariance is not positive definite"),
        ("jrl", f"{A2} covariance 1", 50.0, r"measurements\[2\]: the covariance is not symmetric"),
        ("jrl", f"{A2} covariance", [1.0] * 9, "covariance: .*expected 36 numbers"),
        ("jrl", f"{A2} key2", 2, r"measurements\[2\]: .*edge"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(
    tmp_path: Path, name: str, keys: str, new: Any, message: str
) -> None:
    value = open3d() if name == "open3d" else jrl()
    path = tmp_path / f"bad{FILES[name][0]}"
    path.write_text(json.dumps(spoilt(value, keys, new)))
    with pytest.raises(rotavg.FormatError, match=rf"bad\{FILES[name][0]}: .*{message}"):
        rotavg.read(path, format=name)


def test_no_json(tmp_path: Path) -> None:
    path = tmp_path / "bad.json"
    path.write_text('{"class_name": "PoseGraph",\n "nodes": [1,\n')
    with pytest.raises(rotavg.FormatError, match=r"bad\.json:3: found no JSON"):
        rotavg.read(path)
    for text in ("[1, 2]", '"PoseGraph"', "[" * 100_000, "\xff"):
        path.write_bytes(text.encode("latin-1"))
        with pytest.raises(rotavg.FormatError, match=r"bad\.json: "):
            rotavg.read(path, format="open3d")
    path.write_text('{"measurements": {"a": [{"measurements": [{"type": "Odd"}]}]}}')
    with pytest.raises(rotavg.FormatError, match="no relative poses; found Odd: 1, expected"):
        rotavg.read(path, format="jrl")


def test_without_information_an_edge_is_not_used(tmp_path: Path) -> None:
    value = spoilt(open3d(), "edges 4 information", [0.0] * 36)
    (tmp_path / "in.json").write_text(json.dumps(value))
    graph = rotavg.read(tmp_path / "in.json")
    assert graph.num_edges == 4
    assert any("weight 0" in note for note in graph.notes)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("EDGE_SE3:QUAT 0.25 A1 A2", "EDGE_SE3:QUAT 0.25 A1", "27 numbers.*expected 28"),
        ("EDGE_SE3:QUAT 0.25 A1 A2", "EDGE_SE3:QUAT A1 A2", "expected a time and two names"),
        ("EDGE_SE3:QUAT 0.25 A1 A2", "EDGE_SE3:QUAT 0.25 A1 A1", r"\(A1 -> A1\)|'A1'"),
        ("EDGE_SE3:QUAT 0.25 A1 A2", "EDGE_SE3:QUAT 0.25 A1 A2 1", "29 numbers.*expected 28"),
    ],
)
def test_bad_lines_of_pyfg(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "bad.pyfg"
    path.write_text(pyfg().replace(old, new, 1))
    with pytest.raises(rotavg.FormatError, match=rf"bad\.pyfg:9: .*({message})"):
        rotavg.read(path)


def test_pyfg_without_edges(tmp_path: Path) -> None:
    path = tmp_path / "bad.pyfg"
    path.write_text("VERTEX_SE2 0 A0 0 0 0\nEDGE_RANGE 0 A0 L0 1 1\n")
    with pytest.raises(rotavg.FormatError, match=r"no edges: no line .*found EDGE_RANGE: 1"):
        rotavg.read(path)


def test_numbers_at_the_ends_of_what_there_is_are_refused_or_read(tmp_path: Path) -> None:
    """What a fuzzer found: sums of covariances that overflow, integers that no double holds."""
    path = tmp_path / "a.jrl"
    pose = {"type": "Pose3", "translation": [0, 0, 0], "rotation": [1, 0, 0, 0]}
    factor = {"type": "BetweenFactorPose3", "key1": 0, "key2": 1, "measurement": pose}
    for scale, message in (
        (1.7e308, "found the weight 2.94118e-309"),
        (1e-320, "too small to invert"),
        (10**400, "expected a finite number"),
    ):
        covariance = [scale if k % 7 == 0 else 0 for k in range(36)]
        entry = {"stamp": 0, "measurements": [{**factor, "covariance": covariance}]}
        path.write_text(json.dumps({"name": "a", "robots": ["a"], "measurements": {"a": [entry]}}))
        with pytest.raises(rotavg.FormatError, match=message):
            rotavg.read(path)
