"""Other answers that stand: where one side of a thing looks like another."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.report.verdict import statement

SEED = int(os.environ.get("ROTAVG_TEST_SEED", "20210712"))


def folded_ring(n: int = 80, even: bool = False) -> tuple[rotavg.MeasurementGraph, np.ndarray]:
    """Cameras on a ring about a thing with two like sides, which some edges confuse."""
    rng = np.random.default_rng(3)
    about_z = np.zeros((n, 3))
    about_z[:, 2] = 2 * np.pi * np.arange(n) / n
    truth = matrices_from_rotvecs(about_z)
    half_turn = np.diag([-1.0, -1.0, 1.0])
    edges, rotations, weights = [], [], []

    def add(i: int, j: int, turn: np.ndarray, weight: float) -> None:
        noise = matrices_from_rotvecs(0.002 * rng.standard_normal((1, 3)))[0]
        edges.append((min(i, j), max(i, j)))
        rotations.append(truth[min(i, j)].T @ turn @ truth[max(i, j)] @ noise)
        weights.append(1.0 if even else weight)

    for i in range(n):
        for step in range(1, 7):
            add(i, (i + step) % n, np.eye(3), 400 / step)
        for step in (-1, 0, 1):
            if i < n // 2:
                add(i, (i + n // 2 + step) % n, half_turn, 60 / (1 + abs(step)))
    return rotavg.MeasurementGraph(edges, np.array(rotations), weights=weights), truth


@pytest.mark.parametrize("even", [False, True])
def test_the_answer_is_not_the_folded_one(even: bool) -> None:
    graph, truth = folded_ring(even=even)
    solution = rotavg.solve(graph, loss="auto")
    assert np.degrees(rotavg.compare(solution.rotations, truth).angles.max()) < 1
    assert "starts led to" in solution.reason


@pytest.mark.parametrize("even", [False, True])
def test_a_fold_shows_at_its_seam_however_long_the_ring_is(even: bool) -> None:
    graph, truth = folded_ring(800, even=even)  # folded, it rejects 42 of 6000 edges
    solution = rotavg.solve(graph, loss="auto", certify=False)
    assert np.degrees(rotavg.compare(solution.rotations, truth).angles.max()) < 1


def test_a_robust_proof_names_what_is_proved() -> None:
    graph, _ = folded_ring()
    solution = rotavg.solve(graph, loss="auto")
    verdict = next(line for line in str(solution).splitlines() if "verdict" in line)
    assert "of the least squares on the edges it kept" in verdict
    rejected = int(solution.is_outlier.sum())
    assert f"{rejected} of {graph.num_edges} edges rejected" in verdict


def test_two_halves_that_two_edges_join_in_two_ways_have_two_stories() -> None:
    rng = np.random.default_rng(5)
    n = 12
    truth = matrices_from_rotvecs(rng.standard_normal((2 * n, 3)))
    wrong = matrices_from_rotvecs(np.array([[1.0, 0, 0]]))[0]
    edges, rotations = [], []

    def add(i: int, j: int, turn: np.ndarray) -> None:
        noise = matrices_from_rotvecs(0.003 * rng.standard_normal((1, 3)))[0]
        edges.append((i, j))
        rotations.append(truth[i].T @ turn @ truth[j] @ noise)

    for half in (0, n):
        for i in range(n):
            for j in range(i):
                add(half + j, half + i, np.eye(3))
    for k in range(8):
        add(k, n + k, np.eye(3))
    for k in range(8):
        add(k, n + (k + 3) % 8, wrong)
    solution = rotavg.solve(rotavg.MeasurementGraph(edges, np.array(rotations)), loss="auto")
    robust = solution.robust
    assert robust is not None
    for story in robust.alternatives:
        assert story.rotations.shape == (2 * n, 3, 3)
        shared = story.group == 0
        # In the gauge of the answer, what both share is the same.
        error = np.abs(story.rotations[shared] - solution.rotations[shared]).max()
        assert error < 0.1
        assert sorted(story.nodes.tolist()) == np.flatnonzero(~shared).tolist()
        assert story.bundles[0].alternative_edges > 0
        assert story.sentence in str(solution)


def test_stories_are_in_the_json_and_in_the_report(tmp_path: Path) -> None:
    graph, _ = folded_ring()
    rotavg.write(tmp_path / "ring.npz", graph)
    command = [sys.executable, "-m", "rotavg", "solve", str(tmp_path / "ring.npz")]
    done = subprocess.run(
        [*command, "--loss", "auto", "--json"], capture_output=True, text=True, check=True
    )
    told = json.loads(done.stdout)["robust"]
    assert told["weak_parts"] == 0
    assert isinstance(told["alternatives"], list)


def test_the_maximum_spanning_tree_starts_along_the_heaviest_edges() -> None:
    graph, truth = folded_ring()
    start = rotavg.solve(graph, init="maximum_spanning_tree", max_iterations=0, certify=False)
    assert np.degrees(rotavg.compare(start.rotations, truth).angles.max()) < 5


def doubtful() -> tuple[rotavg.MeasurementGraph, np.ndarray]:
    """Two groups of twenty, of which as many edges say one thing as say another."""
    rng = np.random.default_rng(0)
    truth = matrices_from_rotvecs(rng.normal(size=(40, 3)))
    within = [(i, j) for i in range(40) for j in range(i + 1, 40) if i // 20 == j // 20]
    within = [pair for pair in within if rng.random() < 0.6]
    across = [(k, 20 + (7 * k) % 20) for k in range(16)]
    noise = matrices_from_rotvecs(0.01 * rng.normal(size=(len(within) + 16, 3)))
    turns = np.broadcast_to(np.eye(3), noise.shape).copy()
    turns[len(within) :: 2] = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    i, j = np.array(within + across).T
    measured = np.swapaxes(truth[i], 1, 2) @ turns @ truth[j] @ noise
    return rotavg.MeasurementGraph(np.stack([i, j], axis=1), measured), truth


def test_alternatives_are_told_in_the_gauge_of_the_answer() -> None:
    graph, truth = doubtful()
    two = rotavg.MeasurementGraph(
        np.r_[graph.edges, graph.edges + 40], np.r_[graph.rotations, graph.rotations]
    )
    fixed = rotavg.Priors(fixed={0: truth[0], 40: np.diag([1.0, -1.0, -1.0])})
    gravity = rotavg.Priors(
        gravity={k: (truth[k % 40].T @ [0.0, 0.0, 1.0], 1.0) for k in range(0, 80, 3)},
        down=(0.0, 0.0, 1.0),
    )
    for solution in (
        rotavg.solve(graph, loss="auto", gauge="mean"),
        rotavg.solve(two, loss="auto"),
        rotavg.solve(two, loss="auto", priors=fixed),
        rotavg.solve(two, loss="auto", priors=gravity),
    ):
        assert solution.robust is not None
        assert solution.robust.alternatives
        for story in solution.robust.alternatives:
            shared = story.group == 0
            apart = np.swapaxes(story.rotations, 1, 2)[shared] @ solution.rotations[shared]
            cosine = (np.trace(apart, axis1=1, axis2=2) - 1) / 2
            assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 10


def test_bundles_tell_the_given_weights() -> None:
    graph, _ = doubtful()
    robust = rotavg.solve(graph, loss="auto").robust
    assert robust is not None
    assert robust.alternatives
    for story in robust.alternatives:
        for bundle in story.bundles:
            assert bundle.weight == bundle.edges
            assert bundle.alternative_weight == bundle.alternative_edges


def test_the_report_says_in_its_headline_that_another_answer_is_possible() -> None:
    graph, _ = doubtful()
    said = statement(rotavg.solve(graph, loss="auto"))
    assert said.level == "open"
    assert said.headline.endswith("; 8 of 236 edges rejected; but another answer is possible.")
    simulation = rotavg.simulate("complete", 30, noise=0.05, outliers=0.1, seed=1)
    clear = statement(rotavg.solve(simulation.graph, loss="auto"))
    assert clear.level == "proved"
    assert "but" not in clear.headline
    assert clear.headline.endswith("of 435 edges rejected.")


def test_json_says_of_a_robust_answer_what_is_proved(tmp_path: Path) -> None:
    rotavg.write(tmp_path / "graph.txt", doubtful()[0])
    done = subprocess.run(
        [sys.executable, "-m", "rotavg", "solve", "graph.txt", "--loss", "auto", "--json"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    assert json.loads(done.stdout)["certificate"]["sentence"] == (
        "proved globally optimal of the least squares on the edges it kept; "
        "8 of 236 edges rejected, another answer is possible"
    )


def test_doubts_are_told_without_a_proof_as_well() -> None:
    graph, _ = doubtful()
    for settings in ({"certify": False}, {"certificate_tolerance": 0.0}):
        said = statement(rotavg.solve(graph, loss="auto", **settings))
        assert any("another answer is possible" in detail for detail in said.details)
    missed = rotavg.solve(graph, loss="auto", certificate_tolerance=0.0)
    sentence = next(line for line in str(missed).splitlines() if "verdict" in line)
    assert "; on the edges it kept, 8 of 236 edges rejected" in sentence


def test_where_nothing_agrees_the_noise_does_not_show() -> None:
    """Of rotations drawn at random most are "inliers" of a noise that is as large as can be."""
    rng = np.random.default_rng(0)
    edges = [(i, (i + step) % 100) for i in range(100) for step in (1, 7)]
    quaternions = rng.standard_normal((len(edges), 4))
    solution = rotavg.solve(
        rotavg.MeasurementGraph.from_quaternions(edges, quaternions), loss="auto"
    )
    assert solution.robust is not None
    assert not solution.robust.noise_shows
    doubt = "too few edges agree to tell noise from errors"
    assert doubt in str(solution)
    assert "noise at least 28.6 deg" in str(solution)
    assert statement(solution).headline.endswith(f"; but {doubt}.")
    noisy = rotavg.solve(rotavg.simulate("complete", 30, noise=0.2, seed=1).graph, loss="auto")
    assert noisy.robust is not None
    assert noisy.robust.noise_shows
    assert doubt not in str(noisy)


def test_priors_that_contradict_the_measurements_are_a_doubt() -> None:
    """Edges judged before the priors are met say nothing of what these do to them."""
    simulation = rotavg.simulate("grid", 49, noise=0.01, seed=2)
    turned = simulation.ground_truth[40] @ matrices_from_rotvecs(np.array([[0.0, 1.0, 0.0]]))[0]
    for held, strained in ((simulation.ground_truth[40], False), (turned, True)):
        priors = rotavg.Priors(fixed={0: simulation.ground_truth[0], 40: held})
        solution = rotavg.solve(simulation.graph, loss="auto", priors=priors)
        assert solution.robust is not None
        assert (solution.robust.num_strained > 0) == strained
        assert ("far off once the priors are met" in str(solution)) == strained


def test_what_priors_do_to_bridges_is_told_where_cycles_tell_the_noise() -> None:
    """A chain of poses that hangs on a grid, its end held where it does not belong."""
    simulation = rotavg.simulate("grid", 25, noise=0.01, seed=1)
    chain = [(24 + k, 25 + k) for k in range(4)]
    rotations = np.concatenate([simulation.graph.rotations, [np.eye(3)] * 4])
    edges = np.concatenate([simulation.graph.edges, chain])
    end = simulation.ground_truth[24] @ matrices_from_rotvecs(np.array([[1.0, 0.0, 0.0]]))[0]
    priors = rotavg.Priors(fixed={0: simulation.ground_truth[0], 28: end})
    solution = rotavg.solve(rotavg.MeasurementGraph(edges, rotations), loss="auto", priors=priors)
    assert solution.robust is not None
    assert solution.robust.num_strained >= 4
    alone = rotavg.solve(
        rotavg.MeasurementGraph(chain, rotations[-4:]),
        loss="auto",
        priors=rotavg.Priors(fixed={24: np.eye(3), 28: end}),
    )
    assert alone.robust is not None
    assert alone.robust.num_strained == 0


def test_a_search_that_is_stopped_tells_no_answers_that_are_half_made() -> None:
    graph, _ = doubtful()
    whole = rotavg.solve(graph, loss="auto")
    assert whole.robust is not None
    for stop in range(1, 60):
        calls = 0

        def callback(progress: rotavg.Progress) -> bool:
            nonlocal calls
            calls += 1
            return calls < stop  # noqa: B023

        found = rotavg.solve(graph, loss="auto", callback=callback).robust
        assert found is not None
        for story in found.alternatives:
            known = [other.group.tolist() for other in whole.robust.alternatives]
            assert story.group.tolist() in known


def ring_of_alike(seed: int, n: int = 300, copies: int = 6) -> tuple[rotavg.MeasurementGraph, Any]:
    """Cameras about a thing with six sides that look alike: three edges of five confuse them."""
    rng = np.random.default_rng(seed)
    degrees = np.sort(rng.uniform(0, 324, n))  # a gap of a tenth
    truth = Rotation.from_euler(
        "yx", np.column_stack((degrees + rng.normal(0, 5, n), rng.normal(0, 8, n))), degrees=True
    ).as_matrix()
    i, j = np.triu_indices(n, 1)
    apart = np.abs((degrees[i] - degrees[j] + 180) % 360 - 180)
    sees = (apart < 50) & (rng.random(len(i)) < 0.9 - 0.8 * apart / 50)
    side = 360 / copies
    other = np.round((degrees[j] - degrees[i]) / side)  # where the copy of what i sees stands
    seems = np.abs(degrees[j] - degrees[i] - side * other)
    confuses = (apart >= 50) & (seems < 30) & (rng.random(len(i)) < 0.3)
    matches = np.where(sees, 400 * np.exp(-apart / 15), 200 * np.exp(-seems / 10))
    matches = np.maximum(15, np.floor(matches * rng.lognormal(0, 0.4, len(i))))
    turn = np.where(confuses, -side * other, 0.0)
    moved = Rotation.from_euler("y", turn[:, None], degrees=True).as_matrix() @ truth[j]
    noise = rng.standard_t(3, (len(i), 3)) * (np.radians(0.3) * np.sqrt(300 / matches))[:, None]
    measured = np.swapaxes(truth[i], 1, 2) @ moved @ matrices_from_rotvecs(noise)
    used = sees | confuses
    edges = np.column_stack((i, j))[used]
    return rotavg.MeasurementGraph(edges, measured[used], weights=matches[used]), truth


def test_sides_that_look_alike_are_mostly_told_apart_whatever_their_matches_say() -> None:
    graphs, right, silent = 16, 0, 0
    for seed in range(SEED, SEED + graphs):
        graph, truth = ring_of_alike(seed)
        solution = rotavg.solve(graph, loss="auto", certify=False)
        is_right = np.degrees(rotavg.compare(solution.rotations, truth).mean) < 12
        right += is_right
        silent += not is_right and not solution.robust.alternatives
    # Of seeds 0 to 39 22 are right, and 3 are wrong without a word; without the edges that are
    # strongest whatever they weigh, and doubts about rejected edges that weigh as much, 10 and 19.
    assert right >= 4, f"from seed {SEED}: {right} of {graphs} are right"
    assert silent <= 4, f"from seed {SEED}: {silent} of {graphs} are wrong without a word"


def test_from_a_robust_solution_it_goes_on() -> None:
    graph, truth = ring_of_alike(5)  # where l1 leads from the rotations alone to a folded answer
    first = rotavg.solve(graph, loss="auto", certify=False)
    again = rotavg.solve(graph, loss="auto", init=first, certify=False)
    assert np.degrees(rotavg.compare(first.rotations, truth).mean) < 1
    assert np.degrees(rotavg.compare(again.rotations, truth).mean) < 12
