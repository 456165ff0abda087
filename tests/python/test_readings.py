"""What part of a file is used, and what other way of reading it the cycles suggest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import GraphError
from rotavg.cli.main import commands
from rotavg.evaluation.readings import other_reading
from rotavg.graph.conventions import (
    matrices_from_quaternions,
    matrices_from_rotvecs,
    quaternions_from_matrices,
)


def run(*arguments: Any, status: int = 0) -> str:
    result = CliRunner().invoke(commands, [str(a) for a in arguments])
    if isinstance(result.exception, rotavg.Error):
        assert status == 2, result.exception
        return str(result.exception)
    assert result.exit_code == status, result.output
    return result.output


def w_first(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """What comes of quaternions wxyz that are read as xyzw."""
    return matrices_from_quaternions(quaternions_from_matrices(R)[:, [3, 0, 1, 2]])


def measured(kind: str, noise: float, outliers: float, seed: int) -> rotavg.MeasurementGraph:
    return rotavg.simulate(kind, 60, noise=noise, outliers=outliers, seed=seed).graph


@pytest.mark.parametrize("kind", ["complete", "erdos_renyi"])
@pytest.mark.parametrize(("noise", "outliers"), [(0.0, 0.0), (0.03, 0.0), (0.03, 0.2), (0.1, 0.1)])
def test_the_right_reading_is_found_and_kept(kind: str, noise: float, outliers: float) -> None:
    for seed in range(3):
        graph = measured(kind, noise, outliers, seed)
        R = np.asarray(graph.rotations)
        assert other_reading(graph) is None
        for turned, expected in (
            (np.swapaxes(R, 1, 2), (True, False)),
            (w_first(R), (False, True)),
            (w_first(np.swapaxes(R, 1, 2)), (True, True)),
        ):
            found = other_reading(rotavg.MeasurementGraph(graph.edges, turned))
            assert found is not None, (kind, noise, outliers, seed, expected)
            assert (found.other_family, found.w_first) == expected
            assert found.noise < found.noise_as_read


def test_of_a_large_dense_graph_some_nodes_tell() -> None:
    graph = rotavg.simulate("complete", 700, noise=0.05, outliers=0.1, seed=2).graph
    assert graph.num_edges > 200_000
    assert other_reading(graph) is None
    turned = rotavg.MeasurementGraph(graph.edges, np.swapaxes(graph.rotations, 1, 2))
    found = other_reading(turned)
    assert found is not None
    assert found.other_family
    assert found.noise < 0.1 < found.noise_as_read


@pytest.mark.parametrize("seed", range(5))
def test_what_fits_in_no_reading_is_left_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = [(i, j) for i in range(12) for j in range(i)]
    R = matrices_from_rotvecs(3 * rng.standard_normal((len(edges), 3)))
    assert other_reading(rotavg.MeasurementGraph(edges, R)) is None
    tree = rotavg.MeasurementGraph([[0, k] for k in range(1, 8)], R[:7])
    assert other_reading(tree) is None


def test_the_commands_suggest_it(tmp_path: Path) -> None:
    graph = measured("complete", 0.03, 0.0, 1)
    q = quaternions_from_matrices(np.swapaxes(graph.rotations, 1, 2))[:, [3, 0, 1, 2]]
    rows = [
        f"{i} {j} {' '.join(map(repr, row))}"
        for (i, j), row in zip(graph.edges.tolist(), q.tolist())
    ]
    path = tmp_path / "theirs.txt"
    advice = "with --columns i,j,qw,qx,qy,qz{} --convention vision"
    for weight, words in (("", ""), (" 2.5", ",weight")):
        path.write_text("\n".join(row + weight for row in rows))
        assert advice.format(words) in run("info", path)
        assert advice.format(words) in run("solve", path, "--no-certify")
        assert any(advice.format(words) in note for note in
                   json.loads(run("info", path, "--json"))["notes"])  # fmt: skip
        columns = f"i,j,qw,qx,qy,qz{words}"
        good = run("info", path, "--columns", columns, "--convention", "vision")
        assert "cycles do not close" not in good
        half = run("info", path, "--columns", columns)
        assert "with --convention vision" in half
    # What a header says of the order is believed; a format that leaves nothing open is, too.
    path.write_text("\n".join(["i j qw qx qy qz", *rows]))
    assert "with --convention vision" in run("info", path)
    rotavg.write(
        tmp_path / "x.irotavg", rotavg.MeasurementGraph(graph.edges, w_first(graph.rotations))
    )
    assert "do not close" not in run("info", tmp_path / "x.irotavg")


def parts() -> rotavg.MeasurementGraph:
    edges = [["a", "b"], ["b", "c"], ["c", "a"], ["p", "q"], ["x y", "z"], ["z", "u"], ["u", "v"]]
    R = matrices_from_rotvecs(np.random.default_rng(1).standard_normal((7, 3)))
    return rotavg.MeasurementGraph(edges, R, nodes=[*"abcpq", "x y", *"zuv", "alone"])


def test_parts_of_a_graph(tmp_path: Path) -> None:
    graph = parts()
    assert graph.largest_component().nodes.tolist() == ["x y", *"zuv"]
    assert graph.without_small_components(1) is graph
    assert graph.without_small_components(3).nodes.tolist() == [*"abc", "x y", *"zuv"]
    with pytest.raises(GraphError, match="the largest component has 4 nodes, expected one of 5"):
        graph.without_small_components(5)

    path = tmp_path / "parts.npz"
    rotavg.write(path, graph)
    (tmp_path / "images.lst").write_text("x y\nz\n\nu\ngone.jpg\n")
    for options, nodes, told in (
        (("--largest-component",), 4, "6 of 10 nodes and 4 edges left out, as was asked for"),
        (("--min-nodes", 3), 7, "3 of 10 nodes and 1 edge left out, as was asked for"),
        (("--nodes", tmp_path / "images.lst"), 3, "1 of 4 nodes are not in the graph"),
    ):
        for command in ("info", "solve"):
            figures = json.loads(run(command, path, "--json", *options))
            assert figures["nodes"] == nodes
            assert any(told in note for note in figures["notes"])
            assert f"note: {told}" in run(command, path, *options).replace(f"{options[-1]}: ", "")
        out = tmp_path / "out.csv"
        run("solve", path, *options, "-o", out)
        assert len(rotavg.read_rotations(out)[0]) == nodes
        run("convert", path, tmp_path / "out.txt.npz", *options)
        assert rotavg.read(tmp_path / "out.txt.npz").num_nodes == nodes
    (tmp_path / "none.lst").write_text("nobody\n")
    message = run("info", path, "--nodes", tmp_path / "none.lst", status=2)
    assert "none of its nodes is in the graph, expected ids as in the graph (say, 'a')" in message
    assert "expected one of 5 at least" in run("solve", path, "--min-nodes", 5, status=2)


def test_integers_in_a_list_of_nodes(tmp_path: Path) -> None:
    path, part = tmp_path / "g.txt", tmp_path / "part.txt"
    path.write_text("".join(f"{k} {k + 1} 0 0 0 1\n" for k in range(6)))
    part.write_text("\ufeff3\r\n4\r\n5\r\n")
    assert json.loads(run("info", path, "--nodes", part, "--json"))["nodes"] == 3
    part.write_text("3\n# four\n5\n")
    message = run("info", path, "--nodes", part, status=2)
    assert "found the node '# four', but the nodes of the graph are numbers" in message


def test_the_front_door_from_python(tmp_path: Path) -> None:
    graph = measured("erdos_renyi", 0.03, 0.1, seed=1)
    path = tmp_path / "graph.txt"
    rotavg.write(path, graph)
    assert rotavg.suggest_reading(path) is None
    assert rotavg.suggest_reading(graph) is None
    found = rotavg.suggest_reading(path, convention="vision")
    assert found is not None
    assert found.options == {"convention": "pose"}
    assert found.noise < found.noise_as_read
    assert str(found).endswith("deg) with convention='pose'")
    wrong = rotavg.MeasurementGraph(graph.edges, np.swapaxes(graph.rotations, 1, 2))
    found = rotavg.suggest_reading(wrong)
    assert found is not None
    assert found.options == {"convention": "vision"}
    again = rotavg.MeasurementGraph(wrong.edges, wrong.rotations, **found.options)
    np.testing.assert_allclose(again.rotations, graph.rotations)

    q = quaternions_from_matrices(graph.rotations)[:, [3, 0, 1, 2]]
    rows = [f"{i} {j} {' '.join(map(repr, row))}" for (i, j), row in zip(graph.edges, q.tolist())]
    path.write_text("\n".join(rows) + "\n")
    found = rotavg.suggest_reading(path)
    assert found is not None
    assert found.options == {"columns": "i,j,qw,qx,qy,qz"}
    again = rotavg.read(path, **found.options)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-12)
    assert rotavg.suggest_reading(path, **found.options) is None
    both = rotavg.suggest_reading(path, convention="vision")
    assert both is not None
    assert both.options == {"columns": "i,j,qw,qx,qy,qz", "convention": "pose"}
    found = rotavg.suggest_reading(rotavg.MeasurementGraph(graph.edges, w_first(graph.rotations)))
    assert found is not None
    assert found.options == {"order": "wxyz"}


def test_formats_that_leave_nothing_open_get_no_suggestion(tmp_path: Path) -> None:
    graph = measured("erdos_renyi", 0.03, 0.0, seed=2)
    turned = rotavg.MeasurementGraph(graph.edges, np.swapaxes(graph.rotations, 1, 2))
    rotavg.write(tmp_path / "g.g2o", turned)
    assert rotavg.suggest_reading(tmp_path / "g.g2o") is None
    rotavg.write(tmp_path / "g.json", turned)
    assert rotavg.suggest_reading(tmp_path / "g.json") is None
