"""Prior knowledge against brute force, closed forms and equivalent problems."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg import Priors
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.io import write_gravity

DOWN = np.array([0.0, 1.0, 0.0])
R_1 = matrices_from_rotvecs([0.1, 0, 0])


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rotavg", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def simulation() -> rotavg.Simulation:
    return rotavg.simulate("erdos_renyi", 20, density=0.3, noise=0.1, seed=4)


@pytest.fixture
def truth(simulation: rotavg.Simulation) -> NDArray[np.float64]:
    """In a world of its own."""
    return matrices_from_rotvecs([0.4, -1.0, 2.0]) @ simulation.ground_truth


def downs(truth: NDArray[np.float64], tilt: float, seed: int = 0) -> NDArray[np.float64]:
    noise = matrices_from_rotvecs(np.random.default_rng(seed).normal(size=(len(truth), 3)) * tilt)
    return np.einsum("kab,kcb,c->ka", noise, truth, DOWN)


def objective(graph: rotavg.MeasurementGraph, priors: Priors, R: NDArray[np.float64]) -> float:
    """From its definition."""
    row = {node: k for k, node in enumerate(graph.nodes.tolist())}
    f = rotavg.objective(graph, R)
    for node, (P, w) in priors.absolute.items():
        f += w * np.sum((R[row[node]] - np.asarray(P)) ** 2)
    g = np.asarray(priors.down) / np.linalg.norm(priors.down)
    for node, (d, w) in priors.gravity.items():
        f += 2 * w * np.sum((R[row[node]] @ np.asarray(d) / np.linalg.norm(d) - g) ** 2)
    return float(f)


def assert_minimum(
    solution: rotavg.Solution, priors: Priors, free: NDArray[np.bool_] | None = None
) -> None:
    """The objective is what is said, and rises in every direction of the free nodes."""
    graph, R = solution.graph, solution.rotations
    f = objective(graph, priors, R)
    assert solution.objective == pytest.approx(f, rel=1e-9, abs=1e-9)
    rng = np.random.default_rng(0)
    for _ in range(30):
        w = rng.normal(size=(graph.num_nodes, 3))
        if free is not None:
            w[~free] = 0
        for size in (1e-3, -1e-3, 0.3):
            assert objective(graph, priors, matrices_from_rotvecs(size * w) @ R) >= f * (1 - 1e-12)


def test_one_absolute_prior_sets_the_world(
    simulation: rotavg.Simulation, truth: NDArray[np.float64]
) -> None:
    plain = rotavg.solve(simulation.graph)
    priors = Priors(absolute={7: (truth[7], 3.0)})
    solution = rotavg.solve(simulation.graph, priors=priors)
    np.testing.assert_allclose(solution[7], truth[7], atol=1e-8)
    turn = solution[0] @ plain[0].T
    np.testing.assert_allclose(solution.rotations, turn @ plain.rotations, atol=1e-7)
    assert solution.objective == pytest.approx(plain.objective, rel=1e-9)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"


def test_all_kinds_together_are_at_a_minimum(
    simulation: rotavg.Simulation, truth: NDArray[np.float64]
) -> None:
    d = downs(truth, 0.05)
    priors = Priors(
        fixed={3: truth[3], 4: truth[4]},
        absolute={k: (truth[k] @ matrices_from_rotvecs([0.1, 0, 0]), 0.5) for k in (8, 9)},
        gravity={k: (7 * d[k], 2.0) for k in range(2, 15)},
        down=3 * DOWN,
    )
    solution = rotavg.solve(simulation.graph, priors=priors)
    assert np.array_equal(solution[3], truth[3]) or np.abs(solution[3] - truth[3]).max() < 1e-15
    free = ~np.isin(simulation.graph.nodes, (3, 4))
    assert_minimum(solution, priors, free)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    assert "2 fixed, 2 absolute" in str(solution)
    assert "the certificate covers them" in str(solution)


def test_the_gap_bounds_the_distance_from_the_optimum_with_gravity(
    simulation: rotavg.Simulation, truth: NDArray[np.float64]
) -> None:
    d = downs(truth, 0.05)
    priors = Priors(gravity={k: (d[k], 1.0) for k in range(20)})
    best = rotavg.solve(simulation.graph, priors=priors)
    early = rotavg.solve(simulation.graph, priors=priors, method="bcd", max_iterations=2)
    assert_minimum(best, priors)
    for solution in (best, early):
        assert solution.certificate is not None
        assert solution.objective - best.objective <= solution.certificate.gap
    assert best.certificate is not None
    assert best.certificate.verdict == "proved"
    assert early.certificate is not None
    expected = early.certificate.gap / early.objective
    assert early.certificate.relative_gap == pytest.approx(expected)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-4])
def test_gravity_of_a_camera_that_is_upside_down_is_exact(off: float) -> None:
    seen = np.array([off, -1.0, 0.0])  # all but opposite to down
    graph = rotavg.MeasurementGraph([(0, 1)], [np.eye(3)])
    solution = rotavg.solve(graph, priors=Priors(gravity={0: (seen, 1.0)}, down=DOWN))
    assert np.abs(solution.rotations[0] @ seen / np.linalg.norm(seen) - DOWN).max() < 2e-15
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"


def test_certain_gravity_leaves_the_heading_alone(
    simulation: rotavg.Simulation, truth: NDArray[np.float64]
) -> None:
    priors = Priors(gravity={k: (truth[k].T @ DOWN, 1e3) for k in range(20)})
    solution = rotavg.solve(simulation.graph, priors=priors)
    tilted = np.einsum("kab,bc,kcd->kad", solution.rotations, np.eye(3), np.swapaxes(truth, 1, 2))
    assert np.abs(tilted @ DOWN - DOWN).max() < 1e-3
    plain = rotavg.compare(rotavg.solve(simulation.graph).rotations, truth)
    assert rotavg.compare(solution.rotations, truth).rms < 0.8 * plain.rms
    assert "heading" in str(solution)
    # The heading that is free is the one that turns the first node least.
    first = solution.rotations[0]
    for angle in np.linspace(-3, 3, 61):
        turned = matrices_from_rotvecs(angle * DOWN) @ first
        assert np.trace(turned) <= np.trace(first) + 1e-9


def test_fixed_rotations_are_the_limit_of_absolute_priors(
    simulation: rotavg.Simulation, truth: NDArray[np.float64]
) -> None:
    graph = simulation.graph
    held = rotavg.solve(graph, priors=Priors(fixed={k: truth[k] for k in range(5)}))
    heavy = rotavg.solve(graph, priors=Priors(absolute={k: (truth[k], 1e6) for k in range(5)}))
    np.testing.assert_allclose(held.rotations, heavy.rotations, atol=1e-5)
    pairs = [(0, 9), (6, 12), (2, 3)]
    np.testing.assert_allclose(
        held.covariances(pairs, noise_variance=1),
        heavy.covariances(pairs, noise_variance=1),
        atol=1e-5,
    )
    assert not held.covariances(noise_variance=1)[:5].any()


def test_parts_that_only_priors_join(truth: NDArray[np.float64]) -> None:
    edges = np.array([(0, 1), (1, 2), (0, 2), (3, 4), (6, 7)])
    i, j = edges.T
    rotations = np.swapaxes(truth[i], 1, 2) @ truth[j]
    graph = rotavg.MeasurementGraph(edges, rotations, nodes=range(8))
    priors = Priors(
        fixed={1: truth[1]}, absolute={3: (truth[3], 1)}, gravity={5: (truth[5].T @ DOWN, 1)}
    )
    solution = rotavg.solve(graph, priors=priors)
    np.testing.assert_allclose(solution.rotations[:5], truth[:5], atol=1e-9)
    np.testing.assert_allclose(solution[5] @ truth[5].T @ DOWN, DOWN, atol=1e-9)
    np.testing.assert_allclose(solution[6], np.eye(3), atol=1e-15)  # a gauge of its own
    assert solution.component.tolist() == [0, 0, 0, 0, 0, 0, 1, 1]
    assert solution.solved
    spread = solution.covariances(noise_variance=1)
    assert np.trace(spread[4]) == pytest.approx(6)
    assert spread[5][1, 1] == pytest.approx(0, abs=1e-9)
    assert np.trace(spread[7]) == pytest.approx(3)


def test_gravity_and_robust_losses() -> None:
    simulation = rotavg.simulate("erdos_renyi", 60, density=0.3, noise=0.03, outliers=0.2, seed=1)
    d = downs(simulation.ground_truth, 0.002)
    priors = Priors(gravity={k: (d[k], 100.0) for k in range(60)})
    plain = rotavg.solve(simulation.graph, loss="auto")
    solution = rotavg.solve(simulation.graph, loss="auto", priors=priors)
    assert solution.robust is not None
    assert np.array_equal(solution.edge_verdicts, plain.edge_verdicts)
    error = rotavg.compare(solution.rotations, simulation.ground_truth).rms
    assert error < 0.9 * rotavg.compare(plain.rotations, simulation.ground_truth).rms


def test_what_is_stopped_is_certified_all_the_same(simulation: rotavg.Simulation) -> None:
    priors = Priors(absolute={7: (np.eye(3), 1.0)})
    stopped = rotavg.solve(simulation.graph, priors=priors, callback=lambda progress: False)
    assert stopped.status is rotavg.Status.STOPPED
    assert stopped.certificate is not None
    best = rotavg.solve(simulation.graph, priors=priors)
    assert stopped.objective - best.objective <= stopped.certificate.gap
    late = rotavg.solve(simulation.graph, priors=priors, time_limit=0)
    assert late.status is rotavg.Status.TIME_LIMIT
    assert np.isfinite(late.rotations).all()


def test_certify_with_priors(simulation: rotavg.Simulation, truth: NDArray[np.float64]) -> None:
    d = downs(truth, 0.05)
    priors = Priors(fixed={3: truth[3]}, gravity={k: (d[k], 2.0) for k in range(5, 12)})
    best = rotavg.solve(simulation.graph, priors=priors)
    again = rotavg.certify(simulation.graph, best.rotations, priors=priors)
    assert again.verdict == "proved"
    turned = best.rotations.copy()
    turned[8] = matrices_from_rotvecs([0.2, 0, 0]) @ turned[8]
    worse = rotavg.certify(simulation.graph, turned, priors=priors)
    assert worse.verdict == "not_certified"
    excess = objective(simulation.graph, priors, turned) - best.objective
    assert 0 < excess <= worse.gap
    turned[3] = turned[8]
    with pytest.raises(rotavg.GraphError, match="node 3 is not where a fixed rotation"):
        rotavg.certify(simulation.graph, turned, priors=priors)


def test_rigs_share_the_rotation_of_their_frame() -> None:
    """Against the definition, separate cameras, and stiff edges between the cameras."""
    rng = np.random.default_rng(5)
    frames, cameras = 12, 3
    rig = matrices_from_rotvecs(rng.normal(size=(cameras, 3)))
    world_from_frame = matrices_from_rotvecs(rng.normal(size=(frames, 3)))
    truth = (world_from_frame[:, None] @ rig).reshape(-1, 3, 3)
    n = frames * cameras
    i, j = np.array([(a, b) for a in range(n) for b in range(a + 1, n) if rng.random() < 0.2]).T
    noise = matrices_from_rotvecs(0.05 * rng.normal(size=(len(i), 3)))
    names = np.array([f"cam{k % cameras}/{k // cameras:03}.jpg" for k in range(n)])
    graph = rotavg.MeasurementGraph(
        np.stack([names[i], names[j]], axis=1), np.swapaxes(truth[i], 1, 2) @ truth[j] @ noise
    )
    rigs = {name: (f"frame{k // cameras}", rig[k % cameras]) for k, name in enumerate(names)}
    solution = rotavg.solve(graph, priors=Priors(rigs=rigs))
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    assert "36 cameras of rigs in 12 frames; the certificate covers them" in str(solution)
    assert solution.objective == pytest.approx(rotavg.objective(graph, solution.rotations))
    R = np.stack([solution[name] for name in names]).reshape(frames, cameras, 3, 3)
    of_frames = R @ np.swapaxes(rig, 1, 2)
    np.testing.assert_allclose(of_frames, of_frames[:, :1].repeat(cameras, axis=1), atol=1e-13)
    separate = rotavg.solve(graph)
    assert separate.objective < solution.objective
    order = [names.tolist().index(name) for name in graph.nodes.tolist()]
    error = rotavg.compare(solution.rotations, truth[order]).rms
    assert error < 0.8 * rotavg.compare(separate.rotations, truth[order]).rms
    # Stiff edges tend to it.
    stiff = [(a, a + 1) for a in range(n) if a % cameras < cameras - 1]
    a, b = np.array(stiff).T
    more = rotavg.MeasurementGraph(
        np.concatenate([graph.edges, np.stack([names[a], names[b]], axis=1)]),
        np.concatenate([graph.rotations, np.swapaxes(truth[a], 1, 2) @ truth[b]]),
        np.concatenate([graph.weights, np.full(len(a), 1e6)]),
        nodes=graph.nodes,
    )
    stiffly = rotavg.solve(more, certify=False)
    assert np.degrees(rotavg.compare(stiffly.rotations, solution.rotations).rms) < 1e-3
    spread = solution.covariances([(names[0], names[1]), (names[0], names[5])], noise_variance=1)
    assert not spread[0].any()
    assert np.trace(spread[1]) > 0


def test_no_priors_change_nothing(simulation: rotavg.Simulation) -> None:
    plain = rotavg.solve(simulation.graph)
    assert np.array_equal(
        rotavg.solve(simulation.graph, priors=Priors()).rotations, plain.rotations
    )


@pytest.mark.parametrize(
    ("priors", "message"),
    [
        ({"fixed": {99: np.eye(3)}}, "the fixed prior of node 99: it is not in the graph"),
        ({"fixed": {1: np.ones((3, 3))}}, "the fixed prior of node 1 is no rotation"),
        ({"fixed": {1: np.diag([1, 1, -1])}}, "node 1 is no rotation"),
        ({"absolute": {1: np.eye(3)}}, "expected a pair of what is known and its weight"),
        ({"absolute": {1: (np.eye(3), -1)}}, "node 1 has the weight -1, expected one from"),
        ({"gravity": {2: ([0, 0, 0], 1)}}, "node 2 is .*, expected a finite direction"),
        ({"gravity": {2: ([0, np.nan, 0], 1)}}, "node 2 is .*, expected a finite direction"),
        ({"gravity": {2: ([0, 1], 1)}}, r"node 2 have shape \(2,\), expected \(3,\)"),
        (
            {"gravity": {0: ("up", 1)}},
            "the entries of the gravity prior of node 0 are not an array of numbers",
        ),
        ({"rigs": {1: ([1], np.eye(3))}}, r"node 1 has the frame \[1\], expected an integer or"),
        ({"gravity": {2: ([0, 1, 0], 1)}, "down": [0, 0, 0]}, "down is .*, expected a finite"),
        (
            {"fixed": {1: np.eye(3)}, "absolute": {1: (np.eye(3), 1)}},
            "the absolute prior of node 1 is of a node whose rotation is fixed",
        ),
        ({"fixed": {k: np.eye(3) for k in range(20)}}, "nothing is left to solve"),
        ({"fixed": [1, 2]}, "expected a dict"),
        ({"rigs": {1: np.eye(3)}}, "(?s)node 1 is .*, expected a pair of a frame and the"),
        ({"rigs": {1: (0, np.zeros((3, 3)))}}, "the rig prior of node 1 is no rotation"),
        (
            {"rigs": {1: (0, np.eye(3)), 2: (0, np.eye(3))}, "fixed": {1: np.eye(3), 2: R_1}},
            "the fixed prior of node 2 does not fit the rig",
        ),
    ],
)
def test_bad_priors_say_what_is_wrong(
    simulation: rotavg.Simulation, priors: dict[str, Any], message: str
) -> None:
    with pytest.raises(rotavg.GraphError, match=message):
        rotavg.solve(simulation.graph, priors=Priors(**priors))


def test_components_that_priors_hold_are_no_weak_parts() -> None:
    a = rotavg.simulate("erdos_renyi", 15, density=0.6, noise=0.01, seed=1)
    b = rotavg.simulate("erdos_renyi", 15, density=0.6, noise=0.01, seed=2)
    graph = rotavg.MeasurementGraph(
        np.concatenate([a.graph.edges, b.graph.edges + 15, [(40, 41)]]),
        np.concatenate([a.graph.rotations, b.graph.rotations, [np.eye(3)]]),
    )
    T = np.concatenate([a.ground_truth, b.ground_truth])
    held: list[Priors] = [
        Priors(fixed={2: T[2], 20: T[20]}),
        Priors(absolute={k: (T[k], 1.0) for k in range(30)}),
        Priors(gravity={k: (T[k].T @ DOWN, 1.0) for k in range(30)}),
    ]
    for priors in held:
        text = str(rotavg.solve(graph, loss="auto", priors=priors))
        assert "weak parts" not in text
        assert "2: the priors hold the first, the other has a gauge of its own" in text
    # A component of which one prior alone is known meets it exactly, right or wrong.
    one = {**{k: (T[k], 1.0) for k in range(15)}, 15: (T[3], 1.0)}
    text = str(rotavg.solve(graph, loss="auto", priors=Priors(absolute=one)))
    assert "weak parts" not in text
    assert "absolute    0 of 16 priors are outliers" in text


def test_command_line(
    tmp_path: Path, simulation: rotavg.Simulation, truth: NDArray[np.float64]
) -> None:
    rotavg.write(tmp_path / "g.csv", simulation.graph)
    names = [str(k) for k in range(20)]
    write_gravity(tmp_path / "down.txt", [*names, "elsewhere"], [*downs(truth, 0.01), DOWN])
    held = rotavg.solve(simulation.graph, priors=Priors(fixed={3: truth[3], 5: truth[5]}))
    q = held.quaternions
    lines = [f"{k} {' '.join(map(repr, q[k].tolist()))}\n" for k in (3, 5)]
    (tmp_path / "fixed.txt").write_text("# id qx qy qz qw\n" + "".join(lines))
    files = ["--fixed", tmp_path / "fixed.txt", "--gravity", tmp_path / "down.txt"]
    done = run("solve", tmp_path / "g.csv", *files, "-o", tmp_path / "s.npz")
    assert done.returncode == 0, done.stderr
    assert "2 fixed, 20 gravity" in done.stdout
    assert "1 of 21 nodes are not in the graph" in done.stderr
    with np.load(tmp_path / "s.npz") as archive:
        np.testing.assert_allclose(archive["rotations"][3], truth[3], atol=1e-12)

    alone = run("solve", tmp_path / "g.csv", "--gravity-weight", "2")
    assert alone.returncode == 2
    assert "--gravity-weight is for --gravity" in alone.stderr
    (tmp_path / "other.txt").write_text("# id qx qy qz qw\na 0 0 0 1\n")
    other = run("solve", tmp_path / "g.csv", "--fixed", tmp_path / "other.txt")
    assert other.returncode == 2
    assert "none of the nodes in the file is in the graph" in other.stderr
