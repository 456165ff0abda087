"""Covariances in files, frames and networks: there and back, and what is wrong with them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rotavg
from random_graphs import graph_with_covariances


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".npz"])
def test_files_carry_covariances(tmp_path: Path, suffix: str) -> None:
    graph = graph_with_covariances(5)
    assert graph.covariances is not None
    path = tmp_path / f"graph{suffix}"
    rotavg.write(path, graph)
    again = rotavg.read(path)
    assert again.covariances is not None
    assert np.array_equal(again.covariances, graph.covariances)
    assert np.array_equal(again.weights, graph.weights)
    assert rotavg.read(path, unit_weights=True).covariances is None
    seen = rotavg.read(path, convention="vision")
    assert seen.covariances is not None
    R = seen.rotations
    np.testing.assert_allclose(
        seen.covariances, np.swapaxes(R, 1, 2) @ graph.covariances @ R, atol=1e-15
    )
    command = [sys.executable, "-m", "rotavg", "solve", str(path), "--anisotropic", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["anisotropic"] == "chordal"
    assert told["certificate"]["verdict"] == "proved"


def test_a_bad_covariance_in_a_file_is_named_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "graph.csv"
    header = "i,j,qx,qy,qz,qw,cxx,cxy,cxz,cyy,cyz,czz"
    path.write_text(f"{header}\n0,1,0,0,0,1,1,0,0,1,0,1\n1,2,0,0,0,1,1,0,0,-1,0,1\n")
    says = r"graph\.csv:3.*not positive definite: its eigenvalues are -1 to 1"
    with pytest.raises(rotavg.FormatError, match=says):
        rotavg.read(path)


@pytest.mark.parametrize("name", ["g.g2o", "g.graph", "g.json"])
def test_pose_graphs_carry_full_information(tmp_path: Path, name: str) -> None:
    graph = graph_with_covariances(3)
    rotavg.write(tmp_path / name, graph)
    again = rotavg.read(tmp_path / name)
    assert graph.covariances is not None
    assert again.covariances is not None
    np.testing.assert_allclose(again.covariances, graph.covariances, rtol=1e-9, atol=1e-12)
    expected = rotavg.solve(graph, anisotropic=True).objective
    assert rotavg.solve(again, anisotropic=True).objective == pytest.approx(expected, rel=1e-9)
    # Other weights than those of the covariances are read back, and scale them.
    weights = np.random.default_rng(0).uniform(0.5, 2.0, graph.num_edges)
    rotavg.write(tmp_path / name, graph.with_weights(weights))
    np.testing.assert_allclose(rotavg.read(tmp_path / name).weights, weights, rtol=1e-9)


def test_frames_and_networks_carry_covariances() -> None:
    graph = graph_with_covariances(4)
    expected = rotavg.solve(graph, anisotropic=True).objective
    for again in (
        rotavg.MeasurementGraph.from_dataframe(graph.to_dataframe()),
        rotavg.MeasurementGraph.from_networkx(graph.to_networkx()),
    ):
        assert rotavg.solve(again, anisotropic=True).objective == pytest.approx(expected, rel=1e-12)
    network = graph.to_networkx()
    next(iter(network.edges(data=True)))[2].pop("covariance")
    with pytest.raises(rotavg.GraphError, match="no attribute 'covariance', which"):
        rotavg.MeasurementGraph.from_networkx(network)


def test_one_uneven_information_is_told(tmp_path: Path) -> None:
    path = tmp_path / "g.g2o"
    rotavg.write(path, graph_with_covariances(5))
    lines = path.read_text().splitlines()
    fields = lines[2].split()
    fields[-6:] = ["1e15", "0", "0", "1", "0", "1"]
    path.write_text("\n".join([*lines[:2], " ".join(fields), *lines[3:]]) + "\n")
    graph = rotavg.read(path)
    assert graph.covariances is None
    assert any("covariances not used" in note and "in line 3" in note for note in graph.notes)
    with pytest.raises(rotavg.OptionError, match=r"has none; covariances not used: .* in line 3"):
        rotavg.solve(graph, anisotropic=True)
