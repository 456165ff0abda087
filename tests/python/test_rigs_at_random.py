"""Rigs of unknown sensors at random: frames and sensors converge, and end where they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs

Array = NDArray[np.float64]


def sensors_off(solution: rotavg.Solution, C: Array) -> float:
    """The furthest that a sensor is off, as |C - C'|."""
    assert solution.rigs is not None
    found = solution.rigs.rotation_of
    return max(float(np.linalg.norm(found[s] - C[s])) for s in range(len(C)))


def random_truth(rng: np.random.Generator, frames: int, sensors: int) -> tuple[Array, Array]:
    """Of images, sensor k % sensors in frame k // sensors, and of the sensors, the first at I."""
    turns = matrices_from_rotvecs(2 * rng.normal(size=(frames, 3)))
    C = matrices_from_rotvecs(rng.normal(size=(sensors, 3)))
    C[0] = np.eye(3)
    return (turns[:, None] @ C).reshape(-1, 3, 3), C


def same_sensor_pairs(frames: int, sensors: int) -> list[tuple[int, int]]:
    """Images of one sensor in two frames; sensor by sensor."""
    return [
        (sensors * f + s, sensors * g + s)
        for s in range(sensors)
        for f in range(frames)
        for g in range(f + 1, frames)
    ]


def test_with_gravity_sensors_and_frames_converge() -> None:
    for seed in (1685, *range(60)):
        rng = np.random.default_rng(seed)
        truth, _ = random_truth(rng, 3, 3)
        i = rng.integers(0, 9, 24)
        j = (i + 1 + rng.integers(0, 8, 24)) % 9
        noise = matrices_from_rotvecs(0.2 * rng.normal(size=(24, 3)))
        R = np.swapaxes(truth[i], 1, 2) @ truth[j] @ noise
        graph = rotavg.MeasurementGraph(np.stack([i, j], axis=1), R, nodes=np.arange(9))
        rigs = rotavg.Rigs({k: (k // 3, k % 3) for k in range(9)}, {0: np.eye(3)})
        gravity = {k: (truth[k].T @ [0, 1, 0], 1.0) for k in range(0, 9, 2)}
        solution = rotavg.solve(graph, priors=rotavg.Priors(rigs=rigs, gravity=gravity))
        assert solution.rigs is not None
        assert solution.rigs.converged, (seed, solution.rigs.relative_gradient)
        assert solution.rigs.iterations <= 10, seed  # Newton's, of second order
        assert "have not converged" not in solution.rigs.sentence
        joint = replace(solution.rigs, converged=False, lower_bound=0.0, rig_objective=1e-9)
        assert "sensors and frames have not converged (relative gradient" in joint.sentence
        assert "could lower the objective of the rigs is not known" in joint.sentence
        doubtful = str(replace(solution, rigs=joint))
        assert "of the frames alone: the sensors have not come to rest" in doubtful
        assert "of the frames alone" not in str(solution)


def test_with_much_noise_and_weights_far_apart_sensors_and_frames_converge() -> None:
    for seed in (99, 105, 189, 199, *range(3000, 3030)):
        rng = np.random.default_rng(seed)
        frames, sensors = int(rng.integers(2, 9)), int(rng.integers(2, 6))
        truth, _ = random_truth(rng, frames, sensors)
        n = len(truth)
        i = rng.integers(0, n, 2 * n)
        j = (i + 1 + rng.integers(0, n - 1, 2 * n)) % n
        noise = matrices_from_rotvecs(0.5 * rng.normal(size=(2 * n, 3)))
        R = np.swapaxes(truth[i], 1, 2) @ truth[j] @ noise
        weights = np.exp(2 * rng.normal(size=2 * n))
        graph = rotavg.MeasurementGraph(np.stack([i, j], axis=1), R, weights, nodes=np.arange(n))
        rigs = rotavg.Rigs({k: (k // sensors, k % sensors) for k in range(n)}, {0: np.eye(3)})
        gravity = {k: (truth[k].T @ [0, 1, 0], 10.0 ** rng.integers(-2, 3)) for k in range(0, n, 2)}
        solution = rotavg.solve(graph, priors=rotavg.Priors(rigs=rigs, gravity=gravity))
        assert solution.rigs is not None
        assert solution.rigs.converged, (seed, solution.rigs.relative_gradient)


@pytest.mark.parametrize("with_gravity", [False, True])
def test_sensors_that_never_see_the_same_are_found_among_few_frames(with_gravity: bool) -> None:
    for seed in range(60):
        rng = np.random.default_rng(seed)
        frames, sensors = int(rng.integers(4, 9)), int(rng.integers(2, 5))
        truth, C = random_truth(rng, frames, sensors)
        pairs = [
            (i, j)
            for i, j in same_sensor_pairs(frames, sensors)
            if j == i + sensors or rng.random() < 0.3
        ]
        i, j = np.array(pairs).T
        graph = rotavg.MeasurementGraph(pairs, np.swapaxes(truth[i], 1, 2) @ truth[j])
        rigs = rotavg.Rigs(
            {k: (k // sensors, k % sensors) for k in range(len(truth))}, {0: np.eye(3)}
        )
        down = {k: (truth[k].T @ [0, 1, 0], 1.0) for k in range(0, len(truth), 2)}
        priors = rotavg.Priors(rigs=rigs, gravity=down if with_gravity else {})
        solution = rotavg.solve(graph, priors=priors)
        assert solution.objective < 1e-12, seed
        assert solution.verdict == "proved"
        assert sensors_off(solution, C) < 1e-6, seed


def test_sensors_that_never_see_the_same_are_found_behind_wrong_edges() -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        frames, sensors = 6, 2
        truth, C = random_truth(rng, frames, sensors)
        pairs = same_sensor_pairs(frames, sensors)
        i, j = np.array(pairs).T
        R = np.swapaxes(truth[i], 1, 2) @ truth[j]
        R = R @ matrices_from_rotvecs(0.002 * rng.normal(size=(len(pairs), 3)))
        for wrong in (3, 20):
            R[wrong] = matrices_from_rotvecs(2 * rng.normal(size=3))
        graph = rotavg.MeasurementGraph(pairs, R)
        rigs = rotavg.Rigs({k: (k // sensors, k % sensors) for k in range(len(truth))})
        solution = rotavg.solve(graph, priors=rotavg.Priors(rigs=rigs), loss="auto")
        assert sensors_off(solution, C) < 0.05, seed


@pytest.mark.parametrize("with_gravity", [False, True])
def test_without_noise_frames_and_sensors_are_proved_together(with_gravity: bool) -> None:
    for seed in range(100):
        rng = np.random.default_rng(seed)
        turns = matrices_from_rotvecs(2 * rng.normal(size=(4, 3)))
        C = [np.eye(3), matrices_from_rotvecs(rng.normal(size=3))]
        truth = np.array([turns[k // 2] @ C[k % 2] for k in range(8)])
        i = rng.integers(0, 8, 20)
        j = (i + 1 + rng.integers(0, 7, 20)) % 8
        edges = np.stack([i, j], axis=1)
        R = np.swapaxes(truth[i], 1, 2) @ truth[j]
        graph = rotavg.MeasurementGraph(edges, R, nodes=np.arange(8))
        rigs = rotavg.Rigs({k: (k // 2, k % 2) for k in range(8)}, {0: np.eye(3)})
        gravity = {k: (truth[k].T @ [0, 1, 0], 1.0) for k in range(8)} if with_gravity else {}
        solution = rotavg.solve(graph, priors=rotavg.Priors(rigs=rigs, gravity=gravity))
        assert solution.verdict == "proved", (seed, solution.certificate)
        assert solution.rigs is not None
        assert "proved for frames and sensors together" in solution.rigs.sentence, seed
