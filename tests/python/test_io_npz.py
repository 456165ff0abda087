"""NumPy archives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from answers import random_answer
from rotavg.base.errors import FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import read, read_rotations, write
from rotavg.simulation.simulate import simulate
from shared_data import shared_data


@pytest.mark.parametrize("names", [False, True])
def test_round_trip(tmp_path: Path, names: bool) -> None:
    graph = simulate("grid", 30, noise=0.2, seed=6).graph
    nodes = np.append(graph.nodes[::-1], 99)
    edges = graph.edges
    if names:
        nodes, edges = nodes.astype(str), edges.astype(str)
    weights = np.arange(1.0, graph.num_edges + 1)
    graph = MeasurementGraph(edges, graph.rotations, weights, nodes)
    write(tmp_path / "graph.npz", graph)
    again = read(tmp_path / "graph.npz")
    for attribute in ("nodes", "edges", "indices", "weights"):
        np.testing.assert_array_equal(getattr(again, attribute), getattr(graph, attribute))
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
    assert again.notes == ()
    assert set(read(tmp_path / "graph.npz", unit_weights=True).weights) == {1.0}


def test_covariances_come_back(tmp_path: Path) -> None:
    graph = simulate("cycle", 5, seed=1).graph
    covariances = np.eye(3) * np.array([1.0, 2.0, 3.0]) * np.arange(1, 6)[:, None, None]
    graph = MeasurementGraph(graph.edges, graph.rotations, covariances=covariances)
    write(tmp_path / "graph.npz", graph)
    again = read(tmp_path / "graph.npz")
    assert again.covariances is not None
    np.testing.assert_array_equal(again.covariances, covariances)
    assert again.notes == ()


def test_solution(tmp_path: Path) -> None:
    answer = random_answer(simulate("cycle", 5, seed=1).graph, seed=1)
    write(tmp_path / "answer.npz", answer)
    with np.load(tmp_path / "answer.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["nodes"], np.arange(5))
        np.testing.assert_array_equal(archive["rotations"], answer.rotations)
        np.testing.assert_array_equal(archive["quaternions"], answer.quaternions)
        assert archive["objective"] == answer.objective
        assert archive["status"] == "gradient_converged"
        assert archive["certificate_verdict"] == "proved"
        assert archive["certificate_lambda_min"] == answer.certificate.lambda_min
    with pytest.raises(FormatError, match=r"answer\.npz: the archive holds a solution"):
        read(tmp_path / "answer.npz")


def test_other_names_and_extra_arrays(tmp_path: Path) -> None:
    path = tmp_path / "plain.npz"
    np.savez_compressed(path, edges=[[0, 1]], relative_rotations=[np.eye(3)], color=[1])
    graph = read(path)
    assert graph.num_edges == 1
    assert graph.notes == ("arrays not read: color",)


def test_bad_archives(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    np.savez(path, edges=[[0, 1]])
    with pytest.raises(FormatError, match=r"bad\.npz: found the arrays edges, expected edges and"):
        read(path)
    np.savez(path, edges=[[0, 1]], rotations=np.array([{"a": 1}], dtype=object))
    with pytest.raises(FormatError, match=r"bad\.npz: found no readable npz archive: .*pickle"):
        read(path)
    np.savez(path, edges=[[0, 1], [1, 1]], rotations=[np.eye(3)] * 2)
    with pytest.raises(FormatError, match=r"bad\.npz: edge 1 \(1 -> 1\): "):
        read(path)
    np.savez(path, edges=[[0, 1]], rotations=np.eye(3))
    with pytest.raises(FormatError, match=r"rotations have shape \(3, 3\), expected \(1, 3, 3\)"):
        read(path)
    np.savez(path, nodes=3, rotations=[np.eye(3)])
    with pytest.raises(FormatError, match=r"bad\.npz: nodes have shape \(\), expected \(n,\)"):
        read_rotations(path)
    np.save(tmp_path / "array.npy", np.eye(3))
    path.write_text("0 1 0 0 0 1\n")
    for other in (tmp_path / "array.npy", path):
        for reads in (read, read_rotations):
            with pytest.raises(FormatError, match="found no npz archive, expected one as numpy"):
                reads(other, format="npz")
    np.savez(path, edges=[[0, 1]], rotations=[np.eye(3)])
    whole = path.read_bytes()
    for size in (5, len(whole) // 3, len(whole) - 10):
        path.write_bytes(whole[:size])
        with pytest.raises(FormatError, match=r"bad\.npz: found no readable npz archive"):
            read(path)


def test_real_graph() -> None:
    path = shared_data("ellis_island/ellis_island.npz")
    graph = read(path)
    assert (graph.num_nodes, graph.num_edges) == (247, 20297)
    with np.load(path, allow_pickle=False) as archive:
        truth, known = archive["ground_truth"], archive["has_ground_truth"]
    i, j = graph.indices.T
    both = known[graph.nodes][i] & known[graph.nodes][j]
    truth = truth[graph.nodes]
    error = truth[i] @ graph.rotations @ np.swapaxes(truth[j], 1, 2)
    angle = np.degrees(np.arccos(np.clip((np.trace(error, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert np.median(angle[both]) == pytest.approx(2.89, abs=0.01)  # so the convention is right
