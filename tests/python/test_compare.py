"""Comparing rotations with a reference: alignment, figures, files, the command."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import rotavg
from rotavg.cli.main import commands


def run(*arguments: object) -> str:
    result = CliRunner().invoke(commands, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def turned(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations, the same from another gauge with known errors, and these errors (radians)."""
    rng = np.random.default_rng(seed)
    truth = Rotation.random(count, random_state=seed)
    errors = np.abs(rng.normal(0, 0.02, count))
    errors[: count // 4] = 2.0
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    gauge = Rotation.random(random_state=seed + 1)
    return (
        (gauge * Rotation.from_rotvec(axes * errors[:, None]) * truth).as_matrix(),
        truth.as_matrix(),
        errors,
    )


def test_the_alignment_is_not_turned_away_by_wrong_rotations() -> None:
    R, truth, errors = turned(200, 0)
    result = rotavg.compare(R, truth)
    np.testing.assert_allclose(result.angles, errors, atol=0.01)
    assert result.mean == pytest.approx(errors.mean(), abs=0.005)
    assert result.median == pytest.approx(np.median(errors), abs=0.005)
    assert result.rms == pytest.approx(np.sqrt(np.mean(errors**2)), abs=0.01)
    assert result.share_below(0.1) == 0.75
    # No other common rotation leaves a smaller sum.
    left = truth @ np.swapaxes(R, 1, 2)
    rng = np.random.default_rng(1)
    aligned = Rotation.from_matrix(left)
    for size in (1e-3, 0.1, 3.0):
        for _ in range(20):
            other = Rotation.from_rotvec(size * rng.normal(size=3)) * aligned[150]
            assert (aligned * other.inv()).magnitude().sum() >= result.angles.sum() - 1e-6


def test_the_same_rotations_differ_by_nothing_and_one_node_by_nothing() -> None:
    R, truth, _ = turned(20, 2)
    assert rotavg.compare(truth, truth).angles.max() < 1e-7
    assert rotavg.compare(R[:1], truth[:1]).angles.max() < 1e-7
    assert "20 rotations: median" in str(rotavg.compare(R, truth))


def test_every_component_has_an_alignment_of_its_own() -> None:
    truth = Rotation.random(20, random_state=0)
    gauges = Rotation.random(2, random_state=1)
    component = np.repeat([0, 1], 10)
    R = (gauges[component] * truth).as_matrix()
    assert rotavg.compare(R, truth.as_matrix(), component=component).angles.max() < 1e-7
    assert rotavg.compare(R, truth.as_matrix()).angles.max() > 0.1


def test_what_cannot_be_compared_is_refused() -> None:
    R = np.eye(3)[None]
    with pytest.raises(rotavg.GraphError, match="no rotations"):
        rotavg.compare([], [])
    with pytest.raises(rotavg.GraphError, match="rotations have shape"):
        rotavg.compare(R, np.concatenate([R, R]))
    with pytest.raises(rotavg.GraphError, match="reference: the matrix in row 0"):
        rotavg.compare(R, -R)
    with pytest.raises(rotavg.GraphError, match="reference: the matrix in row 0"):
        rotavg.compare(R, np.nan * R)
    with pytest.raises(rotavg.GraphError, match="component has shape"):
        rotavg.compare(R, R, component=[0, 1])


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".npz", ".g2o", ".toro"])
def test_rotations_come_back_from_every_format_a_solution_is_written_in(
    tmp_path: Path, suffix: str
) -> None:
    solution = rotavg.solve(rotavg.simulate("complete", 12, noise=0.1, seed=4).graph)
    path = tmp_path / f"solved{suffix}"
    rotavg.write(path, solution)
    nodes, rotations = rotavg.read_rotations(path)
    assert (nodes == solution.graph.nodes).all()
    np.testing.assert_allclose(rotations, solution.rotations, atol=1e-12)


def test_rotations_come_back_from_the_vision_family(tmp_path: Path) -> None:
    solution = rotavg.solve(rotavg.simulate("complete", 12, noise=0.1, seed=4).graph)
    path = tmp_path / "x_glomap_rotations.txt"
    rotavg.write(path, solution)
    np.testing.assert_allclose(rotavg.read_rotations(path)[1], solution.rotations, atol=1e-12)
    other = path.rename(tmp_path / "x.txt")
    rotations = rotavg.read_rotations(other, format="glomap")[1]
    np.testing.assert_allclose(rotations, solution.rotations, atol=1e-12)
    text = tmp_path / "s.txt"
    rotavg.write(text, solution)
    turned = rotavg.read_rotations(text, convention="vision")[1]
    np.testing.assert_allclose(turned, np.swapaxes(solution.rotations, 1, 2), atol=1e-12)
    figures = json.loads(run("compare", text, other, "--reference-format", "glomap", "--json"))
    assert figures["max_deg"] < 1e-5
    with pytest.raises(rotavg.FormatError, match="by definition"):
        rotavg.read_rotations(other, format="glomap", convention="pose")


def test_vertices_in_the_plane_are_turns_about_z(tmp_path: Path) -> None:
    path = tmp_path / "p.g2o"
    for tag in ("VERTEX_SE2", "VERTEX2"):
        path.write_text(f"{tag} 3 1 2 0.5\n{tag} 4 1 2 -1\n")
        nodes, rotations = rotavg.read_rotations(path)
        assert nodes.tolist() == [3, 4]
        expected = Rotation.from_rotvec([[0, 0, 0.5], [0, 0, -1]]).as_matrix()
        np.testing.assert_allclose(rotations, expected, atol=1e-15)


