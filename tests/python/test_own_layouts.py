"""Tables that people made themselves: other names, orders, separators and rotations."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.base.errors import FormatError
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices
from rotavg.io import read, read_rotations
from rotavg.io.columns import layout_of

VECTORS = np.random.default_rng(2).standard_normal((4, 3))
R = matrices_from_rotvecs(VECTORS)
Q = quaternions_from_matrices(R)
EDGES = [(3, 1), (1, 2), (2, 3), (7, 3)]
WEIGHTS = [1.5, 2, 0.25, 4]
VALUES: dict[str, Any] = {
    **{f"q{axis}": Q[:, k] for k, axis in enumerate("xyzw")},
    **{f"r{axis}": VECTORS[:, k] for k, axis in enumerate("xyz")},
    **{f"r{a}{b}": R[:, a - 1, b - 1] for a in (1, 2, 3) for b in (1, 2, 3)},
    "i": [i for i, _ in EDGES],
    "j": [j for _, j in EDGES],
    "weight": WEIGHTS,
    "tx": [0.5] * 4,
    "inliers": [7, 8, 9, 10],
    "id": [5, 3, 9, 4],
}
MATRIX = [f"r{a}{b}" for a in (1, 2, 3) for b in (1, 2, 3)]


def table(words: list[str], separator: str, decimal: str = ".") -> list[str]:
    rows = zip(*(np.asarray(VALUES[word], dtype=object).tolist() for word in words))
    return [separator.join(repr(x).replace(".", decimal) for x in row) for row in rows]


def put(path: Path, *lines: str) -> Path:
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def check(graph: rotavg.MeasurementGraph, words: list[str]) -> None:
    assert graph.edges.tolist() == [list(edge) for edge in EDGES]
    np.testing.assert_allclose(graph.rotations, R, atol=1e-12)
    assert graph.weights.tolist() == (WEIGHTS if "weight" in words else [1] * 4)


LAYOUTS = [
    ["i", "j", "qw", "qx", "qy", "qz"],
    ["j", "i", "weight", "qx", "qw", "qz", "qy"],
    ["i", "j", "rx", "ry", "rz"],
    ["i", "j", "inliers", "rz", "ry", "rx", "weight"],
    ["i", "j", *MATRIX],
    ["i", "j", *MATRIX, "weight", "tx"],
    ["tx", "i", "j", "qw", "qx", "qy", "qz", "inliers"],
]


@pytest.mark.parametrize("words", LAYOUTS, ids=" ".join)
@pytest.mark.parametrize("separator", [" ", ",", ", ", ";", "; ", "\t"])
@pytest.mark.parametrize("name", ["t.txt", "t.csv", "t"])
def test_a_header_is_honoured(tmp_path: Path, words: list[str], separator: str, name: str) -> None:
    path = put(tmp_path / name, separator.join(words), *table(words, separator))
    graph = read(path)
    check(graph, words)
    unread = [word for word in words if word in ("tx", "inliers")]
    assert graph.notes == ((f"columns not read: {', '.join(unread)}",) if unread else ())


@pytest.mark.parametrize("words", LAYOUTS, ids=" ".join)
def test_a_header_in_a_comment_and_columns_that_are_told(tmp_path: Path, words: list[str]) -> None:
    for separator in (" ", ","):
        rows = table(words, separator)
        path = put(tmp_path / "t.txt", "# mine", f"# {separator.join(words)}", *rows)
        check(read(path, format="text"), words)
        # What the user says counts more than a header.
        for first in ([], [f"# {separator.join(words)}"]):
            path = put(tmp_path / "t.txt", *first, *rows)
            check(read(path, columns=",".join(words)), words)
            check(read(path, columns=words), words)
    silent = [word if word not in ("weight", "tx", "inliers") else "_" for word in words]
    graph = read(path, columns=silent)
    assert graph.notes == ()
    check(graph, [])


@pytest.mark.parametrize("words", LAYOUTS, ids=" ".join)
def test_decimal_commas_between_semicolons(tmp_path: Path, words: list[str]) -> None:
    path = put(tmp_path / "t.csv", ";".join(words), *table(words, ";", ","))
    check(read(path), words)
    path = put(tmp_path / "t.csv", *(f'"{w}"' for w in [";".join(words).replace(";", '";"')]),
               *table(words, ";", ","))  # fmt: skip
    check(read(path), words)
    if words[0] == "i" and "tx" not in words and len(words) > 7:
        return
    plain = ["i", "j", "qx", "qy", "qz", "qw", "weight"]
    check(read(put(tmp_path / "p.csv", *table(plain, ";", ","))), plain)


def test_names_that_people_give_columns() -> None:
    quaternion = {"xyzw": ("qx", "qy", "qz", "qw")}
    for ends in (
        ("from", "to"), ("id1", "id2"), ("id_1", "id_2"), ("image1", "image2"),
        ("Image0", "image1"), ("image_id1", "image_id2"), ("name_i", "name_j"), ("src", "dst"),
        ("node_a", "node_b"), ("source", "target"), ("from_id", "to_id"), ("cam0", "cam1"),
    ):  # fmt: skip
        for turn in (
            quaternion["xyzw"], ("q_x", "q_y", "q_z", "q_w"), ("x", "y", "z", "w"),
            ("QuatX", "QuatY", "QuatZ", "QuatW"), ("quat.x", "quat.y", "quat.z", "quat.w"),
        ):  # fmt: skip
            layout = layout_of([*ends, *turn], 2)
            assert layout is not None, (ends, turn)
            assert (layout.ids, layout.rotation, layout.weight) == ((0, 1), (2, 3, 4, 5), None)
        for vector in (("rx", "ry", "rz"), ("wx", "wy", "wz"), ("rvec_x", "rvec_y", "rvec_z")):
            layout = layout_of([*ends, *vector, "w"], 2)
            assert layout is not None
            assert (layout.kind, layout.weight) == ("rotation vector", 5)
    zero_based = [f"R{a}{b}" for a, b in itertools.product(range(3), range(3))]
    for matrix in (zero_based, [f"m_{a}_{b}" for a, b in itertools.product((1, 2, 3), (1, 2, 3))]):
        layout = layout_of(["j", "i", *reversed(matrix), "weight"], 2)
        assert layout is not None
        assert (layout.ids, layout.rotation) == ((1, 0), tuple(range(10, 1, -1)))
    # What is not all there, or there twice, or does not tell, is no layout.
    for words in (
        "i qx qy qz qw", "i j qx qy qz", "i j k qx qy", "i i j qx qy qz qw", "i j qx qx qy qz qw",
        "i j q1 q2 q3 q4", "id1 id1 qx qy qz qw", "i j rx ry rz rx", "i j x y z", "i j r11 r12 r13",
    ):  # fmt: skip
        assert layout_of(words.split(), 2) is None, words


@pytest.mark.parametrize("separator", [" ", ",", ";"])
@pytest.mark.parametrize(
    "turn", [["qw", "qx", "qy", "qz"], ["rx", "ry", "rz"], MATRIX, ["qz", "tx", "qy", "qw", "qx"]]
)
def test_rotations_of_nodes(tmp_path: Path, separator: str, turn: list[str]) -> None:
    words = ["id", *turn]
    path = put(tmp_path / "t.csv", separator.join(words), *table(words, separator))
    ids, rotations = read_rotations(path)
    assert ids.tolist() == VALUES["id"]
    np.testing.assert_allclose(rotations, R, atol=1e-12)
    path = put(tmp_path / "t.txt", *table(words, separator))
    np.testing.assert_allclose(read_rotations(path, columns=words)[1], R, atol=1e-12)
    with pytest.raises(FormatError, match="glomap has its own"):
        read_rotations(path, columns=words, format="glomap")


def test_the_command_compares_tables_of_any_columns(tmp_path: Path) -> None:
    """Say, poses as localisers write them: name, camera_from_world wxyz, translation."""
    rows = [row([f"img{k}.jpg"], [Q[k, 3], *-Q[k, :3]], [1, 2, 3]) for k in range(4)]
    theirs = put(tmp_path / "poses.txt", *rows)
    ours = {f"img{k}.jpg": R[k] for k in range(4)}
    ids, found = read_rotations(theirs, columns="id,qw,qx,qy,qz,_,_,_", convention="vision")
    assert rotavg.compare((ids, found), ours).angles.max() < 1e-7
    truth = put(tmp_path / "truth.csv", *(
        ",".join([f"img{k}.jpg", *map(repr, Q[k].tolist())]) for k in range(4)
    ))  # fmt: skip
    arguments = ["compare", str(theirs), str(truth), "--convention", "vision", "--json"]
    result = CliRunner().invoke(commands, [*arguments, "--columns", "id,qw,qx,qy,qz,_,_,_"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output)["max_deg"] < 1e-5
    other = ["--columns", "_,qw,qx,qy,qz,_,_,_"]
    assert isinstance(CliRunner().invoke(commands, [*arguments, *other]).exception, FormatError)


def row(*parts: Any) -> str:
    return " ".join(str(x) for part in parts for x in np.asarray(part).tolist())


@pytest.mark.parametrize(
    ("lines", "columns", "message"),
    [
        (["i j q1 q2 q3 q4", "0 1 0 0 0 1"], None, r":1: found the header .*rx ry rz.*--columns"),
        (["i,j,qw,qx,qy,qz", "0,1,1,0,0"], None, r":2: found 5 fields, expected i j qw qx qy qz"),
        (["i,j,qw,qx,qy,qz", "0,1,1,,0,0"], None, r":2: qx is empty, expected a number"),
        (["i,j,qw,qx,qy,qz", "0,1,1,x,0,0"], None, r":2: found 'x', expected a number"),
        (
            ["i,j,qw,qx,qy,qz", "0,1,0,0,0,0"],
            None,
            r":2: edge 0 \(0 -> 1\): the quaternion is zero",
        ),
        (
            ["i;j;rx;ry;rz", "0;1;90;0;0"],
            None,
            r":2: found a rotation vector of length 90.*radians",
        ),
        (
            ["i j " + " ".join(MATRIX), "0 1 1 0 0 0 2 0 0 0 1"],
            None,
            r":2: the matrix is not a rot",
        ),
        (["0 1 0 0 0 1"], "i,j,qx,qy,qz", r"columns are i j qx qy qz, expected i and j"),
        (["0 1 0 0 0 1 7"], "i,j,qx,qy,qz,qw", r":1: found 7 fields, expected i j qx qy qz qw"),
        (["0 1 0 0 0 1 7 8"], None, r":1: found 8 fields, expected 6 or 7.*--columns"),
        (["i,j,qw,qx,qy,qz"], None, "the file has no edges"),
    ],
)
def test_what_does_not_fit_is_told(
    tmp_path: Path, lines: list[str], columns: str | None, message: str
) -> None:
    with pytest.raises(FormatError, match=message):
        read(put(tmp_path / "t.txt", *lines), columns=columns)


def test_columns_are_for_tables(tmp_path: Path) -> None:
    path = put(tmp_path / "x.g2o", "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1")
    with pytest.raises(FormatError, match="g2o has its own"):
        read(path, format="g2o", columns="i,j,rx,ry,rz")


def test_empty_cells_where_nothing_is_read(tmp_path: Path) -> None:
    path = put(
        tmp_path / "t.csv", "i,j,note,qx,qy,qz,qw,", "0,1,,0,0,0,1,", "1,2,a b,0,0,0,1", ",,,"
    )
    assert read(path).edges.tolist() == [[0, 1], [1, 2]]
    path = put(tmp_path / "n.csv", "img 1.jpg,img 2.jpg,0,0,0,1")
    assert read(path).nodes.tolist() == ["img 1.jpg", "img 2.jpg"]


def test_rows_are_read_quickly(tmp_path: Path) -> None:
    """As many fields are looked at as there are: no more than a few passes over the text."""
    words = ["i", "j", "qw", "qx", "qy", "qz", "tx"]
    path = put(tmp_path / "t.csv", ",".join(words), *(table(words, ",") * 20_000))
    assert read(path).num_edges == 80_000
