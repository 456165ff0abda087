"""What files of measurements know beforehand: the same in Python as by the command."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rotavg
from colmap_scenes import Scene

pytest.importorskip("pycolmap", reason="pycolmap is not installed: pip install rotavg[colmap]")


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rotavg", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("gravity", [False, True])
def test_python_finds_what_the_command_finds(tmp_path: Path, gravity: bool) -> None:
    scene = Scene(tmp_path / "rig.db", seed=1, noise=1.0, wrong=0.1, gravity=True)
    options = ["--gravity", scene.path] if gravity else []
    done = run("solve", scene.path, "--loss", "auto", "-o", tmp_path / "s.npz", *options)
    assert done.returncode == 0, done.stderr
    graph = rotavg.read(scene.path)
    priors = rotavg.read_priors(scene.path, graph, gravity=gravity)
    solution = rotavg.solve(graph, loss="auto", priors=priors)
    assert rotavg.compare(solution, tmp_path / "s.npz").angles.max() < 1e-9
    separate = rotavg.solve(graph, loss="auto")
    errors = [rotavg.compare(s, scene.truth).rms for s in (solution, separate)]
    assert errors[0] < 0.8 * errors[1], errors
    # What is not used is told, with the line that uses it.
    line = f"rotavg.solve(graph, priors=rotavg.read_priors({str(scene.path)!r}, graph))"
    assert sum(line in note for note in graph.notes) == 1
    assert eval(line, {"rotavg": rotavg, "graph": graph}).rigs is not None
    assert "not used    rigs of 20 frames" in str(separate)
    assert "not used" not in str(solution) + done.stdout
    assert "not used" in run("solve", scene.path, "--no-rigs").stdout


def test_gravity_of_the_nodes_of_a_graph(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "rig.db", seed=2, gravity=True)
    graph = rotavg.read(scene.path)
    part = graph.subgraph(graph.nodes[:12])
    with pytest.warns(rotavg.IncompleteWarning, match="48 of 60 nodes are not in the graph"):
        downs = rotavg.io.read_gravity(scene.path, part)
    assert sorted(downs) == sorted(part.nodes.tolist())
    for node, (down, weight) in downs.items():
        np.testing.assert_allclose(down, scene.truth[node].T @ [0, 1, 0], atol=1e-12)
        assert weight == np.median(part.weights)
    solution = rotavg.solve(part, priors=rotavg.Priors(gravity=downs))
    for node, (down, _) in downs.items():
        np.testing.assert_allclose(solution[node] @ down, [0, 1, 0], atol=1e-6)
    assert rotavg.io.read_gravity(scene.path, graph, weight=7.0)[graph.nodes[3]][1] == 7


def test_what_has_no_priors_says_so(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "rig.db", seed=3, cameras=1)
    graph = rotavg.read(scene.path)
    assert not any("read_priors" in note for note in graph.notes)
    priors = rotavg.read_priors(scene.path, graph)
    assert not priors.rigs
    assert rotavg.solve(graph, priors=priors).objective == rotavg.solve(graph).objective
    with pytest.raises(rotavg.FormatError, match="its table pose_priors is empty"):
        rotavg.read_priors(scene.path, graph, gravity=True)
    with pytest.raises(rotavg.OptionError, match="expected gravity=True with it"):
        rotavg.read_priors(scene.path, graph, gravity_weight=2.0)
    rotavg.write(tmp_path / "g.csv", graph)
    with pytest.raises(rotavg.FormatError, match=r"g\.csv: found a format without prior"):
        rotavg.read_priors(tmp_path / "g.csv", graph)
    other = rotavg.MeasurementGraph([("x", "y")], [np.eye(3)])
    assert not rotavg.read_priors(scene.path, other).rigs


def test_json_tells_it_too(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "rig.db", seed=4)
    with sqlite3.connect(scene.path) as connection:  # one sensor that nobody has calibrated
        connection.execute("UPDATE rig_sensors SET sensor_from_rig = NULL WHERE sensor_id = 2")
    connection.close()
    found = json.loads(run("solve", scene.path, "--json").stdout)
    graph = rotavg.read(scene.path)
    solution = rotavg.solve(graph, priors=rotavg.read_priors(scene.path, graph))
    assert solution.rigs is not None
    assert solution.rigs.estimated.sum() == 1
    assert found["objective"] == pytest.approx(solution.objective, rel=1e-9)
    assert any("of which 5 are calibrated" in note for note in found["notes"])
