"""The Karcher mean, and the gauge that preserves it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.se3 import log_so3

Floats = NDArray[np.float64]


def near(turn: Floats, count: int, spread: float, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    return turn @ matrices_from_rotvecs(spread * rng.normal(size=(count, 3)))


def squares(turn: Floats, rotations: Floats) -> float:
    return float(np.sum(log_so3(turn.T @ rotations) ** 2))


def test_the_mean_has_the_least_squared_angles() -> None:
    turn = matrices_from_rotvecs([[1.0, -2.0, 0.5]])[0]
    rotations = near(turn, 30, 0.3, seed=1)
    mean = rotavg.karcher_mean(rotations)
    np.testing.assert_allclose(log_so3(mean.T @ rotations).sum(axis=0), 0, atol=1e-12)
    for other in near(mean, 20, 1e-3, seed=2):
        assert squares(other, rotations) > squares(mean, rotations)


def test_the_mean_in_closed_form() -> None:
    angles = np.array([0.1, 0.5, 1.2])
    mean = rotavg.karcher_mean(matrices_from_rotvecs(angles[:, None] * [0, 0, 1.0]))
    np.testing.assert_allclose(log_so3(mean[None])[0], [0, 0, 0.6], atol=1e-14)
    turned = matrices_from_rotvecs([[0.3, 0, 0], [-0.3, 0, 0]])
    np.testing.assert_allclose(rotavg.karcher_mean(turned), np.eye(3), atol=1e-15)


def test_no_mean_of_nothing() -> None:
    with pytest.raises(rotavg.GraphError, match="found no rotations"):
        rotavg.karcher_mean(np.empty((0, 3, 3)))
    with pytest.raises(rotavg.GraphError, match="matrix 1 is not a rotation"):
        rotavg.karcher_mean([np.eye(3), 2 * np.eye(3)])
    with pytest.raises(rotavg.GraphError, match="shape"):
        rotavg.karcher_mean(np.eye(3))


def two_parts() -> rotavg.MeasurementGraph:
    parts = [rotavg.simulate("erdos_renyi", 12, density=0.4, noise=0.1, seed=k) for k in (1, 2)]
    return rotavg.MeasurementGraph(
        np.concatenate([k * 12 + part.graph.edges for k, part in enumerate(parts)]),
        np.concatenate([part.graph.rotations for part in parts]),
    )


def test_without_a_start_the_mean_of_every_component_is_the_identity() -> None:
    graph = two_parts()
    plain, mean = rotavg.solve(graph), rotavg.solve(graph, gauge="mean")
    assert rotavg.objective(graph, mean.rotations) == pytest.approx(plain.objective, rel=1e-12)
    assert mean.certificate.verdict == plain.certificate.verdict
    for rows in (slice(0, 12), slice(12, 24)):
        np.testing.assert_allclose(rotavg.karcher_mean(mean.rotations[rows]), np.eye(3), atol=1e-9)
        turn = mean.rotations[rows][0] @ plain.rotations[rows][0].T
        np.testing.assert_allclose(turn @ plain.rotations[rows], mean.rotations[rows], atol=1e-12)


def test_the_mean_of_a_start_is_preserved() -> None:
    graph = two_parts()
    start = near(matrices_from_rotvecs([[1.0, 2, 3]])[0], 24, 0.05, seed=3)
    start = start @ rotavg.solve(graph).rotations
    found = rotavg.solve(graph, init=start, gauge="mean")
    for rows in (slice(0, 12), slice(12, 24)):
        before = rotavg.karcher_mean(start[rows])
        errors = log_so3(before.T @ found.rotations[rows])
        np.testing.assert_allclose(errors.sum(axis=0), 0, atol=1e-10)
    again = rotavg.solve(graph, init=found, gauge="mean")
    np.testing.assert_allclose(again.rotations, found.rotations, atol=1e-7)


def test_what_priors_hold_is_not_turned() -> None:
    graph = two_parts()
    turn = matrices_from_rotvecs([[0.5, 0, 0]])[0]
    solution = rotavg.solve(graph, priors=rotavg.Priors(fixed={14: turn}), gauge="mean")
    np.testing.assert_allclose(solution[14], turn, atol=1e-14)
    np.testing.assert_allclose(rotavg.karcher_mean(solution.rotations[:12]), np.eye(3), atol=1e-9)


def test_of_two_rotations_as_gtsams_factor_has_it() -> None:
    """GTSAM's KarcherMeanFactor: the mean before and after is the same."""
    R = matrices_from_rotvecs([[0.1, 0, 0]])[0]
    graph = rotavg.MeasurementGraph([[1, 2]], [R @ R @ R])
    start = np.array([R.T, R])
    found = rotavg.solve(graph, init=start, gauge="mean")
    before, after = rotavg.karcher_mean(start), rotavg.karcher_mean(found.rotations)
    np.testing.assert_allclose(after, before, atol=1e-12)
    np.testing.assert_allclose(after, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found[1].T @ found[2], R @ R @ R, atol=1e-12)


def test_the_command_and_errors(tmp_path: Path) -> None:
    rotavg.write(tmp_path / "in.txt", two_parts())
    out = tmp_path / "out.csv"
    arguments = ["solve", str(tmp_path / "in.txt"), "--gauge", "mean", "-o", str(out)]
    assert CliRunner().invoke(commands, arguments).exit_code == 0
    _, rotations = rotavg.read_rotations(out)
    np.testing.assert_allclose(rotavg.karcher_mean(rotations[:12]), np.eye(3), atol=1e-9)
    with pytest.raises(rotavg.OptionError, match="gauge is 'last'; expected 'first' or 'mean'"):
        rotavg.solve(two_parts(), gauge="last")  # type: ignore[arg-type]


def test_frames_of_rigs_turn_with_the_mean_gauge() -> None:
    edges = [("l1", "l2"), ("l2", "l3"), ("r1", "r2"), ("r2", "r3"), ("l1", "r2"), ("r2", "l3")]
    turns = [[0, 30, 0], [20, 0, 0], [0, 30, 1], [20, 1, 0], [0, 50, 0], [20, -20, 0]]
    graph = rotavg.MeasurementGraph.from_rotvecs(edges, np.radians(turns))
    images = {node: (int(node[1]), node[0]) for node in graph.nodes.tolist()}
    priors = rotavg.Priors(rigs=rotavg.Rigs(images, {"l": np.eye(3)}))
    start = rotavg.solve(graph, priors=priors)
    for init in ("auto", np.array(start.rotations)):
        solution = rotavg.solve(graph, priors=priors, gauge="mean", init=init)
        assert solution.rigs is not None
        for node, (frame, sensor) in images.items():
            rides = solution.rigs.frames[frame] @ solution.rigs.rotation_of[sensor]
            assert np.abs(rides - solution[node]).max() < 1e-12
