"""Formats one by one: files written by hand, and real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotavg
from answers import random_answer
from random_graphs import random_graph
from rotavg.base.errors import FileAccessError, FormatError
from rotavg.graph.conventions import (
    matrices_from_quaternions,
    matrices_from_roll_pitch_yaw,
    roll_pitch_yaw_from_matrices,
)
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import read, read_gravity, read_rotations, write, write_gravity
from shared_data import shared_data


def test_glomap_on_real_data() -> None:
    """The references are another program's solution of the same relative poses."""
    for scene, nodes, edges in (("ET", 9, 31), ("kermit", 11, 43)):
        graph = read(shared_data(f"relpose/{scene}_relpose.txt"))
        assert (graph.num_nodes, graph.num_edges) == (nodes, edges)
        assert graph.notes == (f"weights from {scene}_weight.txt",)
        rows = [
            line.split()
            for line in shared_data(f"relpose/{scene}_glomap_rotations.txt").read_text().split("\n")
        ]
        wxyz = {row[0]: [float(x) for x in row[1:]] for row in rows if row}
        i, j = graph.edges.T
        both = np.array([a in wxyz and b in wxyz for a, b in zip(i, j)])
        world_from = {name: matrices_from_quaternions([*q[1:], q[0]]).T for name, q in wxyz.items()}
        errors = [
            np.degrees(np.arccos(np.clip((np.trace(Ri @ R @ Rj.T) - 1) / 2, -1, 1)))
            for Ri, R, Rj in (
                (world_from[a], R, world_from[b])
                for a, b, R, known in zip(i, j, graph.rotations, both)
                if known
            )
        ]
        assert np.median(errors) < 2.5


def test_toro_is_the_same_graph_as_g2o() -> None:
    toro = read(shared_data("toro/sphere2500.txt"))
    g2o = read(shared_data("g2o/sphere2500.g2o"))
    a, b = (np.lexsort(graph.edges.T) for graph in (toro, g2o))
    np.testing.assert_array_equal(toro.edges[a], g2o.edges[b])
    np.testing.assert_allclose(toro.rotations[a], g2o.rotations[b], atol=3e-6)  # six digits
    moved, expected = toro.translations, g2o.translations
    np.testing.assert_allclose(moved.vectors[a], expected.vectors[b], atol=1e-15)
    # Translation first in both; the g2o file counts rotations by half angles: four times as much.
    np.testing.assert_array_equal(moved.information[a], expected.information[b])
    np.testing.assert_allclose(4 * toro.weights[a], g2o.weights[b], rtol=2e-2)


def test_roll_pitch_yaw_by_hand_and_at_the_poles() -> None:
    R = matrices_from_roll_pitch_yaw([[0.1, 0.2, 0.3]])[0]
    cos, sin = np.cos([0.1, 0.2, 0.3]), np.sin([0.1, 0.2, 0.3])
    assert R[2, 0] == pytest.approx(-sin[1])
    assert R[2, 1] == pytest.approx(cos[1] * sin[0])
    assert R[1, 0] == pytest.approx(sin[2] * cos[1])
    rng = np.random.default_rng(0)
    angles = rng.uniform(-np.pi, np.pi, size=(4000, 3))
    angles[:1000, 1] = np.pi / 2
    angles[1000:2000, 1] = -np.pi / 2
    angles[2000:3000, 1] = np.pi / 2 - 10.0 ** rng.uniform(-16, -1, size=1000)
    R = matrices_from_roll_pitch_yaw(angles)
    again = matrices_from_roll_pitch_yaw(roll_pitch_yaw_from_matrices(R))
    np.testing.assert_allclose(again, R, atol=2e-15)


def test_1dsfm_on_real_data() -> None:
    folder = shared_data("1dsfm/Madrid_Metropolis")
    graph = read(folder)
    assert (graph.num_nodes, graph.num_edges) == (394, 23784)
    line = (folder / "EGs.txt").read_text().split("\n", 1)[0].split()
    names = [row.split()[0] for row in (folder / "list.txt").read_text().splitlines()]
    assert graph.edges[0].tolist() == [names[int(line[0])], names[int(line[1])]]
    matrix = np.array(line[2:11], dtype=float).reshape(3, 3)
    np.testing.assert_allclose(graph.rotations[0], matrix, atol=1e-5)  # six digits
    # Most of the graph is consistent in this family, and would not be in the other.
    i, j = graph.indices.T
    spread = [
        np.median(rotavg.hardness(MeasurementGraph(graph.edges, R)).cycle_angles)
        for R in (graph.rotations, np.swapaxes(graph.rotations, 1, 2))
    ]
    assert len(i) == len(j)
    assert spread[0] < spread[1]


