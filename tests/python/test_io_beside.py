"""What stands beside a file and belongs to it: weights of GLOMAP's, names of 1DSfM's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotavg

EDGES = [("a", "b"), ("b", "c"), ("b", "a"), ("c", "a")]
R = rotavg.MeasurementGraph.from_rotvecs(EDGES, np.linspace(0, 1, 12).reshape(4, 3)).rotations


def test_parallel_edges_keep_a_weight_each(tmp_path: Path) -> None:
    path = tmp_path / "relpose.txt"
    graph = rotavg.MeasurementGraph(EDGES, R, [1.0, 2.0, 3.0, 4.0])
    rotavg.write(path, graph)
    assert rotavg.read(path).weights.tolist() == [1.0, 2.0, 3.0, 4.0]
    weights = tmp_path / "weight.txt"
    weights.write_text("b a 5\n" + weights.read_text())  # not a line for each: the last holds
    assert rotavg.read(path).weights.tolist() == [3.0, 2.0, 3.0, 4.0]
    weights.write_text("b a 5\n")
    assert rotavg.read(path).weights.tolist() == [5.0, 1.0, 5.0, 1.0]


def test_weights_of_another_graph_do_not_stay(tmp_path: Path) -> None:
    path = tmp_path / "relpose.txt"
    for weights in ([1.0, 2.0, 3.0, 4.0], [1.0] * 4):
        rotavg.write(path, rotavg.MeasurementGraph(EDGES, R, weights))
        assert rotavg.read(path).weights.tolist() == weights


def test_names_of_another_graph_do_not_stay(tmp_path: Path) -> None:
    path = tmp_path / "EGs.txt"
    rotavg.write(path, rotavg.MeasurementGraph(EDGES, R))
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    numbers = rotavg.MeasurementGraph([(0, 1), (1, 2), (1, 0), (2, 0)], R)
    with pytest.raises(rotavg.FormatError, match=r"EGs\.txt: found a list\.txt beside it"):
        rotavg.write(path, numbers)
    assert before == {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    (tmp_path / "list.txt").unlink()
    rotavg.write(path, numbers)
    assert rotavg.read(path).edges.tolist() == numbers.edges.tolist()
