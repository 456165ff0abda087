"""What cycles check, what weights say, and what is known of edges and priors beforehand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.cli.main import commands
from rotavg.cli.summary import summary
from rotavg.io.edges import read_edge_list
from rotavg.solving.uncertainty import estimated_noise_variance
from shared_data import shared_data

LOSSES = ("auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls")


def case(name: str) -> Path:
    return shared_data(f"../cases/{name}")


def turn(z: float) -> np.ndarray:
    return np.array([0.0, 0.0, z])


def ring_with_tail(tail: int) -> rotavg.MeasurementGraph:
    """Nine nodes in a ring that misses the identity by nine degrees, and a tail."""
    edges = [(k, (k + 1) % 9) for k in range(9)] + [(8 + k, 9 + k) for k in range(tail)]
    turns = [turn(np.radians(41))] * 9 + [turn(0.3)] * tail
    return rotavg.MeasurementGraph.from_rotvecs(edges, np.array(turns))


@pytest.mark.parametrize("loss", LOSSES)
def test_a_chain_of_bridges_changes_nothing_of_its_core(loss: str) -> None:
    core = rotavg.read(case("bridges/pendant_core.txt"))
    chain = rotavg.read(case("bridges/pendant_chain.txt"))
    a = rotavg.solve(core, loss=loss)  # type: ignore[arg-type]
    b = rotavg.solve(chain, loss=loss)  # type: ignore[arg-type]
    assert a.robust is not None
    assert b.robust is not None
    assert a.robust.noise == b.robust.noise
    assert a.edge_verdicts.tolist() == b.edge_verdicts[: core.num_edges].tolist()
    assert set(b.edge_verdicts[core.num_edges :].tolist()) == {"bridge"}
    assert b.solved
    assert estimated_noise_variance(b) == pytest.approx(estimated_noise_variance(a), rel=1e-3)


@pytest.mark.parametrize("tail", [0, 12])
def test_one_cycle_is_no_contamination(tail: int) -> None:
    graph = ring_with_tail(tail)
    assert "outliers?" not in str(rotavg.solve(graph))
    for loss in LOSSES:
        assert not rotavg.solve(graph, loss=loss).is_outlier.any()  # type: ignore[arg-type]


def test_a_real_trajectory_of_few_loops_is_not_called_contaminated() -> None:
    path = case("g2o/kimera_ordered.g2o")
    graph = rotavg.read(path)
    assert "outliers?" not in str(rotavg.solve(graph))
    solution = rotavg.solve(graph, loss="auto")
    assert solution.is_outlier.sum() <= 2
    assert solution.solved
    result = CliRunner().invoke(commands, ["info", str(path), "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["cycles"]["contamination"] is None


def test_counts_of_inliers_are_precisions() -> None:
    graph = rotavg.read(case("weights/sequential_inliers.txt"))
    nodes, truth = rotavg.read_rotations(case("weights/sequential_truth.txt"))
    assert nodes.tolist() == graph.nodes.tolist()
    solution = rotavg.solve(graph, loss="auto")
    assert solution.is_outlier.sum() <= 1
    assert np.degrees(rotavg.compare(solution.rotations, truth).mean) < 0.85


def test_an_outlier_among_exact_edges_of_uneven_weight_is_proved() -> None:
    graph = rotavg.read(case("weights/k5_one_outlier.txt"))
    for loss in ("auto", "geman_mcclure", "tls"):
        solution = rotavg.solve(graph, loss=loss)  # type: ignore[arg-type]
        assert solution.is_outlier.sum() == 1
        assert solution.solved


def two_sensors(seed: int) -> tuple[rotavg.MeasurementGraph, np.ndarray, np.ndarray]:
    """Edges of 0.3 and of 3 degrees with weights 1 / sigma^2; the truth; which are wrong."""
    rng = np.random.default_rng(seed)
    simulation = rotavg.simulate("erdos_renyi", 60, density=0.2, noise=0.0, seed=seed)
    graph, truth = simulation.graph, simulation.ground_truth
    sigma = np.radians(np.where(rng.random(graph.num_edges) < 0.5, 0.3, 3.0))
    vectors = rng.normal(size=(graph.num_edges, 3)) * sigma[:, None] / np.sqrt(3)
    noise = rotavg.MeasurementGraph.from_rotvecs([(0, 1)] * graph.num_edges, vectors).rotations
    rotations = graph.rotations @ noise
    weights = 1 / sigma**2
    wrong = np.zeros(graph.num_edges, dtype=bool)
    wrong[::12] = True  # each as heavy as a hundred of the others
    axes = rng.normal(size=(int(wrong.sum()), 3))
    anywhere = rotavg.MeasurementGraph.from_rotvecs([(0, 1)] * len(axes), 2 * axes)
    rotations[wrong] = anywhere.rotations
    weights[wrong] = 100 * weights.max()
    return rotavg.MeasurementGraph(graph.edges, rotations, weights=weights), truth, wrong


@pytest.mark.parametrize("seed", [1, 2])
def test_residuals_are_judged_in_units_of_their_weights(seed: int) -> None:
    graph, truth, wrong = two_sensors(seed)
    solution = rotavg.solve(graph, loss="auto")
    assert np.degrees(rotavg.compare(solution.rotations, truth).mean) < 0.4
    assert solution.is_outlier[wrong].all()
    assert solution.is_outlier[~wrong].mean() < 0.08
    assert solution.robust is not None
    scales = solution.robust.edge_scales
    assert scales == pytest.approx(np.sqrt(np.median(graph.weights) / graph.weights), rel=1e-9)
    assert "at the median weight" in str(solution)
    frequency = rotavg.solve(graph, loss="auto", weight_kind="frequency")
    assert frequency.robust is not None
    assert (frequency.robust.edge_scales == 1).all()


def test_trusted_and_excluded_edges_scales_and_initial_weights() -> None:
    simulation = rotavg.simulate("erdos_renyi", 40, density=0.4, noise=0.02, outliers=0.2, seed=4)
    graph = simulation.graph
    wrong = np.flatnonzero(simulation.is_outlier)[:3]
    assert rotavg.solve(graph, loss="auto").is_outlier[wrong].all()
    scales = np.ones(graph.num_edges)
    scales[wrong[2]] = 1e3
    solution = rotavg.solve(
        graph,
        loss="auto",
        trusted=graph.edges[wrong[:1], ::-1],  # pairs of nodes, whichever end is first
        excluded=np.arange(graph.num_edges) == wrong[1],
        edge_scales=scales,
        initial_weights=np.where(simulation.is_outlier, 0.0, 1.0),
    )
    assert solution.edge_verdicts[wrong].tolist() == ["trusted", "excluded", "inlier"]
    assert solution.edge_weights[wrong[0]] == 1
    assert solution.edge_weights[wrong[1]] < 1e-5
    assert solution.is_outlier[wrong].tolist() == [False, True, False]
    assert "trusted" in str(solution)
    plain = rotavg.solve(graph, excluded=simulation.is_outlier)  # least squares without them
    assert rotavg.compare(plain.rotations, simulation.ground_truth).mean < 0.02
    assert (plain.edge_verdicts[simulation.is_outlier] == "excluded").all()


def test_what_is_known_of_edges_must_fit_the_graph() -> None:
    graph = ring_with_tail(2)
    with pytest.raises(rotavg.GraphError, match=r"trusted has shape \(3,\); expected \(11,\)"):
        rotavg.solve(graph, loss="auto", trusted=np.ones(3, dtype=bool))
    with pytest.raises(rotavg.GraphError, match=r"edge \(0, 5\), which the graph does not have"):
        rotavg.solve(graph, loss="auto", excluded=[(0, 5)])
    with pytest.raises(rotavg.OptionError, match='trusted is for a robust loss, and this is "l2"'):
        rotavg.solve(graph, trusted=[(0, 1)])
    with pytest.raises(rotavg.OptionError, match=r"edge \(0, 1\) is both trusted and excluded"):
        rotavg.solve(graph, loss="auto", trusted=[(0, 1)], excluded=[(1, 0)])
    with pytest.raises(rotavg.OptionError, match="initial_weights of the edge"):
        rotavg.solve(graph, loss="auto", initial_weights=np.full(11, 2.0))
    with pytest.raises(rotavg.OptionError, match="unknown weight_kind 'heavy'"):
        rotavg.solve(graph, loss="auto", weight_kind="heavy")  # type: ignore[arg-type]


def test_names_in_lists_of_edges_are_those_of_graphs(tmp_path: Path) -> None:
    names = ["a", "b#1", '#0, "x"', "c"]
    graph = rotavg.MeasurementGraph(
        [(names[i], names[j]) for i, j in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2))], [np.eye(3)] * 5
    )
    rotavg.write(tmp_path / "g.csv", graph)
    (tmp_path / "out.csv").write_text('I;J\na;"b#1"\n', encoding="utf-8")
    first = ["solve", str(tmp_path / "g.csv"), "--edges", str(tmp_path / "edges.csv")]
    run = CliRunner().invoke(commands, [*first, "--excluded", str(tmp_path / "out.csv")])
    assert run.exit_code == 0, run.output
    verdicts = {}
    for i, j in read_edge_list(tmp_path / "edges.csv", "none")[0]:
        verdicts[i, j] = (i, j) in read_edge_list(tmp_path / "edges.csv", "is_outlier")[0]
    assert list(verdicts) == list(map(tuple, graph.edges.tolist()))
    assert [pair for pair, wrong in verdicts.items() if wrong] == [("a", "b#1")]
    assert len(verdicts) == 5


def test_known_edges_on_the_command_line(tmp_path: Path) -> None:
    simulation = rotavg.simulate("erdos_renyi", 30, density=0.5, noise=0.02, outliers=0.2, seed=7)
    graph_path, table = tmp_path / "graph.txt", tmp_path / "edges.csv"
    rotavg.write(graph_path, simulation.graph)
    first, second = simulation.graph.edges[np.flatnonzero(simulation.is_outlier)[:2]].tolist()
    (tmp_path / "sure.txt").write_text(f"# i j\n{first[0]} {first[1]}\n")
    (tmp_path / "wrong.csv").write_text(f"i,j,excluded\n{second[0]},{second[1]},1\n0,0,0\n")
    options = ["--loss", "auto", "--trusted", str(tmp_path / "sure.txt"), "--trust-odometry"]
    options += ["--excluded", str(tmp_path / "wrong.csv"), "--edges", str(table), "--json"]
    result = CliRunner().invoke(commands, ["solve", str(graph_path), *options])
    assert result.exit_code == 0, result.output
    verdicts = {}
    for line in table.read_text().splitlines()[1:]:
        fields = line.split(",")
        verdicts[int(fields[0]), int(fields[1])] = fields[-1]
    assert verdicts[tuple(first)] == "trusted"
    assert verdicts[tuple(second)] == "excluded"
    for (i, j), verdict in verdicts.items():
        if abs(i - j) == 1 and verdict != "excluded":
            assert verdict == "trusted"
    (tmp_path / "sure.txt").write_text("0\n")
    result = CliRunner().invoke(commands, ["solve", str(graph_path), *options])
    assert isinstance(result.exception, rotavg.FormatError)
    assert "sure.txt:1: found '0', expected I J" in str(result.exception)
    (tmp_path / "sure.txt").write_text(f"# i j\n{first[0]} {first[1]}\n0 99\n")
    result = CliRunner().invoke(commands, ["solve", str(graph_path), *options])
    assert "sure.txt:3: it holds the edge (0, 99), which the graph" in str(result.exception)
    result = CliRunner().invoke(commands, ["solve", str(graph_path), "--trust-odometry"])
    assert result.exit_code == 2
    assert "--trust-odometry is for --loss" in result.output


def test_median_and_least_cycle_errors_by_brute_force() -> None:
    graph = rotavg.simulate("erdos_renyi", 12, density=0.6, noise=0.1, seed=3).graph
    by_ends = {}
    for (i, j), R in zip(graph.indices.tolist(), graph.rotations):
        by_ends[i, j], by_ends[j, i] = R, R.T
    evidence = rotavg.cycle_evidence(graph, 0.01, min_cycles=1)
    for k, (i, j) in enumerate(graph.indices.tolist()):
        angles = []
        for v in range(graph.num_nodes):
            if (i, v) in by_ends and (v, j) in by_ends:
                around = by_ends[i, v] @ by_ends[v, j] @ by_ends[j, i]
                angles.append(np.arccos(np.clip((np.trace(around) - 1) / 2, -1, 1)))
        if angles and len(angles) == evidence.checked[k]:
            assert evidence.median_error[k] == pytest.approx(np.median(angles), abs=1e-7)
            assert evidence.least_error[k] == pytest.approx(min(angles), abs=1e-7)
            assert evidence.refuted[k] == (min(angles) > 0.01)
    with pytest.raises(rotavg.OptionError, match="min_cycles is 0"):
        rotavg.cycle_evidence(graph, 0.1, min_cycles=0)


@pytest.mark.parametrize("loss", ["auto", "geman_mcclure", "l1"])
def test_wrong_gravity_does_not_tilt(loss: str) -> None:
    simulation = rotavg.simulate("erdos_renyi", 50, density=0.2, noise=0.01, seed=1)
    rng = np.random.default_rng(0)
    truth = simulation.ground_truth
    down = truth.transpose(0, 2, 1) @ [0, 1, 0] + rng.normal(0, 0.01, (50, 3))
    wrong = rng.permutation(50)[:12]
    down[wrong] = rng.normal(size=(12, 3))
    priors = rotavg.Priors(gravity={node: (down[node], 1.0) for node in range(50)})

    solution = rotavg.solve(simulation.graph, loss=loss, priors=priors)  # type: ignore[arg-type]
    up = (solution.rotations @ truth.transpose(0, 2, 1)) @ [0, 1, 0]
    assert np.degrees(np.arccos(np.clip(up[:, 1], -1, 1))).max() < 1.5
    assert solution.solved
    assert solution.robust is not None
    fit = solution.robust.gravity_priors
    assert fit is not None
    assert solution.robust.absolute_priors is None
    assert set(wrong.tolist()) <= set(fit.nodes[fit.is_outlier].tolist())
    assert fit.is_outlier.sum() <= 15
    assert "priors are outliers" in str(solution)
    certificate = rotavg.certify(
        simulation.graph.with_weights(solution.edge_weights),
        solution.rotations,
        priors=rotavg.Priors(gravity={node: (down[node], fit.weights[node]) for node in range(50)}),
    )
    assert certificate.verdict == "proved"
    believed = rotavg.solve(
        simulation.graph,
        loss=loss,  # type: ignore[arg-type]
        priors=priors,
        robust_priors=False,
    )
    assert believed.robust is not None
    assert believed.robust.gravity_priors is None
    up = (believed.rotations @ truth.transpose(0, 2, 1)) @ [0, 1, 0]
    assert np.degrees(np.arccos(np.clip(up[:, 1], -1, 1))).max() > 2
    # Outliers do not count in the noise, from which covariances follow.
    assert estimated_noise_variance(solution) < 0.2 * estimated_noise_variance(believed)


def test_gravity_refined_from_the_neighbours() -> None:
    simulation = rotavg.simulate("erdos_renyi", 50, density=0.3, noise=0.005, seed=2)
    rng = np.random.default_rng(1)
    exact = simulation.ground_truth.transpose(0, 2, 1) @ [0, 1, 0]
    given = exact + rng.normal(0, 0.03, (50, 3))
    given[::5] = rng.normal(size=(10, 3))
    refined = rotavg.refined_gravity(
        simulation.graph, {node: given[node] for node in range(50) if node != 7}
    )
    assert sorted(refined) == list(range(50))
    for node, down in refined.items():
        assert np.linalg.norm(down) == pytest.approx(1)
        assert np.linalg.norm(down - exact[node]) < 0.06
    with pytest.raises(rotavg.GraphError, match="not in the graph"):
        rotavg.refined_gravity(simulation.graph, {77: [0, 1, 0]})
    with pytest.raises(rotavg.GraphError, match="expected a direction"):
        rotavg.refined_gravity(simulation.graph, {7: [0, 0, 0]})
    with pytest.raises(rotavg.OptionError, match="rounds is 0"):
        rotavg.refined_gravity(simulation.graph, {}, rounds=0)


def test_what_outliers_alone_check_is_told() -> None:
    """Two groups joined by edges, or a chain, that contradict one another: which is wrong?"""
    n = 6
    edges = [(i, j) for i in range(n) for j in range(i)]
    edges += [(n + i, n + j) for i, j in edges]
    joins = len(edges)
    for chain, others in (((0, n), 2), ((0, 2 * n, 2 * n + 1, n), 1)):
        all_edges = [*edges, *zip(chain[:-1], chain[1:])]
        all_edges += [(k, n + k) for k in range(1, 1 + others)]
        rotvecs = np.zeros((len(all_edges), 3))
        rotvecs[-others:] = np.eye(3)[:others]
        graph = rotavg.MeasurementGraph.from_rotvecs(all_edges, rotvecs)
        start = np.tile(np.eye(3), (graph.num_nodes, 1, 1))
        solution = rotavg.solve(graph, loss="geman_mcclure", loss_scale=0.02, init=start)
        np.testing.assert_array_equal(
            np.flatnonzero(solution.is_outlier), np.arange(len(all_edges))[-others:]
        )
        expected = (np.arange(len(all_edges)) >= joins) & ~solution.is_outlier
        np.testing.assert_array_equal(solution.is_unchecked, expected)
        assert "that outliers alone check" in str(solution)
        assert not rotavg.solve(graph).is_unchecked.any()


def test_groups_that_hang_on_edges_which_nothing_checks_are_told() -> None:
    """Complete graphs in a row, joined by bridges, by three edges of which one is right, by two."""
    n = 6
    inside = [(i, j) for i in range(n) for j in range(i)]
    edges = [(4 * n, 0)] + [(k * n + i, k * n + j) for k in range(4) for i, j in inside]
    edges += [(0, n)]  # a bridge
    edges += [(0, 2 * n), (1, 2 * n + 1), (2, 2 * n + 2)]  # contradict each other
    edges += [(0, 3 * n), (1, 3 * n + 1)]  # agree
    rotvecs = np.zeros((len(edges), 3))
    rotvecs[-4:-2] = np.eye(3)[:2]
    graph = rotavg.MeasurementGraph.from_rotvecs(edges, rotvecs)
    start = np.tile(np.eye(3), (graph.num_nodes, 1, 1))

    def groups(**known: Any) -> list[list[int]]:
        solution = rotavg.solve(graph, loss="tls", loss_scale=0.02, init=start, **known)
        told = [sorted(group.tolist()) for group in solution.hanging_groups]
        assert ("on edges that nothing checks" in str(solution)) == bool(told)
        assert ("that nothing checks\n" in str(solution)) == bool(told)  # in what is proved
        return told

    second, third = list(range(n, 2 * n)), list(range(2 * n, 3 * n))
    assert groups() == [second, third]  # and not the pendant node
    assert groups(trusted=[(0, n)]) == [third]
    # What outliers alone hold is a part of its own, which hangs on nothing.
    joins = [(k, 2 * n + k) for k in range(3)]
    assert groups(trusted=[(0, n)], excluded=joins) == []
    assert rotavg.solve(graph).hanging_groups == []
    tree = rotavg.MeasurementGraph.from_rotvecs(edges[:1] + edges[1:2], rotvecs[:2])
    assert rotavg.solve(tree, loss="tls", loss_scale=0.02).hanging_groups == []


def test_of_parallel_edges_the_cycle_check_takes_those_that_agree_best() -> None:
    for order in ((1, 0), (0, 1)):
        edges, turns = [(0, 1)], [turn(0)]
        for k in (2, 3, 4):
            edges += [(0, k), (1, k), (1, k)]
            turns += [turn(0), *(turn(2.0 * wrong) for wrong in order)]
        graph = rotavg.MeasurementGraph.from_rotvecs(edges, np.array(turns))
        evidence = rotavg.cycle_evidence(graph, 0.1)
        assert (evidence.checked[0], evidence.agreeing[0]) == (3, 3)
        assert rotavg.solve(graph, cycle_threshold=0.1).edge_verdicts[0] == "inlier"


def test_parts_that_gravity_alone_holds_are_no_weak_parts() -> None:
    a, b = (rotavg.simulate("complete", 6, noise=0.02, seed=seed) for seed in (1, 2))
    truth = np.r_[a.ground_truth, b.ground_truth]
    graph = rotavg.MeasurementGraph(
        np.r_[a.graph.edges, b.graph.edges + 6], np.r_[a.graph.rotations, b.graph.rotations]
    )
    priors = rotavg.Priors(gravity={k: (truth[k].T @ [0, 1, 0], 1.0) for k in range(12)})
    solution = rotavg.solve(graph, loss="auto", priors=priors)
    assert "rejected edges only" not in str(solution)
    told = summary(solution, 0, 0)["robust"]
    assert told["weak_parts"] == 0


def test_one_wrong_edge_is_one_witness_however_often_the_other_was_measured() -> None:
    for last in (0, 1):  # whichever end the parallel edges are at
        edges = [(0, 1), (last, 2), *[(1 - last, 2)] * 8]
        turns = np.array([turn(0), turn(2.0), *[turn(0)] * 8])
        graph = rotavg.MeasurementGraph.from_rotvecs(edges, turns)
        evidence = rotavg.cycle_evidence(graph, 0.1)
        assert (evidence.checked[0], evidence.agreeing[0]) == (1, 0)
        assert not evidence.refuted[0]