def test_1dsfm_by_hand(tmp_path: Path) -> None:
    I9, t = "1 0 0 0 1 0 0 0 1", "0.5 0 0"
    egs = tmp_path / "EGs.txt"
    egs.write_text(f"0 2 {I9} {t}\n2 5 {I9} {t}\n")
    assert read(tmp_path).edges.tolist() == [[0, 2], [2, 5]]
    assert read(egs).num_edges == 2
    (tmp_path / "cc.txt").write_text("0\n2\n")
    graph = read(tmp_path)
    assert graph.edges.tolist() == [[0, 2]]
    assert graph.notes == ("1 edges outside the component in cc.txt left out",)
    (tmp_path / "list.txt").write_text("a.jpg 0 700\nb.jpg\nc.jpg\n")
    assert read(tmp_path).edges.tolist() == [["a.jpg", "c.jpg"]]
    (tmp_path / "list.txt").write_text("a.jpg\n\nc#1.jpg 0 700\n\n")  # ids are line numbers
    assert read(tmp_path).edges.tolist() == [["a.jpg", "c#1.jpg"]]
    (tmp_path / "list.txt").write_text("a.jpg\nb.jpg\n\nd.jpg\n")
    with pytest.raises(FormatError, match=r"list\.txt:3: found a blank line, .*name of node 2"):
        read(tmp_path)
    (tmp_path / "list.txt").write_text("a.jpg\n")
    with pytest.raises(FormatError, match=r"node 2, expected ids 0 to 0: list\.txt has 1 images"):
        read(tmp_path)
    (tmp_path / "cc.txt").write_text("0\nx\n")
    with pytest.raises(FormatError, match=r"cc\.txt:2: found 'x', expected an id"):
        read(tmp_path)
    (tmp_path / "cc.txt").write_text("7\n")
    with pytest.raises(FormatError, match=r"cc\.txt keeps none of the edges"):
        read(tmp_path)
    egs.write_text(f"0 2 {I9} {t}\n0 x {I9} {t}\n")
    with pytest.raises(FormatError, match=r"EGs\.txt:2: found '0' 'x' for i j"):
        read(tmp_path)
    egs.write_text(f"0 2 {I9} {t}\n0 3 {I9}\n")
    with pytest.raises(FormatError, match=r"EGs\.txt:2: found 9 numbers .*expected 12"):
        read(tmp_path)
    egs.write_text("# nothing\n")
    with pytest.raises(FormatError, match=r"EGs\.txt: the file has no edges"):
        read(tmp_path)


def test_1dsfm_makes_its_folder_or_nothing(tmp_path: Path) -> None:
    graph = random_graph(True, weighted=False)
    write(tmp_path / "scene", graph, format="1dsfm")
    files = sorted(file.name for file in (tmp_path / "scene").iterdir())
    assert files == ["EGs.txt", "cc.txt", "list.txt"]
    write(tmp_path / "scene", graph)  # a folder that is one already
    with pytest.raises(FileAccessError, match="cannot be written"):
        write(tmp_path / "no" / "such" / "scene", graph, format="1dsfm")
    with pytest.raises(FormatError, match="found a solution to write, expected a graph"):
        write(tmp_path / "other", random_answer(graph, seed=1), format="1dsfm")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["scene"]


def test_glomap_weights(tmp_path: Path) -> None:
    path = tmp_path / "x_relpose.txt"
    path.write_text("a b 1 0 0 0 0 0 1\nb c 1 0 0 0 0 0 1\n")
    graph = read(path)
    assert graph.weights.tolist() == [1, 1]
    assert "every pair weighs 1" in graph.notes[0]
    (tmp_path / "x_weight.txt").write_text("b a 7\n")
    graph = read(path)
    assert graph.weights.tolist() == [7, 1]
    assert graph.notes[1] == "1 pairs that are not in x_weight.txt weigh 1"
    (tmp_path / "x_weight.txt").write_text("b a seven\n")
    with pytest.raises(FormatError, match=r"x_weight\.txt:1: found 'seven', expected a number"):
        read(path)
    (tmp_path / "x_weight.txt").write_text("b a 7\n\nc b -1\n")
    with pytest.raises(FormatError, match=r"x_weight\.txt:3: found the weight -1, expected"):
        read(path)


def test_glomap_rotations(tmp_path: Path) -> None:
    answer = random_answer(random_graph(True), seed=2)
    write(tmp_path / "rotations.txt", answer, format="glomap")
    rows = [line.split() for line in (tmp_path / "rotations.txt").read_text().splitlines()]
    assert [row[0] for row in rows] == answer.graph.nodes.tolist()
    wxyz = np.array([[float(x) for x in row[1:]] for row in rows])
    camera_from_world = matrices_from_quaternions(wxyz[:, [1, 2, 3, 0]])
    np.testing.assert_allclose(camera_from_world, np.swapaxes(answer.rotations, 1, 2), atol=1e-14)


