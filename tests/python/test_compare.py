"""Comparing rotations with a reference: alignment, figures, files, the command."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import rotavg
from rotavg.cli.main import commands


def run(*arguments: object, status: int = 0) -> str:
    """What the command prints; if it is to fail, its error."""
    result = CliRunner().invoke(commands, [str(a) for a in arguments])
    if status == 2:
        assert isinstance(result.exception, rotavg.Error)
        return str(result.exception)
    assert result.exit_code == 0, (result.output, result.exception)
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


def test_the_same_rotations_differ_by_nothing() -> None:
    R, truth, _ = turned(20, 2)
    assert rotavg.compare(truth, truth).angles.max() < 1e-7
    assert "20 rotations: median" in str(rotavg.compare(R, truth))


def test_every_component_has_an_alignment_of_its_own() -> None:
    truth = Rotation.random(20, random_state=0)
    gauges = Rotation.random(2, random_state=1)
    component = np.repeat([0, 1], 10)
    R = (gauges[component] * truth).as_matrix()
    assert rotavg.compare(R, truth.as_matrix(), component=component).angles.max() < 1e-7
    assert rotavg.compare(R, truth.as_matrix()).angles.max() > 0.1


def in_parts() -> tuple[rotavg.Solution, np.ndarray]:
    """A solution in components of 20, 6 and 1 node, and the truth in one gauge."""
    parts = [rotavg.simulate("complete", n, noise=0.05, seed=n) for n in (20, 6)]
    edges = np.concatenate([parts[0].graph.edges, parts[1].graph.edges + 20])
    R = np.concatenate([part.graph.rotations for part in parts])
    truth = np.concatenate([*(part.ground_truth for part in parts), np.eye(3)[None]])
    return rotavg.solve(rotavg.MeasurementGraph(edges, R, nodes=range(27))), truth


def test_a_solution_is_aligned_component_by_component() -> None:
    solution, truth = in_parts()
    turn = Rotation.random(3, random_state=3).as_matrix()[solution.component]
    free = dataclasses.replace(solution, rotations=turn @ solution.rotations)
    result = rotavg.compare(free, truth)
    assert result.rows.tolist() == list(range(26))  # node 26 would fit anything
    assert (result.num_components, result.left_out) == (2, 1)
    for part in (slice(20), slice(20, 26)):
        alone = rotavg.compare(solution.rotations[part], truth[part])
        np.testing.assert_allclose(result.angles[part], alone.angles, atol=1e-9)
    assert "26 rotations in 2 components: median" in str(result)
    assert str(result).endswith("10 deg; 1 alone in a component left out")
    assert np.degrees(result.angles.max()) < 5
    one = rotavg.compare(free, truth, component=np.zeros(27))
    assert (len(one.angles), one.num_components, one.left_out) == (27, 1, 0)
    assert np.degrees(one.angles.max()) > 30


def test_what_cannot_be_compared_is_refused() -> None:
    R = np.eye(3)[None]
    with pytest.raises(rotavg.GraphError, match="no two rotations are in the same component"):
        rotavg.compare(R, R)
    with pytest.raises(rotavg.GraphError, match="no two rotations are in the same component"):
        rotavg.compare([*R, *R], [*R, *R], component=["a", "b"])
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


def test_the_command_compares_common_nodes(tmp_path: Path) -> None:
    simulation = rotavg.simulate("complete", 15, noise=0.02, seed=6)
    solution = rotavg.solve(simulation.graph)
    rotavg.write(tmp_path / "solved.txt", solution)
    q = Rotation.from_matrix(simulation.ground_truth).as_quat()
    lines = [f"{k} {' '.join(map(repr, q[k].tolist()))}" for k in range(3, 15)] + ["99 0 0 0 1"]
    (tmp_path / "truth.txt").write_text("\n".join(["id qx qy qz qw", *lines]))
    figures = json.loads(run("compare", tmp_path / "solved.txt", tmp_path / "truth.txt", "--json"))
    direct = rotavg.compare(solution.rotations[3:], simulation.ground_truth[3:])
    assert figures["nodes"] == 12
    assert figures["only_in_solution"] == 3
    assert figures["only_in_reference"] == 1
    assert figures["median_deg"] == pytest.approx(np.degrees(direct.median), rel=1e-6)
    assert figures["share_below_5_deg"] == 1.0
    text = run("compare", tmp_path / "solved.txt", tmp_path / "truth.txt")
    assert "12 compared, 3 in the solution only, 1 in the reference only" in text

    (tmp_path / "other.txt").write_text("# id qx qy qz qw\na 0 0 0 1\n")
    result = CliRunner().invoke(
        commands, ["compare", str(tmp_path / "solved.txt"), str(tmp_path / "other.txt")]
    )
    assert isinstance(result.exception, rotavg.FormatError)
    assert "expected common ids" in str(result.exception)


def test_the_command_aligns_component_by_component(tmp_path: Path) -> None:
    solution, truth = in_parts()
    graph, solved, reference = tmp_path / "g.txt", tmp_path / "s.txt", tmp_path / "truth.npz"
    rotavg.write(graph.with_suffix(".npz"), solution.graph)  # the lonely node is in it
    rotavg.write(solved.with_suffix(".npz"), solution)
    # Somebody else's file, which does not tell components apart.
    rotavg.write(solved, rotavg.KnownRotations(solution.graph, solution.rotations))
    np.savez(reference, ground_truth=truth)
    expected = np.degrees(rotavg.compare(solution, truth).mean)
    for command in (
        ("compare", solved.with_suffix(".npz"), reference),
        ("compare", solved, reference, "--graph", graph.with_suffix(".npz")),
        ("compare", reference, solved.with_suffix(".npz")),
    ):
        figures = json.loads(run(*command, "--json"))
        assert (figures["nodes"], figures["components"], figures["left_out"]) == (26, 2, 1)
        assert figures["mean_deg"] == pytest.approx(expected, rel=1e-6)
    text = run("compare", solved.with_suffix(".npz"), reference)
    assert "26 compared, 0 in the solution only, 0 in the reference only\n" in text
    assert "2 components, each by itself; left out 1 alone in a component\n" in text
    together = json.loads(run("compare", solved, reference, "--json"))
    assert (together["components"], together["left_out"]) == (1, 0)
    assert together["mean_deg"] > 5 * expected
    # Two solutions: together are nodes that are so in both.
    halves = dataclasses.replace(solution, component=np.repeat([0, 1], [10, 17]).astype(np.int32))
    rotavg.write(tmp_path / "halves.npz", halves)
    figures = json.loads(
        run("compare", solved.with_suffix(".npz"), tmp_path / "halves.npz", "--json")
    )
    assert (figures["nodes"], figures["components"], figures["left_out"]) == (26, 3, 1)

    with pytest.warns(rotavg.IncompleteWarning, match="1 node without an edge is not in it"):
        rotavg.write(graph, solution.graph)  # text cannot hold the lonely node
    message = run("compare", solved, reference, "--graph", graph, status=2)
    assert (
        message == f"{graph}: node 26 of {solved} is not in it, expected the graph that was solved"
    )


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
