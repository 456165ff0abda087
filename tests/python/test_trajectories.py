"""Odometry among the edges: trusted by its name, and told where a robust loss doubts it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs

SEED = int(os.environ.get("ROTAVG_TEST_SEED", "20210712"))


def test_odometry_that_is_called_an_outlier_is_told() -> None:
    graph = rotavg.simulate("sphere", n=60, noise=0.01, seed=3).graph
    steps = np.flatnonzero(graph.edges[:, 1] - graph.edges[:, 0] == 1)
    rotations = graph.rotations.copy()
    rotations[steps[30]] = rotations[steps[30]] @ matrices_from_rotvecs(np.array([2.0, 0.0, 0.0]))
    wrong = rotavg.MeasurementGraph(graph.edges, rotations)
    told = "1 of 59 edges between consecutive numbers are outliers (30 -> 31): slips of odometry"
    assert told in str(rotavg.solve(wrong, loss="auto"))
    assert "odometry?" not in str(rotavg.solve(graph, loss="auto"))
    trusting = rotavg.solve(wrong, loss="auto", trusted="odometry")
    assert (trusting.edge_verdicts == "trusted").sum() == len(steps) == 59
    assert "odometry?" not in str(trusting)
    left_out = rotavg.solve(wrong, loss="auto", trusted="odometry", excluded=[(30, 31)])
    assert left_out.is_outlier.sum() == 1
    assert "odometry?" not in str(left_out)
    # Where few ids follow one another it is no trajectory.
    spread = rotavg.MeasurementGraph(3 * graph.edges, rotations)
    assert "odometry?" not in str(rotavg.solve(spread, loss="auto"))


def test_odometry_by_name() -> None:
    graph = rotavg.simulate("sphere", n=40, noise=0.01, seed=3).graph
    left_out = rotavg.solve(graph, loss="tls", trusted="odometry", excluded=[(0, 1)])
    steps = graph.edges[:, 1] - graph.edges[:, 0] == 1
    out = (graph.edges == (0, 1)).all(axis=1)
    assert np.array_equal(left_out.edge_verdicts == "trusted", steps & ~out)
    with pytest.raises(rotavg.OptionError, match="trusted is 'odo'; expected \"odometry\", a mask"):
        rotavg.solve(graph, loss="tls", trusted="odo")
    with pytest.raises(rotavg.OptionError, match="trusted is for a robust loss"):
        rotavg.solve(graph, trusted="odometry")
    spread = rotavg.MeasurementGraph(5 * graph.edges, graph.rotations)
    with pytest.raises(rotavg.GraphError, match="no edge joins consecutive numbers; name the"):
        rotavg.solve(spread, loss="tls", trusted="odometry")
    names = rotavg.MeasurementGraph([[str(i), str(j)] for i, j in graph.edges], graph.rotations)
    with pytest.raises(rotavg.GraphError, match="the nodes have names"):
        rotavg.solve(names, loss="tls", trusted="odometry")


def places_taken_for_others(
    rng: np.random.Generator, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A walk, 80 right closures, four runs of ten that agree: edges, R, weights, wrong, T."""
    steps = matrices_from_rotvecs(rng.normal(0, 0.2, (count - 1, 3)))
    truth = [np.eye(3)]
    for step in steps:
        truth.append(truth[-1] @ step)
    T = np.array(truth)
    odometry = [(k, k + 1) for k in range(count - 1)]
    closures = [tuple(sorted(rng.choice(count, 2, replace=False).tolist())) for _ in range(80)]
    starts = [
        (int(rng.integers(count // 3)), int(rng.integers(count // 2, count - 12))) for _ in range(4)
    ]
    runs = [(i + k, j + k) for i, j in starts for k in range(10)]
    edges = np.array(odometry + closures + runs)
    wrong = np.arange(len(edges)) >= len(edges) - len(runs)
    sigma = np.where(np.arange(len(edges)) < count - 1, 0.005, 0.02)
    turn = np.repeat(matrices_from_rotvecs(rng.normal(0, 1, (4, 3))), 10, axis=0)
    i, j = edges.T
    noise = matrices_from_rotvecs(rng.normal(size=(len(edges), 3)) * sigma[:, None])
    R = np.swapaxes(T[i], 1, 2) @ T[j]
    R[wrong] = np.swapaxes(T[i[wrong]], 1, 2) @ turn @ T[j[wrong]]
    return edges, R @ noise, 0.5 / sigma**2, wrong, T


def test_odometry_is_favoured_where_ids_say_so_and_nothing_was_said() -> None:
    print(f"replay with ROTAVG_TEST_SEED={SEED}")
    rng = np.random.default_rng(SEED)
    edges, R, weights, wrong, T = places_taken_for_others(rng, 500)
    graph = rotavg.MeasurementGraph(edges, R, weights)
    steps = edges[:, 1] - edges[:, 0] == 1
    right = rotavg.MeasurementGraph(edges[~wrong], R[~wrong], weights[~wrong])
    least = rotavg.compare(rotavg.solve(right), T).mean
    favoured = rotavg.solve(graph, loss="auto")
    off = rotavg.compare(favoured, T).mean
    assert off < 2 * least + 0.02
    assert not favoured.is_outlier[steps].any()
    assert favoured.is_outlier[wrong].all()
    assert not (favoured.edge_verdicts == "trusted").any()
    # All alike, closures that agree bend the chain; so do they where ids are names.
    alike = rotavg.solve(graph, loss="auto", trusted=[])
    assert rotavg.compare(alike, T).mean > 2 * off
    names = rotavg.MeasurementGraph([[f"{i:03d}", f"{j:03d}"] for i, j in edges], R, weights)
    named = rotavg.solve(names, loss="auto")
    assert np.array_equal(named.edge_verdicts, alike.edge_verdicts)
    # Some numbers may be missing, and edges come in any order, either way round.
    ids = np.cumsum(1 + (rng.random(500) < 0.1)) - 2**40
    order = rng.permutation(len(edges))
    flipped = np.where((order % 2 == 0)[:, None], ids[edges][order, ::-1], ids[edges][order])
    turned = np.where((order % 2 == 0)[:, None, None], np.swapaxes(R, 1, 2)[order], R[order])
    gaps = rotavg.solve(rotavg.MeasurementGraph(flipped, turned, weights[order]), loss="auto")
    truth = dict(zip(ids.tolist(), T))
    assert rotavg.compare(gaps, truth).mean < 2 * least + 0.02
    # Far numbers are no trajectory.
    spread = rotavg.solve(rotavg.MeasurementGraph(30 * edges, R, weights), loss="auto")
    assert np.array_equal(spread.edge_verdicts, alike.edge_verdicts)
    assert favoured.robust is not None
    assert favoured.robust.is_favoured.sum() > 400
    assert "costs as much as six others" in str(favoured)
    assert alike.robust is not None
    assert not alike.robust.is_favoured.any()


def photographs(rng: np.random.Generator, count: int, reach: int) -> rotavg.MeasurementGraph:
    """A sequence, each matched to its next few; one edge in twenty is wrong."""
    edges = np.array([(i, i + k) for k in range(1, reach + 1) for i in range(count - k)])
    truth = matrices_from_rotvecs(rng.normal(0, 0.5, (count, 3)))
    noise = matrices_from_rotvecs(rng.normal(0, 0.02, (len(edges), 3)))
    R = np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]] @ noise
    wrong = rng.random(len(edges)) < 0.05
    R[wrong] = matrices_from_quaternions(rng.standard_normal((int(wrong.sum()), 4)))
    return rotavg.MeasurementGraph(edges, R)


def test_photographs_in_order_are_no_odometry() -> None:
    """Edges near by check one another there, and a wrong pair of neighbours is nothing special."""
    print(f"replay with ROTAVG_TEST_SEED={SEED}")
    graph = photographs(np.random.default_rng(SEED), 150, 3)
    solution = rotavg.solve(graph, loss="auto")
    alike = rotavg.solve(graph, loss="auto", trusted=[])
    assert solution.robust is not None
    assert not solution.robust.is_favoured.any()
    assert np.array_equal(solution.rotations, alike.rotations)
    assert solution.reason == alike.reason


def test_all_steps_may_be_excluded() -> None:
    rng = np.random.default_rng(SEED)
    edges, R, weights, _, _ = places_taken_for_others(rng, 60)
    steps = edges[:, 1] - edges[:, 0] == 1
    for loss in ("auto", "tls"):
        solution = rotavg.solve(
            rotavg.MeasurementGraph(edges, R, weights), loss=loss, excluded=steps
        )
        assert (solution.edge_verdicts[steps] == "excluded").all()


def test_the_scale_that_is_told_is_that_of_the_median_weight() -> None:
    graph = rotavg.simulate("sphere", n=60, noise=0.01, seed=3).graph
    steps = graph.edges[:, 1] - graph.edges[:, 0] == 1
    weighed = rotavg.MeasurementGraph(graph.edges, graph.rotations, np.where(steps, 100.0, 1.0))
    of_closures = rotavg.solve(weighed, loss="tls", loss_scale=0.1, trusted="odometry")
    even = (~steps).sum() > steps.sum()  # then theirs is the median weight
    assert ("deg at the median weight" in str(of_closures)) != even
    heavy = np.where(steps, 100.0, np.where(np.arange(len(steps)) % 3 == 0, 10.0, 1.0))
    uneven = rotavg.MeasurementGraph(graph.edges, graph.rotations, heavy)
    told = str(rotavg.solve(uneven, loss="tls", loss_scale=0.1, trusted="odometry"))
    assert "deg at the median weight" in told


def test_what_a_robust_loss_alone_has_a_use_for_is_refused() -> None:
    graph = rotavg.simulate("sphere", n=10, noise=0.01, seed=3).graph
    for settings in ({"loss_scale": 0.1}, {"weight_kind": "frequency"}):
        with pytest.raises(rotavg.OptionError, match='is for a robust loss, and this is "l2"'):
            rotavg.solve(graph, **settings)


def aliased(
    rng: np.random.Generator, said: float
) -> tuple[rotavg.MeasurementGraph, np.ndarray, np.ndarray]:
    """A walk among blocks, some closures of which lead to another corner: truth, which are wrong.

    `said` is by how much the information is more than the noise's.
    """
    n, right, wrong = 800, 110, 30
    steps = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    heading, place, walk = 0, np.zeros(2), []
    for k in range(n):
        walk.append(place)
        if k % 4 == 3:
            heading += int(rng.integers(-1, 2))
        while np.abs(place + steps[heading % 4]).max() > 8:
            heading += 1
        place = place + steps[heading % 4]
    p = np.column_stack([walk, np.zeros(n)])
    near = [(i, j) for j in range(n) for i in range(j - 30) if np.linalg.norm(p[i] - p[j]) < 1.2]
    ends = [(k, k + 1) for k in range(n - 1)]
    ends += [near[k] for k in rng.permutation(len(near))[:right]]
    ends += [tuple(sorted(rng.choice(n, 2, replace=False))) for _ in range(wrong)]
    edges = np.array(ends)
    is_wrong = np.arange(len(edges)) >= len(edges) - wrong
    sigma = np.where(np.arange(len(edges)) < n - 1, 0.02, 0.05)
    vectors = p[edges[:, 1]] - p[edges[:, 0]]
    vectors[is_wrong] = rng.normal(size=(wrong, 3)) * (0.7, 0.7, 0.0)
    vectors += sigma[:, None] * rng.normal(size=(len(edges), 3))
    turns = matrices_from_rotvecs(0.2 * sigma[:, None] * rng.normal(size=(len(edges), 3)))
    information = said / sigma[:, None, None] ** 2 * np.eye(3)
    graph = rotavg.MeasurementGraph(
        edges,
        turns,
        12.5 * said / sigma**2,
        translations=rotavg.RelativeTranslations(vectors, information),
    )
    return graph, p, is_wrong


@pytest.mark.parametrize("said", [1.0, 1e4])
def test_wrong_translations_of_closures_are_found(said: float) -> None:
    """They bend all until the bend looks like noise: the information, if it is right, tells."""
    rng = np.random.default_rng(SEED)
    graph, p, is_wrong = aliased(rng, said)
    poses = rotavg.refine_poses(rotavg.solve(graph), loss="tls")
    errors = np.linalg.norm(poses.positions - p, axis=1)
    found = (poses.is_outlier & is_wrong).sum(), (poses.is_outlier & ~is_wrong).sum()
    print(said, found, np.median(errors), poses)
    assert found[1] <= 3, SEED
    if said == 1.0:
        assert found[0] >= is_wrong.sum() - 2, SEED
        assert np.median(errors) < 0.3, SEED


def test_trusted_edges_that_contradict_one_another_are_told() -> None:
    simulation = rotavg.simulate("sphere", n=60, noise=0.01, seed=3)
    graph = simulation.graph
    assert "trusted?" not in str(rotavg.solve(graph, loss="auto", trusted="odometry"))
    wrong = rotavg.MeasurementGraph(
        np.vstack((graph.edges, [[20, 21]])),
        np.concatenate((graph.rotations, matrices_from_rotvecs(np.array([[0.0, 0.0, 1.5]])))),
    )
    told = str(rotavg.solve(wrong, loss="auto", trusted="odometry"))
    assert "trusted edges lie far off" in told
    assert "(20 -> 21)" in told


def test_poses_trust_what_the_rotations_do() -> None:
    rng = np.random.default_rng(SEED)
    graph, _, _ = aliased(rng, 1.0)
    measured = graph.translations
    assert measured is not None
    step = int(np.flatnonzero(np.abs(np.diff(graph.indices, axis=1)[:, 0]) == 1)[200])
    vectors = measured.vectors.copy()
    vectors[step] += 30.0
    slipped = rotavg.MeasurementGraph(
        graph.edges, graph.rotations, graph.weights, graph.nodes, covariances=graph.covariances,
        translations=rotavg.RelativeTranslations(vectors, measured.information),
    )  # fmt: skip
    doubted = rotavg.refine_poses(rotavg.solve(slipped), loss="tls")
    assert doubted.edge_shares[step] < 0.5, f"seed {SEED}"
    trusting = rotavg.refine_poses(rotavg.solve(slipped), loss="tls", trusted="odometry")
    assert trusting.edge_shares[step] == 1.0, f"seed {SEED}"
    inherited = rotavg.solve(slipped, loss="auto", trusted=graph.edges[[step]])
    assert rotavg.refine_poses(inherited, loss="tls").edge_shares[step] == 1.0, f"seed {SEED}"
    with pytest.raises(rotavg.OptionError, match='trusted is for a robust loss, and this is "l2"'):
        rotavg.refine_poses(rotavg.solve(graph), trusted="odometry")


def test_the_command_tells_of_favoured_odometry(tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED)
    edges, R, weights, wrong, _ = places_taken_for_others(rng, 300)
    file = tmp_path / "graph.txt"
    rotavg.write(file, rotavg.MeasurementGraph(edges, R, weights))
    command = ["solve", str(file), "--loss", "auto", "--json", "--no-certify"]
    by_default = json.loads(CliRunner().invoke(commands, command).stdout)["robust"]
    alike = json.loads(CliRunner().invoke(commands, [*command, "--no-odometry"]).stdout)["robust"]
    assert by_default["favoured"] > 200
    assert by_default["outliers"] == wrong.sum()
    assert by_default["odometry_doubt"] is None
    assert alike["favoured"] == 0
    assert "edges between consecutive numbers are outliers" in alike["odometry_doubt"]
    both = CliRunner().invoke(commands, [*command, "--no-odometry", "--trust-odometry"])
    assert both.exit_code == 2
    assert "contradict each other" in both.output
