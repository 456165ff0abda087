"""Where a graph in parts comes from, and goes to: chunks, folders, functions, and their faults."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from benchmarks.inline_client import InlineClient
from distributed_graphs import GRAPHS, with_two_components

pytest.importorskip("distributed", reason="needs the extra [distributed]")
pytest.importorskip("pymetis", reason="needs the extra [distributed]")

from rotavg.distributed import solve

pytestmark = pytest.mark.filterwarnings("default")  # Dask's and Tornado's own


@pytest.fixture(scope="module")
def client() -> InlineClient:
    return InlineClient()


@pytest.mark.parametrize("kind", ["folder", "functions"])
def test_measurements_come_in_chunks(client: Any, tmp_path: Path, kind: str) -> None:
    graph = GRAPHS["sphere"]
    pieces = []
    for k, rows in enumerate(np.array_split(np.arange(len(graph.edges)), 7)):
        piece = rotavg.MeasurementGraph(
            graph.edges[rows], graph.rotations[rows], graph.weights[rows]
        )
        rotavg.write(tmp_path / f"piece-{k}.{'npz' if k % 2 else 'txt'}", piece)
        pieces.append(piece)
    source = tmp_path if kind == "folder" else [lambda piece=piece: piece for piece in pieces]
    found = solve(source, client=client, parts=3, tolerance=1e-7)
    assert found.num_parts == 3
    assert found.solved
    assert found.objective == pytest.approx(rotavg.solve(graph).objective, rel=1e-9)
    out = tmp_path / "solved"
    found.write(out)
    files = sorted(out.iterdir())
    assert [file.name for file in files] == [f"part-{p:05d}.npz" for p in range(3)]
    nodes = np.concatenate([np.load(file)["nodes"] for file in files])
    assert sorted(nodes) == graph.nodes.tolist()


def test_what_cannot_be_solved_is_told(client: Any, tmp_path: Path) -> None:
    named = rotavg.MeasurementGraph([("a", "b")], np.eye(3)[None])
    with pytest.raises(rotavg.GraphError, match="integer node ids, and these are names"):
        solve(named, client=client)
    with pytest.raises(rotavg.OptionError, match="parts is 0"):
        solve(GRAPHS["sphere"], client=client, parts=0)
    with pytest.raises(rotavg.OptionError, match="loss is 'huber'"):
        solve(GRAPHS["sphere"], client=client, loss="huber")  # type: ignore[arg-type]
    (tmp_path / "lost").mkdir()
    (tmp_path / "lost" / "b.g2o").symlink_to(tmp_path / "unmounted")
    with pytest.raises(rotavg.FormatError, match=r"b\.g2o: is no file, expected one with edges"):
        solve(tmp_path / "lost", client=client)
    with pytest.raises(rotavg.FormatError, match="holds no file"):
        solve(tmp_path, client=client)
    (tmp_path / "bad.txt").write_text("1 2 nonsense\n")
    with pytest.raises(rotavg.FormatError, match=r"bad\.txt"):
        solve(tmp_path, client=client)


def with_nodes_alone() -> rotavg.MeasurementGraph:
    graph = with_two_components()
    nodes = np.concatenate([[-5], graph.nodes, [5000, 5001]])
    return rotavg.MeasurementGraph(graph.edges, graph.rotations, graph.weights, nodes=nodes)


@pytest.mark.parametrize("chunked", [False, True])
def test_nodes_without_an_edge_stay(
    client: Any, monkeypatch: pytest.MonkeyPatch, chunked: bool
) -> None:
    monkeypatch.setattr("rotavg.distributed.proof.FEW_PRODUCTS", 5000)
    graph = with_nodes_alone()
    source: Any = graph
    if chunked:
        half = len(graph.edges) // 2
        ends, R, w = graph.edges, graph.rotations, graph.weights
        alone = np.array([-5, 5000, 5001])
        source = [
            lambda: rotavg.distributed.Edges(ends[:half, 0], ends[:half, 1], R[:half], w[:half]),
            lambda: rotavg.MeasurementGraph(ends[half:], R[half:], w[half:]),
            lambda: rotavg.distributed.Edges(
                *(np.zeros(0, np.int64),) * 2, np.zeros((0, 3, 3)), np.zeros(0), alone
            ),
        ]
    found = solve(source, client=client, parts=3, tolerance=1e-9)
    expected = rotavg.solve(graph, tolerance=1e-11)
    assert found.solved
    assert found.num_nodes == len(graph.nodes)
    nodes, R = found.gather()
    assert np.array_equal(nodes, np.sort(graph.nodes))
    # The first of each component is I, as in one process; so are those without an edge.
    assert np.abs(R - expected.rotations).max() < 1e-6
    assert np.array_equal(R[[0, -2, -1]], np.tile(np.eye(3), (3, 1, 1)))
    assert found.certificate is not None
    assert len(found.certificate.components) == 2


def test_few_chunks_are_divided(client: Any) -> None:
    graph = GRAPHS["sphere"]
    first = graph.edges[:, 0] < 150
    source = [
        lambda rows=rows: rotavg.MeasurementGraph(graph.edges[rows], graph.rotations[rows])
        for rows in (first, ~first)
    ]
    found = solve(source, client=client, parts=6, tolerance=1e-7, certify=False)
    assert found.num_parts == 6
    assert found.objective == pytest.approx(rotavg.solve(graph).objective, rel=1e-9)
    largest = max(part.num_own for part in client.gather(found.network.parts))
    assert largest < 2 * len(graph.nodes) / 6


def test_what_a_source_does_wrong_is_told(client: Any, tmp_path: Path) -> None:
    good = GRAPHS["one edge"]
    Edges = rotavg.distributed.Edges
    one, R = np.array([1]), np.eye(3)[None]

    def broken() -> Edges:
        raise KeyError("tile 7")

    for source, error, message in (
        (broken, rotavg.SolverError, r"source 1, broken: KeyError: 'tile 7'"),
        (partial(int, "x"), rotavg.SolverError, r"source 1, int: ValueError: invalid literal"),
        (lambda: 3, rotavg.GraphError, r"source 1, .*found a int, expected a MeasurementGraph"),
        (lambda: Edges(one, one, R, np.ones(1)), rotavg.GraphError, r"source 1.*to itself"),
        (lambda: Edges(one, one + 1, 2 * R, np.ones(1)), rotavg.GraphError, "source 1.*edge"),
        (lambda: Edges(one, one + 1, R, -np.ones(1)), rotavg.GraphError, "source 1.*weight"),
        ("no function", rotavg.GraphError, "source 1 is a str, expected a function"),
    ):
        with pytest.raises(error, match=message):
            solve([lambda: good, source], client=client)  # type: ignore[list-item]
    nothing = Edges(one[:0], one[:0], R[:0], np.ones(0))
    assert solve([lambda: good, lambda: nothing], client=client).num_edges == 1
    with pytest.raises(rotavg.GraphError, match="nothing to solve"):
        solve([lambda: nothing], client=client)
    with pytest.raises(rotavg.GraphError, match="nothing to solve"):
        solve([], client=client)
    rotavg.write(tmp_path / "good.txt", good)
    (tmp_path / ".hidden").write_text("no edges")
    assert solve(tmp_path, client=client).num_edges == 1
    (tmp_path / "empty.txt").touch()
    with pytest.raises(rotavg.FormatError, match=r"empty\.txt: the file is empty"):
        solve(tmp_path, client=client)
    with pytest.raises(rotavg.FormatError, match="nowhere: is no folder"):
        solve(tmp_path / "nowhere", client=client)