def test_irotavg_by_hand(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    path = tmp_path / "in.irotavg"
    path.write_text(f"2 3 1\n4 5 {half} 0 0 {half}\n5 9 1 0 0 0\n1 0 0 0\n")
    graph = read(path)
    assert graph.edges.tolist() == [[4, 5], [5, 9]]
    # Its R_ij = R_j R_i^T turns by +90 deg about z: ours by -90.
    np.testing.assert_allclose(graph.rotations[0], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)
    (note,) = graph.notes
    assert note.startswith("1 rotation held fixed")
    ids, fixed = read_rotations(path)
    assert (ids.tolist(), fixed.tolist()) == ([4], [np.eye(3).tolist()])
    for text, message in (
        ("2 3\n", r"irotavg:1: found '2 3', expected three integers m n f"),
        ("3 3 0\n0 1 1 0 0 0\n", "found 1 relative rotations, expected m = 3"),
        ("2 3 0\n0 1 1 0 0 0\n1 0 0 0\n", "irotavg:3: found .1 0 0 0., expected|numbers"),
        ("1 2 0\n0 1.5 1 0 0 0\n", "irotavg:2: found .*expected i j qw qx qy qz"),
        ("1 2 0\n--5 1 1 0 0 0\n", "irotavg:2: found .*expected i j qw qx qy qz"),
    ):
        path.write_text(text)
        with pytest.raises(FormatError, match=message):
            read(path)


def test_tum(tmp_path: Path) -> None:
    graph = MeasurementGraph([["2.5", "10"], ["10", "1e1"]], [np.eye(3)] * 2)
    answer = random_answer(graph, seed=3)
    write(tmp_path / "a.tum", answer)
    lines = [line.split() for line in (tmp_path / "a.tum").read_text().splitlines()]
    assert lines[0][1:] == ["timestamp", "x", "y", "z", "qx", "qy", "qz", "qw"]
    assert [line[0] for line in lines[1:]] == ["2.5", "10", "1e1"]
    row = graph.nodes.tolist().index("2.5")
    found = [float(x) for x in lines[1][1:]]
    assert found == [0, 0, 0, *answer.quaternions[row].tolist()]
    with pytest.raises(FormatError, match="found a graph to write, expected a solution"):
        write(tmp_path / "b.tum", graph)
    with pytest.raises(FormatError, match="found the node 'a', expected a number"):
        write(tmp_path / "b.tum", random_answer(MeasurementGraph([["a", "b"]], [np.eye(3)]), 1))
    with pytest.raises(FormatError, match="tum holds rotations alone"):
        read(tmp_path / "a.tum")


def test_any_name_comes_back_from_csv(tmp_path: Path) -> None:
    names = ["two words", "a,b", "#1", 'say "x"', " lead", "trail ", "plain", "ä", "''", "\t"]
    edges = list(zip(names, names[1:]))
    R = rotavg.simulate("cycle", 9, seed=1).graph.rotations
    graph = MeasurementGraph(edges, R, np.arange(1, 10))
    write(tmp_path / "names.csv", graph)
    again = read(tmp_path / "names.csv")
    assert again.edges.tolist() == graph.edges.tolist()
    np.testing.assert_array_equal(again.weights, graph.weights)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-14)
    (tmp_path / "names.dat").write_bytes((tmp_path / "names.csv").read_bytes())
    assert read(tmp_path / "names.dat").num_edges == 9
    write(tmp_path / "answer.csv", random_answer(graph, seed=1))
    for bad in ("a\nb", "a\u2028b"):
        with pytest.raises(FormatError, match="expected one line of text"):
            write(tmp_path / "bad.csv", MeasurementGraph([[bad, "x"]], [np.eye(3)]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('"a b",c,0,0,0,1\n"d e,c,0,0,0,1\n', r"q\.csv:\d: found no CSV: "),
        ('"a b",c,0,0,0,1\n\n# x\n"d e",c,0,0,zero,1\n', r"q\.csv:4: found 'zero', expected"),
        ('"a b",c,0,0,0,1\n"d e",c,0,0,0\n', r"q\.csv:2: found 3 numbers .*expected 4"),
    ],
)
def test_bad_csv_with_quotes(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "q.csv").write_text(text)
    with pytest.raises(FormatError, match=message):
        read(tmp_path / "q.csv")


def test_gravity(tmp_path: Path) -> None:
    vectors = np.random.default_rng(0).normal(size=(3, 3))
    write_gravity(tmp_path / "g.txt", ["a", "b", "c"], vectors)
    names, again = read_gravity(tmp_path / "g.txt")
    assert names == ["a", "b", "c"]
    np.testing.assert_array_equal(again, vectors)
    (tmp_path / "g.txt").write_text("a 0 1\n")
    with pytest.raises(FormatError, match=r"g\.txt:1: found 2 numbers .*expected 3"):
        read_gravity(tmp_path / "g.txt")
    (tmp_path / "g.txt").write_text("# nothing\n")
    with pytest.raises(FormatError, match=r"g\.txt: the file has no directions"):
        read_gravity(tmp_path / "g.txt")