def test_names_come_back_as_names(tmp_path: Path) -> None:
    graph = rotavg.MeasurementGraph.from_rotvecs([("a.jpg", "b.jpg")], [[0.1, 0, 0]])
    rotavg.write(tmp_path / "s.txt", rotavg.solve(graph))
    assert rotavg.read_rotations(tmp_path / "s.txt")[0].tolist() == ["a.jpg", "b.jpg"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# nothing\n", "the file has no rotations"),
        ("1 0 0 0 1\n1 0 0 0 1\n", "node 1 is listed more than once"),
        ("1 0 0 0 1\n2 0 0 0\n", ":2: found 4 fields"),
        ("1 0 0 0 1\n2 0 0 0 x\n", ":2: found 'x', expected a number"),
        ("1 0 0 0 0\n", ":1: the quaternion is zero"),
        ("1 0 0 0 nan\n", ":1: found nan"),
        ("1 2 0 0 0 1\n", "found 6 fields, expected rotations"),
    ],
)
def test_bad_files_are_told_with_line_and_reason(
    tmp_path: Path, content: str, message: str
) -> None:
    path = tmp_path / "bad.txt"
    path.write_text(content)
    with pytest.raises(rotavg.FormatError) as error:
        rotavg.read_rotations(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)


def test_an_npz_of_a_graph_holds_no_solution(tmp_path: Path) -> None:
    for kind in ("complete", "cycle"):  # a cycle has as many edges as nodes
        rotavg.write(tmp_path / "g.npz", rotavg.simulate(kind, 5, seed=0).graph)
        with pytest.raises(rotavg.FormatError, match="found a graph, expected absolute"):
            rotavg.read_rotations(tmp_path / "g.npz")
    (tmp_path / "z.npz").write_bytes(b"PK\x03\x04 and nothing")
    with pytest.raises(rotavg.FormatError, match="no readable npz"):
        rotavg.read_rotations(tmp_path / "z.npz")


def test_the_command_compares_common_nodes(tmp_path: Path) -> None:
    simulation = rotavg.simulate("complete", 15, noise=0.02, seed=6)
    solution = rotavg.solve(simulation.graph)
    rotavg.write(tmp_path / "solved.txt", solution)
    q = Rotation.from_matrix(simulation.ground_truth).as_quat()
    lines = [f"{k} {' '.join(map(repr, q[k].tolist()))}" for k in range(3, 15)] + ["99 0 0 0 1"]
    (tmp_path / "truth.txt").write_text("\n".join(lines))
    figures = json.loads(run("compare", tmp_path / "solved.txt", tmp_path / "truth.txt", "--json"))
    direct = rotavg.compare(solution.rotations[3:], simulation.ground_truth[3:])
    assert figures["nodes"] == 12
    assert figures["only_in_solution"] == 3
    assert figures["only_in_reference"] == 1
    assert figures["median_deg"] == pytest.approx(np.degrees(direct.median), rel=1e-6)
    assert figures["share_below_5_deg"] == 1.0
    text = run("compare", tmp_path / "solved.txt", tmp_path / "truth.txt")
    assert "12 in both, 3 in the solution only, 1 in the reference only" in text

    (tmp_path / "other.txt").write_text("a 0 0 0 1\n")
    result = CliRunner().invoke(
        commands, ["compare", str(tmp_path / "solved.txt"), str(tmp_path / "other.txt")]
    )
    assert isinstance(result.exception, rotavg.FormatError)
    assert "expected common ids" in str(result.exception)


def test_the_command_solves_robustly_and_writes_the_edges(tmp_path: Path) -> None:
    graph_path, edges_path = tmp_path / "g.txt", tmp_path / "edges.csv"
    run("simulate", "complete", "-n", 30, "--noise", 0.03, "--outliers", 0.3, "-o", graph_path)
    figures = json.loads(
        run("solve", graph_path, "--loss", "auto", "--edges", edges_path, "--json")
    )
    assert figures["robust"]["loss"] == "cauchy"
    assert figures["robust"]["noise_deg"] == pytest.approx(np.degrees(0.03), rel=0.25)
    with edges_path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 435
    assert sum(int(row["is_outlier"]) for row in rows) == figures["robust"]["outliers"]
    worst = max(rows, key=lambda row: float(row["residual_deg"]))
    assert worst["verdict"] == "robust_weight"
    assert float(worst["final_weight"]) < 1e-3 * float(worst["weight"])

    scaled = run("solve", graph_path, "--loss", "tls", "--loss-scale", 5, "--cycle-threshold", 20)
    assert "tls, scale 5 deg" in scaled
    assert "by the cycle check" in scaled
    assert json.loads(run("solve", graph_path, "--json"))["robust"] is None
    assert "--loss auto" in run("info", graph_path)
    assert "--loss auto" in run("solve", graph_path, "--max-iterations", 300)

    for bad in ("wide", "-1", "200"):
        arguments = ["solve", str(graph_path), "--loss", "auto", "--loss-scale", bad]
        result = CliRunner().invoke(commands, arguments)
        assert result.exit_code != 0
    missing = CliRunner().invoke(
        commands, ["solve", str(graph_path), "--edges", str(tmp_path / "no" / "e.csv")]
    )
    assert isinstance(missing.exception, rotavg.FileAccessError)
