"""Absolute rotations from files: every format there and back and by hand, and no guesses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rotavg
from answers import random_answer
from rotavg.base.errors import FormatError
from rotavg.io import FORMATS, read_rotations, write
from shared_data import shared_data
from test_compare import run

# (The binary of COLMAP's models, and folders: test_colmap_models.py.)
ROTATIONS = {form.name for form in FORMATS if form.rotations and form.write}
# What a solution is written as, and is then read from without a word.
NAMES = {
    "text": "s.txt", "csv": "s.csv", "npz": "s.npz", "g2o": "s.g2o", "toro": "s.graph",
    "glomap": "s_glomap_rotations.txt", "colmap_images": "images.txt", "tum": "s.tum",
    "irotavg": "s.irotavg", "open3d": "s.json",
}  # fmt: skip
UNMISTAKABLE = {"text", "csv", "npz", "g2o", "toro", "colmap_images", "tum", "open3d"}
HEADED = "# id qx qy qz qw\n"


@pytest.fixture
def answer() -> rotavg.Solution:
    """Rotations that are no common turn away from their transposes, of nodes 0 to 11."""
    return random_answer(rotavg.simulate("complete", 12, noise=0.1, seed=4).graph, seed=5)


def named(answer: rotavg.Solution) -> rotavg.Solution:
    graph = answer.graph
    names = np.array([f"im/{k}.jpg" for k in range(12)])
    return random_answer(rotavg.MeasurementGraph(names[graph.indices], graph.rotations), seed=5)


def test_whatever_a_solution_is_written_as_is_read() -> None:
    written = {form.name for form in FORMATS if form.write and form.has_solutions}
    assert written - {"colmap_model"} == ROTATIONS
    assert NAMES.keys() == ROTATIONS


@pytest.mark.parametrize("name", sorted(ROTATIONS))
def test_there_and_back(tmp_path: Path, name: str, answer: rotavg.Solution) -> None:
    for path, told in ((tmp_path / NAMES[name], False), (tmp_path / "anything", True)):
        write(path, answer, format=name)
        nodes, R = read_rotations(path, format=name if told else None)
        np.testing.assert_array_equal(nodes, answer.graph.nodes)
        assert nodes.dtype == np.int64
        np.testing.assert_allclose(R, answer.rotations, atol=1e-14)
    if name in UNMISTAKABLE:
        np.testing.assert_array_equal(read_rotations(tmp_path / "anything")[1], R)
    else:
        with pytest.raises(FormatError, match="nothing tells"):
            read_rotations(tmp_path / "anything")


@pytest.mark.parametrize("name", sorted(ROTATIONS - {"g2o", "toro", "tum", "irotavg", "open3d"}))
def test_names_there_and_back(tmp_path: Path, name: str, answer: rotavg.Solution) -> None:
    answer = named(answer)
    write(tmp_path / NAMES[name], answer)
    nodes, R = read_rotations(tmp_path / NAMES[name])
    assert nodes.tolist() == answer.graph.nodes.tolist()
    np.testing.assert_allclose(R, answer.rotations, atol=1e-14)


def test_names_that_need_quotes(tmp_path: Path) -> None:
    graph = rotavg.MeasurementGraph([["a, b", 'c "d" #']], [np.eye(3)])
    answer = random_answer(graph, seed=1)
    for name in ("csv", "npz"):
        write(tmp_path / "x", answer, format=name)
        nodes, R = read_rotations(tmp_path / "x")
        assert nodes.tolist() == ["a, b", 'c "d" #']
        np.testing.assert_allclose(R, answer.rotations, atol=1e-14)


# A quarter turn about z and a third of a turn about (1, 1, 1), as world_from_node. The transpose
# of the first turns by -90 degrees.
HALF = np.sqrt(0.5)
QUARTER = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
THIRD = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
H = repr(float(HALF))
BY_HAND: dict[str, tuple[str, str, list[Any]]] = {
    "text": ("s.txt", f"# id qx qy qz qw\n7 0 0 {H} {H}\n9 .5 .5 .5 .5 # said\n", [7, 9]),
    "text with commas": ("s.txt", f"id, qx, qy, qz, qw\n7, 0,0, {H}, {H}\n9,.5,.5,.5,.5\n", [7, 9]),
    "csv": ("x", f'"a b",0,0,{H},{H}\r\n\r\n# no\r\nc,.5,.5,.5,.5\r\n', ["a b", "c"]),
    "csv with a header": ("x", f'ID,QX,QY,QZ,QW\n"7",0,0,{H},{H}\n9,.5,.5,.5,.5\n', [7, 9]),
    "glomap": ("b_glomap_rotations.txt", f"a {H} 0 0 -{H}\nb .5 -.5 -.5 -.5\n", ["a", "b"]),
    "irotavg": ("s.rcd", f"{H} 0 0 -{H}\n.5 -.5 -.5 -.5\n", [0, 1]),
    "colmap_images": (
        "images.txt",
        f"# title\n\n3 {H} 0 0 -{H} 1 2 3 1 a b#1.jpg\n10.5 20 -1 3 4 77\n"
        "5 .5 -.5 -.5 -.5 0 0 0 1 c.jpg\n",
        ["a b#1.jpg", "c.jpg"],
    ),
    "tum": ("trajectory.txt", f"1.5 1 2 3 0 0 {H} {H}\n2.50 4 5 6 .5 .5 .5 .5\n", ["1.5", "2.50"]),
    "tum with a title": (
        "x",
        f"# 'x'\n# timestamp tx ty tz qx qy qz qw\n1 0 0 0 0 0 {H} {H}\n2 0 0 0 .5 .5 .5 .5\n",
        [1, 2],
    ),
    "g2o": (
        "x",
        f"FIX 7\nVERTEX_SE3:QUAT 7 1 2 3 0 0 {H} {H}\nVERTEX_SE3:QUAT 9 0 0 0 .5 .5 .5 .5 # .\n",
        [7, 9],
    ),
    "toro": (
        "x",
        f"VERTEX3 7 1 2 3 0 0 {np.pi / 2!r}\nVERTEX3 9 0 0 0 {np.pi / 2!r} 0 {np.pi / 2!r}\n",
        [7, 9],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", sorted(BY_HAND))
def test_by_hand(tmp_path: Path, case: str) -> None:
    name, content, ids = BY_HAND[case]
    path = tmp_path / name
    path.write_text(content)
    for told in (None, case.split()[0]):
        nodes, R = read_rotations(path, format=told)
        assert nodes.tolist() == ids
        np.testing.assert_allclose(R, [QUARTER, THIRD], atol=1e-15)


@pytest.mark.parametrize(("tag", "name"), [("VERTEX_SE2", "g2o"), ("VERTEX2", "toro")])
def test_vertices_in_the_plane_are_turns_about_z(tmp_path: Path, tag: str, name: str) -> None:
    path = tmp_path / "p"
    path.write_text(f"{tag} 3 1 2 0.5\n{tag} 4 1 2 -1\n")
    for told in (None, name):
        nodes, R = read_rotations(path, format=told)
        assert nodes.tolist() == [3, 4]
        turns = Rotation.from_rotvec([[0, 0, 0.5], [0, 0, -1]])
        np.testing.assert_allclose(R, turns.as_matrix(), atol=1e-15)


def test_nothing_is_guessed_where_two_formats_fit(tmp_path: Path, answer: rotavg.Solution) -> None:
    answer = named(answer)
    write(tmp_path / "x_glomap_rotations.txt", answer)
    path = (tmp_path / "x_glomap_rotations.txt").rename(tmp_path / "x.txt")
    with pytest.raises(FormatError) as error:
        read_rotations(path)
    assert str(error.value) == (
        f"{path}:1: found 5 fields, which may be glomap (NAME qw qx qy qz) or text (id qx qy qz "
        'qw), but nothing tells: begin with the line "# id qx qy qz qw", or say the format '
        "(rotavg compare: --format, --reference-format; Python: format=)"
    )
    R = {name: read_rotations(path, format=name)[1] for name in ("glomap", "text")}
    np.testing.assert_allclose(R["glomap"], answer.rotations, atol=1e-14)
    assert np.abs(R["text"] - answer.rotations).max() > 0.1
    # What tells is the header, whatever the name; without one, the name that GLOMAP's tools use.
    write(tmp_path / "y.txt", answer)
    text = (tmp_path / "y.txt").read_bytes()
    (tmp_path / "y_glomap_rotations.txt").write_bytes(text)
    found = read_rotations(tmp_path / "y_glomap_rotations.txt")[1]
    np.testing.assert_allclose(found, answer.rotations, atol=1e-14)
    bare = b"\n".join(line for line in text.splitlines() if not line.startswith(b"#"))
    (tmp_path / "y.txt").write_bytes(bare)
    with pytest.raises(FormatError, match="nothing tells"):
        read_rotations(tmp_path / "y.txt")
    (tmp_path / "y.txt").write_bytes(b"# name qw qx qy qz\n" + bare)  # no header of ours
    with pytest.raises(FormatError, match="nothing tells"):
        read_rotations(tmp_path / "y.txt")


def test_eight_numbers_are_a_trajectory_if_they_end_in_a_unit_quaternion(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text("1 1 0 0 0 5 6 7\n2 0 1 0 0 5 6 7\n")  # id qw qx qy qz x y z
    with pytest.raises(FormatError, match=r":1: found 8 fields, which may be tum .*nothing tells"):
        read_rotations(path)
    path.write_text("# timestamp qw qx qy qz x y z\n1 1 0 0 0 5 6 7\n")
    with pytest.raises(FormatError, match=r":2: found 8 fields, which may be tum .*nothing tells"):
        read_rotations(path)
    path.write_text("1 0 0 0 .6 .8 0 0\n2 0 0 0 0 0 0 1\n")
    assert read_rotations(path)[0].tolist() == [1, 2]


def test_the_family_is_asked_for_where_the_format_leaves_it_open(
    tmp_path: Path, answer: rotavg.Solution
) -> None:
    for name in sorted(ROTATIONS):
        path = tmp_path / NAMES[name]
        write(path, answer)
        if name in ("text", "csv", "npz"):
            R = read_rotations(path, convention="vision")[1]
            np.testing.assert_allclose(R, np.swapaxes(answer.rotations, 1, 2), atol=1e-14)
        else:
            pose = name in ("g2o", "toro", "tum", "open3d")
            with pytest.raises(FormatError, match=f"{name} is in the .* family by definition"):
                read_rotations(path, convention="vision" if pose else "pose")
            read_rotations(path, convention="pose" if pose else "vision")
    with pytest.raises(FormatError, match="convention is 'left'"):
        read_rotations(tmp_path / "s.txt", convention="left")  # type: ignore[arg-type]


# --- npz ------------------------------------------------------------------------------------


def test_ground_truth_of_an_archive(tmp_path: Path, answer: rotavg.Solution) -> None:
    path, R = tmp_path / "x.npz", answer.rotations
    graph = {"edges": answer.graph.edges + 100, "relative_rotations": answer.graph.rotations}
    known = np.arange(12) % 3 > 0
    unknown = np.where(known[:, None, None], R, np.nan)

    np.savez(path, ground_truth=R)
    assert read_rotations(path)[0].tolist() == list(range(12))
    np.testing.assert_array_equal(read_rotations(path)[1], R)
    np.savez(path, ground_truth=unknown, has_ground_truth=known, **graph)
    nodes, truth = read_rotations(path)
    assert nodes.tolist() == [100 + k for k in range(12) if known[k]]
    np.testing.assert_array_equal(truth, R[known])
    assert set(nodes.tolist()) <= set(rotavg.read(path).nodes.tolist())
    turned = read_rotations(path, convention="vision")[1]
    np.testing.assert_array_equal(turned, np.swapaxes(R[known], 1, 2))
    np.savez(path, ground_truth=R, nodes=[f"n{k}" for k in range(12)])
    assert read_rotations(path)[0].tolist() == [f"n{k}" for k in range(12)]

    for arrays, message in (
        ({"ground_truth": R[:11], **graph}, r"ground_truth has shape \(11, 3, 3\)"),
        ({"ground_truth": R, "has_ground_truth": known[:3]}, "expected a bool for each of 12"),
        ({"ground_truth": R, "has_ground_truth": known + 0}, "has_ground_truth is int64 of shape"),
        ({"ground_truth": R, "nodes": [1] * 12}, "node 1 is listed more than once"),
        ({"ground_truth": R, "nodes": np.ones(12) / 2}, "nodes hold 0.5, expected an integer"),
        ({"ground_truth": 3}, "ground_truth"),
        ({"ground_truth": R, "edges": [[0.5, 1]]}, "edges hold 0.5, expected an integer"),
        ({"ground_truth": unknown}, "ground_truth of node 0 is no rotation"),
        ({"quaternions": R}, "found the arrays quaternions, expected nodes"),
        ({"nodes": range(12), "rotations": R, "component": [0]}, r"component has shape \(1,\)"),
        (graph, "found the arrays edges, relative_rotations, expected nodes"),
    ):
        np.savez(path, **arrays)  # type: ignore[arg-type]
        with pytest.raises(FormatError, match=message) as error:
            read_rotations(path)
        assert str(path) in str(error.value)


def test_an_npz_of_a_graph_holds_no_solution(tmp_path: Path) -> None:
    for kind in ("complete", "cycle"):  # a cycle has as many edges as nodes
        rotavg.write(tmp_path / "g.npz", rotavg.simulate(kind, 5, seed=0).graph)
        with pytest.raises(rotavg.FormatError, match="found a graph, expected absolute"):
            rotavg.read_rotations(tmp_path / "g.npz")
    (tmp_path / "z.npz").write_bytes(b"PK\x03\x04 and nothing")
    with pytest.raises(rotavg.FormatError, match="no readable npz"):
        rotavg.read_rotations(tmp_path / "z.npz")
    content = bytearray((tmp_path / "g.npz").read_bytes())
    entry = content.find(b"PK\x01\x02")  # of the directory at the end
    content[entry + 10] = 99  # its compression method
    (tmp_path / "z.npz").write_bytes(content)
    with pytest.raises(rotavg.FormatError, match="no readable npz archive: That compression"):
        rotavg.read_rotations(tmp_path / "z.npz")


# --- COLMAP ---------------------------------------------------------------------------------


def test_image_ids_for_names(tmp_path: Path, answer: rotavg.Solution) -> None:
    path = tmp_path / "images.txt"
    write(path, named(answer))
    assert read_rotations(path, image_ids=True)[0].tolist() == list(range(1, 13))
    # A graph of a COLMAP pose graph has image ids for nodes, one of a database has names.
    graph = answer.graph
    numbered = random_answer(rotavg.MeasurementGraph(graph.edges + 1, graph.rotations), seed=6)
    write(tmp_path / "s.txt", numbered)
    order = np.argsort(named(answer).graph.nodes, kind="stable")
    assert order.tolist() == list(range(12))
    refused = run("compare", tmp_path / "s.txt", path, status=2)
    assert f"{path}: no node of {tmp_path / 's.txt'} is in it (say, 1 there, 'im/0.jpg' here)" in (
        refused
    )
    figures = json.loads(run("compare", tmp_path / "s.txt", path, "--image-ids", "--json"))
    assert figures["nodes"] == 12
    expected = rotavg.compare(numbered, named(answer).rotations)
    assert figures["mean_deg"] == pytest.approx(np.degrees(expected.mean), rel=1e-9)
    other = run("compare", tmp_path / "s.txt", tmp_path / "s.txt", "--image-ids", status=2)
    assert "--image-ids: neither is a model of COLMAP's" in other
    with pytest.raises(FormatError, match="text has no image ids"):
        read_rotations(tmp_path / "s.txt", image_ids=True)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ("2 1 0 0 0 0 0 0 1 b.jpg\n\n", ":2: found .*expected the image's points, or an empty"),
        ("\n2 1 0 0 0 0 0 0 1\n\n", ":3: found 9 fields, expected IMAGE_ID qw"),
        ("\n1 1 0 0 0 0 0 0 1 b.jpg\n", ":3: node 1 is listed more than once, before in line 1"),
        ("\n2 1 0 0 0 0 0 0 1 a.jpg\n", ":3: node 'a.jpg' is listed more than once, before"),
        ("\n2 0 0 0 0 0 0 0 1 b.jpg\n", ":3: the quaternion is zero"),
    ],
)
def test_bad_images(tmp_path: Path, second: str, message: str) -> None:
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n" + second)
    with pytest.raises(FormatError, match=message):
        read_rotations(tmp_path / "images.txt")


def test_colmap_agrees(tmp_path: Path) -> None:
    """What pycolmap writes, beside what it says itself."""
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = 1
    options.num_cameras_per_rig = 1
    options.num_frames_per_rig = 5
    options.num_points3D = 10
    scene = pycolmap.synthesize_dataset(options)
    scene.write_text(str(tmp_path))
    nodes, R = read_rotations(tmp_path / "images.txt")
    numbers = read_rotations(tmp_path / "images.txt", image_ids=True)[0]
    assert len(nodes) == 5
    for name, number, world_from_camera in zip(nodes, numbers, R):
        image = scene.images[number]
        assert image.name == name
        expected = image.cam_from_world().rotation.matrix().T
        np.testing.assert_allclose(world_from_camera, expected, atol=1e-12)


# --- what is refused ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# nothing\n", "the file has no rotations"),
        (HEADED, "the file has no rotations, expected id qx qy qz qw"),
        ("", "the file is empty, expected absolute rotations"),
        (HEADED + "1 0 0 0 1\n1 0 0 0 1\n", ":3: node 1 is listed more than once, before in line"),
        (HEADED + "1 0 0 0 1\n2 0 0 0\n", ":3: found 4 fields, expected id qx qy qz qw"),
        (HEADED + "1 0 0 0 1\n2 0 0 0 x\n", ":3: found 'x', expected a number"),
        (HEADED + "1 0 0 0 0\n", ":2: the quaternion is zero"),
        (HEADED + "1 0 0 0 nan\n", ":2: found nan"),
        (HEADED + "99999999999999999999 0 0 0 1\n", "expected integers of 64 bits"),
        ("1 2 0 0 0 1\n", ":1: found 6 fields, expected absolute rotations: npz, colmap_images"),
        ("1 0 0 0\n", ":1: found 4 fields, which may be irotavg (qw qx qy qz), but nothing tells"),
        ("1,0,0,0,1\n2,0,0,0\n", ":2: found 4 fields, expected id qx qy qz qw"),
        ("1,0,0,0,1\n2,0,0,one,0\n", ":2: found 'one', expected a number"),
        ("EDGE_SE2 0 1 0 0 0 1 0 0 1 0 1\n", "the file has no vertices, no line VERTEX_SE3:QUAT"),
        ("VERTEX_SE2 a 0 0 0\n", ":1: found 'a' for node ids, expected integers"),
        ("VERTEX_SE2 1\n", ":1: found only 1 values after 'VERTEX_SE2', the line is truncated"),
        ("VERTEX_SE2 1 0 0 0\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n", ":2: node 1 is listed more"),
        ("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 0\n", ":1: the quaternion is zero"),
        ("VERTEX3 1 0 0 0 0 0 inf\n", ":1: found inf, expected a finite number"),
        ("# timestamp x y z qx qy qz qw\n1 2 3\n", ":2: found 3 fields, expected timestamp x y"),
        ("binary \0\0\n", ":1: the file is binary"),
    ],
)
def test_bad_files_are_told_with_line_and_reason(
    tmp_path: Path, content: str, message: str
) -> None:
    path = tmp_path / "bad.txt"
    path.write_text(content)
    with pytest.raises(rotavg.FormatError) as error:
        rotavg.read_rotations(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)


def test_formats_without_rotations_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "s.txt", rotavg.solve(rotavg.simulate("cycle", 4, seed=1).graph))
    for name in ("1dsfm", "colmap", "nonsense"):
        with pytest.raises(FormatError, match=f"unknown format '{name}', expected one of"):
            read_rotations(tmp_path / "s.txt", format=name)
    with pytest.raises(rotavg.FileAccessError, match="cannot be read"):
        read_rotations(tmp_path / "none.txt")
    with pytest.raises(rotavg.FileAccessError, match="cannot be read"):
        read_rotations(tmp_path)


# --- real files -----------------------------------------------------------------------------


def test_ellis_island_has_ground_truth() -> None:
    path = shared_data("ellis_island/ellis_island.npz")
    nodes, R = read_rotations(path)
    assert len(nodes) == 227
    graph = rotavg.read(path)
    row = {node: k for k, node in enumerate(nodes.tolist())}
    both = [all(node in row for node in edge) for edge in graph.edges.tolist()]
    i, j = np.array([[row[n] for n in edge] for edge in graph.edges[both].tolist()]).T
    error = np.swapaxes(R[j], 1, 2) @ R[i] @ graph.rotations[both]
    degrees = np.degrees(Rotation.from_matrix(error).magnitude())
    assert np.median(degrees) == pytest.approx(2.89, abs=0.01)


def test_glomaps_own_rotations_fit_its_own_relative_poses() -> None:
    nodes, R = read_rotations(shared_data("relpose/kermit_glomap_rotations.txt"))
    graph = rotavg.read(shared_data("relpose/kermit_relpose.txt"))
    solution = rotavg.solve(graph, loss="auto")
    rows = [graph.nodes.tolist().index(node) for node in nodes.tolist()]
    assert np.degrees(rotavg.compare(solution.rotations[rows], R).median) < 2
    turned = np.swapaxes(R, 1, 2)
    assert np.degrees(rotavg.compare(solution.rotations[rows], turned).median) > 20
