"""Pose graphs written without the edges that a robust loss has rejected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotavg
from test_pose_losses import contaminated, run
from test_positions import pose_graph


def edge_lines(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if line.startswith("EDGE")]


def vertex_lines(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if line.startswith("VERTEX")]


@pytest.mark.parametrize("name", ["out.g2o", "out.graph", "out.json"])
def test_outliers_are_left_out_of_what_is_written(name: str, tmp_path: Path) -> None:
    """The same poses, and of the edges those that were kept, as they were."""
    graph, _, _ = pose_graph(30, seed=12, isotropic=True)
    rows = np.array([4, 21])
    source = tmp_path / "in.g2o"
    rotavg.write(source, contaminated(graph, rows, np.full((2, 3), 50.0)))
    read = rotavg.read(source)
    poses = rotavg.refine_poses(rotavg.solve(read), loss="tls")
    assert np.flatnonzero(poses.is_outlier).tolist() == rows.tolist()
    whole, kept = tmp_path / f"whole_{name}", tmp_path / name
    rotavg.write(whole, poses)
    rotavg.write(kept, poses, drop_outliers=True)
    before, after = rotavg.read(whole), rotavg.read(kept)
    left = np.delete(np.arange(graph.num_edges), rows)
    assert after.edges.tolist() == before.edges[left].tolist()
    np.testing.assert_array_equal(after.rotations, before.rotations[left])
    assert after.weights.tolist() == before.weights[left].tolist()
    if name == "out.g2o":
        assert vertex_lines(kept) == vertex_lines(whole)
        lines = edge_lines(source)
        assert edge_lines(kept) == [lines[k] for k in left]
    assert poses.inlier_graph.edges.tolist() == after.edges.tolist()
    assert poses.inlier_graph.num_nodes == graph.num_nodes


def test_a_graph_that_falls_apart_keeps_its_poses_and_says_so(tmp_path: Path) -> None:
    """Two parts that a wrong rotation and a wrong bridge beside it hold together."""
    turn = rotavg.simulate("cycle", 4, seed=3)
    edges = [(a + o, b + o) for o in (0, 3) for a, b in ((0, 1), (1, 2), (2, 0))] + [(0, 3), (1, 4)]
    R = np.tile(np.eye(3), (8, 1, 1))
    R[7] = turn.ground_truth[1]
    graph = rotavg.MeasurementGraph(
        edges, R, translations=rotavg.RelativeTranslations(np.ones((8, 3)))
    )
    solution = rotavg.solve(graph, excluded=np.arange(8) >= 6, loss="tls", loss_scale=0.1)
    whole, kept = tmp_path / "whole.g2o", tmp_path / "kept.g2o"
    rotavg.write(whole, solution)
    with pytest.warns(rotavg.IncompleteWarning, match="falls into 2 parts"):
        rotavg.write(kept, solution, drop_outliers=True)
    assert vertex_lines(kept) == vertex_lines(whole)
    assert len(edge_lines(kept)) == 6


def test_outliers_are_dropped_by_the_command(tmp_path: Path) -> None:
    graph, _, _ = pose_graph(30, seed=12, isotropic=True)
    source, out = tmp_path / "in.g2o", tmp_path / "out.g2o"
    rotavg.write(source, contaminated(graph, [4, 21], np.full((2, 3), 50.0)))
    refine = ("--refine-poses", "--pose-loss", "tls")
    assert run("solve", source, "-o", out, *refine, "--drop-outliers").exception is None
    assert len(edge_lines(out)) == graph.num_edges - 2
    for options, said in (
        (("-o", out, "--drop-outliers"), "--drop-outliers is for a robust"),
        (("--loss", "tls", "--drop-outliers"), "--drop-outliers is for --output"),
        (("-o", tmp_path / "o.csv", "--loss", "tls", "--drop-outliers"), "csv holds no edges"),
    ):
        assert said in str(run("solve", source, *options).exception)
    assert not (tmp_path / "o.csv").exists()


def test_edges_are_selected_by_a_mask() -> None:
    graph, _, _ = pose_graph(10, seed=13)
    mask = np.arange(graph.num_edges) % 2 == 0
    part = graph.edge_subgraph(mask)
    assert part.nodes.tolist() == graph.nodes.tolist()
    assert part.edges.tolist() == graph.edges[mask].tolist()
    assert part.translations is not None
    assert graph.translations is not None
    np.testing.assert_array_equal(part.translations.vectors, graph.translations.vectors[mask])
    with pytest.raises(rotavg.GraphError, match="expected booleans"):
        graph.edge_subgraph([0, 1])
    with pytest.raises(rotavg.GraphError):
        graph.edge_subgraph(~mask & mask)
