"""Edges without information, of weight 0, or from a node to itself."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.io import read, read_rotations
from small_files import I3, UNIT, put, run


def rotations_of(count: int) -> NDArray[np.float64]:
    return matrices_from_rotvecs(np.random.default_rng(count).standard_normal((count, 3)))


@pytest.mark.parametrize("kind", ["EDGE_SE3:QUAT 3 4", "EDGE_SE2 2 1", "EDGE3 3 3", "EDGE2 2 1"])
def test_pose_graphs_without_information(tmp_path: Path, kind: str) -> None:
    tag, moved, turned = kind.split()
    turn = "0 0 0 1" if turned == "4" else " ".join(["0.1"] * int(turned))
    move = " ".join(["1"] * int(moved))
    lines = [f"{tag} 0 1 {move} {turn}", f"{tag} 1 2 {move} {turn}"]
    path = put(tmp_path, "n.g2o", *lines)
    with pytest.raises(FormatError, match=r"n\.g2o:1: .*no information.*--unit-weights"):
        read(path)
    graph = read(path, unit_weights=True)
    assert graph.weights.tolist() == [1, 1]
    assert graph.notes == ("the edges have no information: every edge weighs 1",)
    run("convert", path, tmp_path / "out.g2o", "--unit-weights", "--output-format",
        "toro" if tag in ("EDGE3", "EDGE2") else "g2o")  # fmt: skip
    again = read(tmp_path / "out.g2o")
    np.testing.assert_allclose(again.weights, [1, 1])
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
    some = [lines[0], f"{lines[1]} {' '.join(['0'] * {'3': 21, '2': 6}[moved])}"]
    assert read(put(tmp_path, "some.g2o", *some), unit_weights=True).num_edges == 2
    with pytest.raises(FormatError, match=r"some\.g2o:1: found .* numbers"):
        read(tmp_path / "some.g2o")


def test_no_information_about_a_rotation_is_no_edge(tmp_path: Path) -> None:
    nothing = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0"
    lines = [f"EDGE_SE3:QUAT {k} {k + 1} 1 2 3 0 0 0 1 {UNIT}" for k in range(3)]
    path = put(tmp_path, "z.g2o", *lines, f"EDGE_SE3:QUAT 3 7 1 2 3 0 0 0 1 {nothing}")
    graph = read(path)
    assert (graph.num_edges, graph.nodes.tolist()) == (3, [0, 1, 2, 3, 7])
    assert graph.notes == ("1 edge of weight 0 is not used (it: 3 -> 7)",)
    assert graph.covariances is not None
    assert graph.translations is not None
    assert len(graph.covariances) == len(graph.translations) == 3
    assert read(path, unit_weights=True).num_edges == 4


def test_edges_of_weight_0_are_not_used() -> None:
    edges = np.array([[0, 1], [1, 2], [2, 0], [2, 3]])
    R = rotations_of(4)
    covariances = np.stack([(k + 1) * I3 for k in range(4)])
    graph = rotavg.MeasurementGraph(
        edges, R, [1, 0, 2, 0], covariances=covariances,
        translations=rotavg.RelativeTranslations(np.arange(12).reshape(4, 3)),
    )  # fmt: skip
    assert graph.edges.tolist() == [[0, 1], [2, 0]]
    assert graph.nodes.tolist() == [0, 1, 2, 3]
    assert graph.notes == ("2 edges of weight 0 are not used (the first: 1 -> 2)",)
    np.testing.assert_allclose(graph.rotations, R[[0, 2]], atol=1e-12)
    assert graph.translations is not None
    assert graph.covariances is not None
    assert graph.translations.vectors.tolist() == [[0, 1, 2], [6, 7, 8]]
    np.testing.assert_array_equal(graph.covariances, covariances[[0, 2]])
    assert rotavg.solve(graph).num_components == 2
    # Errors name edges as they were given.
    R[2, 0, 0] = 7
    with pytest.raises(GraphError, match=r"edge 2 \(2 -> 0\)") as caught:
        rotavg.MeasurementGraph(edges, R, [1, 0, 2, 0])
    assert caught.value.edge == 2
    with pytest.raises(GraphError, match="every edge has weight 0"):
        rotavg.MeasurementGraph(edges, R, np.zeros(4))
    full = rotavg.MeasurementGraph(edges, rotations_of(4))
    assert full.with_weights([0, 1, 1, 1]).edges.tolist() == edges[1:].tolist()


def test_edges_of_weight_0_in_files(tmp_path: Path) -> None:
    path = put(tmp_path, "z.txt", "0 1 0 0 0 1 2", "1 2 0 0 0 1 0", "2 0 0 0 0 1 -0.0")
    graph = read(path)
    assert graph.num_edges == 1
    assert "note: 2 edges of weight 0 are not used (the first: 1 -> 2)" in run("info", path)
    assert read(path, unit_weights=True).num_edges == 3
    put(tmp_path, "a_relpose.txt", "a b 1 0 0 0 0 0 0", "b c 1 0 0 0 0 0 0")
    put(tmp_path, "a_weight.txt", "b a 0", "b c 3")
    assert read(tmp_path / "a_relpose.txt").edges.tolist() == [["b", "c"]]
    np.savez(tmp_path / "w.npz", edges=[[0, 1], [1, 2]], rotations=[I3, I3], weights=[0.0, 1])
    assert read(tmp_path / "w.npz").edges.tolist() == [[1, 2]]


def test_self_edges_are_skipped_on_request(tmp_path: Path) -> None:
    edges, R = [["a", "b"], ["b", "b"], ["b", "c"]], rotations_of(3)
    with pytest.raises(GraphError, match=r"edge 1 .*it joins a node to itself"):
        rotavg.MeasurementGraph(edges, R)
    graph = rotavg.MeasurementGraph(edges, R, skip_self_edges=True)
    assert graph.edges.tolist() == [edges[0], edges[2]]
    assert graph.notes == ("1 edge from a node to itself is not used (it: 'b' -> 'b')",)
    path = put(tmp_path, "s.txt", "0 1 0 0 0 1", "1 1 0 0 0 1")
    with pytest.raises(FormatError, match=r"s\.txt:2: .*itself"):
        read(path)
    assert read(path, skip_self_edges=True).num_edges == 1
    for command in ("info", "solve"):
        assert "from a node to itself is not used" in run(command, path, "--skip-self-edges")
    run("convert", path, tmp_path / "t.txt", "--skip-self-edges")
    assert read(tmp_path / "t.txt").num_edges == 1


@pytest.mark.parametrize("place", range(21))
@pytest.mark.parametrize("word", ["inf", "nan", "1e999"])
def test_with_unit_weights_no_information_is_read(tmp_path: Path, place: int, word: str) -> None:
    values = UNIT.split()
    values[place] = word
    path = put(tmp_path, "in.g2o", f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {' '.join(values)}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read(path, unit_weights=True).num_edges == 1
    with pytest.raises(FormatError, match="expected a finite number"):
        read(path)


@pytest.mark.parametrize("word", ["1e308", "-1e200"])
def test_numbers_too_large_to_square_are_refused_without_a_warning(
    tmp_path: Path, word: str
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(FormatError, match="rotation vector of length inf"):
            read(put(tmp_path, "a.txt", "i j rx ry rz", f"0 1 {word} 0 0"))
        with pytest.raises(FormatError, match="quaternion of length inf"):
            read(put(tmp_path, "b.txt", f"0 1 {word} 0 0 1"))
        with pytest.raises(FormatError):
            read_rotations(put(tmp_path, "c.dat", f"0 1 2 3 0 0 {word} 1"))
