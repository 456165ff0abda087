"""Plain text and CSV."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from answers import random_answer
from rotavg.base.errors import FormatError
from rotavg.graph.conventions import matrices_from_quaternions
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import read, write
from rotavg.io.edges import read_edge_list
from rotavg.io.node_list import read_node_list
from rotavg.simulation.simulate import simulate


def weighted(names: bool = False) -> MeasurementGraph:
    graph = simulate("erdos_renyi", 40, density=0.2, noise=0.4, seed=3).graph
    weights = np.random.default_rng(3).uniform(1e-5, 1e5, graph.num_edges)
    edges = graph.edges
    return MeasurementGraph(
        np.char.add("img_", edges.astype(str)) if names else edges - 2**62, graph.rotations, weights
    )


@pytest.mark.parametrize("names", [False, True])
@pytest.mark.parametrize("suffix", [".txt", ".csv"])
def test_round_trip(tmp_path: Path, suffix: str, names: bool) -> None:
    graph = weighted(names)
    path = tmp_path / f"graph{suffix}"
    write(path, graph)
    again = read(path)
    np.testing.assert_array_equal(again.edges, graph.edges)
    np.testing.assert_array_equal(again.nodes, graph.nodes)
    np.testing.assert_array_equal(again.weights, graph.weights)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-14)
    assert read(path, unit_weights=True).weights.tolist() == [1.0] * graph.num_edges
    first = path.read_bytes().splitlines()[0]
    assert (b"pose family" in first) == (suffix == ".txt")
    assert (first == b"i,j,qx,qy,qz,qw,weight") == (suffix == ".csv")
    # The content tells, whatever the name.
    (tmp_path / "graph.dat").write_bytes(path.read_bytes())
    assert read(tmp_path / "graph.dat").num_edges == graph.num_edges


def test_read_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "hand.txt"
    path.write_bytes(
        b"\xef\xbb\xbfi j QX qy qz qw weight\r\n"
        b"# half a turn about z\r\n\r\n"
        b"5, 3, 0, 0, 1, 0, 2.5\r\n"
        b"  3\t9 , 0 0 0 -1.05 1e-2 # identity\n"
    )
    graph = read(path)
    assert graph.edges.tolist() == [[5, 3], [3, 9]]
    assert graph.weights.tolist() == [2.5, 0.01]
    np.testing.assert_allclose(graph.rotations, [np.diag([-1, -1, 1]), np.eye(3)], atol=1e-15)
    path.write_text("5 3 0 0 1 0\n")
    assert read(path).weights.tolist() == [1]


def test_leading_zeros_make_names(tmp_path: Path) -> None:
    path = tmp_path / "zeros.txt"
    path.write_text("007 8 0 0 0 1\n8 7 0 0 0 1\n")
    assert read(path).nodes.tolist() == ["007", "7", "8"]


def test_64_bit_ids_are_exact(tmp_path: Path) -> None:
    path = tmp_path / "big.csv"
    path.write_text(f"{2**63 - 1},{2**63 - 2},0,0,0,1\n{2**63 - 2},{-(2**63)},0,0,0,1\n")
    assert read(path).nodes.tolist() == [-(2**63), 2**63 - 2, 2**63 - 1]


@pytest.mark.parametrize(("suffix", "separator"), [(".txt", " "), (".csv", ",")])
def test_solution(tmp_path: Path, suffix: str, separator: str) -> None:
    answer = random_answer(weighted(names=True), seed=8)
    path = tmp_path / f"answer{suffix}"
    write(path, answer)
    lines = path.read_text().splitlines()
    if suffix == ".txt":
        assert lines.pop(0).startswith("# rotavg rotations, pose family")
    assert lines[0].lstrip("# ").split(separator) == ["id", "qx", "qy", "qz", "qw"]
    rows = [line.split(separator) for line in lines[1:]]
    assert [row[0] for row in rows] == answer.graph.nodes.tolist()
    found = np.array([[float(x) for x in row[1:]] for row in rows])
    np.testing.assert_array_equal(found, answer.quaternions)
    np.testing.assert_allclose(matrices_from_quaternions(found), answer.rotations, atol=1e-14)
    with pytest.raises(FormatError, match=r"looks like a solution .* expected edges: i j qx"):
        read(path)


def test_names_that_would_not_come_back(tmp_path: Path) -> None:
    for name in ("two words", "a,b", "a;b", "a#b", "line\nend"):
        graph = MeasurementGraph([[name, "x"]], [np.eye(3)])
        with pytest.raises(FormatError, match="expected no blank, comma, semicolon or #"):
            write(tmp_path / "names.txt", graph)
    assert list(tmp_path.iterdir()) == []


def test_a_header_of_other_names_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "header.csv"
    path.write_text("i,j,q1,q2,q3,q4\n0,1,1,0,0,0\n")
    with pytest.raises(FormatError, match=r"header\.csv:1: found the header .*'q4'.*expected i j"):
        read(path)


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("separator", [";", ","])
def test_the_separator_that_excel_is_told_is_no_row(
    tmp_path: Path, separator: str, quote: str
) -> None:
    names = [f"{quote}{word}{quote}" for word in ("i", "j", "qx", "qy", "qz", "qw")]
    rows = [f"sep={separator}", separator.join(names), separator.join(["a", "b", *"0001"])]
    path = tmp_path / "excel.csv"
    path.write_text("\n".join(rows) + "\n")
    assert read(path).edges.tolist() == [["a", "b"]]
    edges = tmp_path / "edges.csv"
    edges.write_text("\n".join([rows[0], separator.join(names[:2]), f"a{separator}b"]))
    assert read_edge_list(edges, "trusted") == ([("a", "b")], [3])


@pytest.mark.parametrize(
    ("name", "lines", "line"),
    [
        ("edges.txt", [b"a b 0 0 0 1", b"# \xe9", b"b c\xe9 0 0 0 1"], 3),
        ("edges.csv", [b"i,j,qx,qy,qz,qw", b"c\xe9,b,0,0,0,1"], 2),
        ("quoted.csv", [b"i,j,qx,qy,qz,qw", b'"a b",c,0,0,0,1', b'"a b",c\xe9,0,0,0,1'], 3),
    ],
)
def test_names_in_another_coding_are_shown_with_their_line(
    tmp_path: Path, name: str, lines: list[bytes], line: int
) -> None:
    path = tmp_path / name
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(FormatError, match=rf"{name}:{line}: found '.*é.*Latin-1, .*expected UTF-8"):
        read(path)
    nodes = tmp_path / "nodes.txt"
    nodes.write_bytes(b"b\n\nc\xe9\n")
    with pytest.raises(FormatError, match=r"nodes\.txt:3: found 'cé'"):
        read_node_list(nodes)


def test_many_edges_are_read_quickly(tmp_path: Path) -> None:
    q = np.random.default_rng(0).standard_normal((100_000, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    lines = [f"{k} {k + 1} {a!r} {b!r} {c!r} {d!r}" for k, (a, b, c, d) in enumerate(q.tolist())]
    path = tmp_path / "many.txt"
    path.write_text("\n".join(lines))
    start = time.process_time()
    assert read(path).num_edges == 100_000
    seconds = time.process_time() - start
    print(f"100000 edges: {seconds:.2f} s")
    assert seconds < 5  # 0.3 s on a quiet machine
