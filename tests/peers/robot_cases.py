"""DPGO: robust averaging of single rotations, priors, small pose graphs."""

from __future__ import annotations

import numpy as np

import rotavg
from rotavg.graph.conventions import matrices_from_quaternions
from tests.peers.suite import Floats, case, holds


def _random(rng: np.random.Generator, count: int) -> Floats:
    return np.asarray(matrices_from_quaternions(rng.normal(size=(count, 4))))


def _chord(radians: float) -> float:
    """|R - I|_F of a rotation by an angle."""
    return float(2 * np.sqrt(2) * np.sin(radians / 2))


@case("DPGO", "testPGO: testRobustSingleRotationAveragingTrivial", 1e-8)
def one_rotation() -> float:
    worst = 0.0
    for trial in range(50):
        R = _random(np.random.default_rng(trial), 1)
        solution = rotavg.solve(rotavg.MeasurementGraph([(0, 1)], R), loss="tls")
        assert not solution.is_outlier.any()
        worst = max(worst, float(np.linalg.norm(solution.rotations[1] - R[0])))
    return worst


@case("DPGO", "testPGO: testRobustSingleRotationAveraging (40 of 50 wrong)", _chord(0.02))
def one_rotation_of_many() -> float:
    worst = 0.0
    for trial in range(50):
        rng = np.random.default_rng(trial)
        truth = _random(rng, 1)[0]
        others = _random(rng, 200)
        far = np.linalg.norm(others - truth, axis=(1, 2)) > 1.2 * _chord(0.3)
        R = np.concatenate([[truth] * 10, others[far][:40]])
        graph = rotavg.MeasurementGraph([(0, 1)] * 50, R)
        solution = rotavg.solve(graph, loss="tls", loss_scale=0.3)
        assert np.flatnonzero(~solution.is_outlier).tolist() == list(range(10)), trial
        worst = max(worst, float(np.linalg.norm(solution.rotations[1] - truth)))
    return worst


@case("DPGO", "testPGO: testPrior", 1e-6, "", ("scipy",))
def prior() -> float:
    P = rotavg.nearest_rotation(
        [[0.7236, 0.1817, 0.6658], [-0.6100, 0.6198, 0.4938], [-0.3230, -0.7634, 0.5594]]
    )
    translations = rotavg.RelativeTranslations([[0, 0, 0]], [100 * np.eye(3)])
    graph = rotavg.MeasurementGraph([(0, 1)], [np.eye(3)], [10000], translations=translations)
    priors = rotavg.Priors(absolute={1: (P, 10000)}, positions={1: ([0, 0, 0], 100 * np.eye(3))})
    found = rotavg.refine_poses(rotavg.solve(graph, priors=priors))
    return float(max(np.abs(found.rotations - P).max(), np.abs(found.positions).max()))


@case("DPGO", "testPGO: testRobustPGO (one right, one wrong loop closure)", 0)
def robust_loop_closures() -> float:
    wrong = 0
    for trial in range(20):
        rng = np.random.default_rng(trial)
        R = _random(rng, 4)
        edges = [(0, 1), (1, 2), (2, 3), (0, 3), (1, 3)]
        measured = np.array([R[i].T @ R[j] for i, j in edges])
        measured[4] = _random(rng, 1)[0]
        graph = rotavg.MeasurementGraph(edges, measured, [10000] * 5)
        solution = rotavg.solve(graph, loss="auto", trusted=edges[:3])
        wrong += int(np.sum(solution.is_outlier != [False, False, False, False, True]))
    return float(wrong)


@case("DPGO", "testTriangleGraph, testOptimizationThread: TriangleGraph", 1e-4, "", ("scipy",))
def triangle() -> float:
    R = rotavg.nearest_rotation(
        [
            np.eye(3),
            [[0.1436, 0.7406, 0.6564], [-0.8179, -0.2845, 0.5000], [0.5571, -0.6087, 0.5649]],
            [[-0.4069, -0.4150, -0.8138], [0.4049, 0.7166, -0.5679], [0.8188, -0.5606, -0.1236]],
        ]
    )
    p = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]])
    edges = [(0, 1), (1, 2), (0, 2)]
    graph = rotavg.MeasurementGraph(
        edges,
        [R[i].T @ R[j] for i, j in edges],
        translations=rotavg.RelativeTranslations([R[i].T @ (p[j] - p[i]) for i, j in edges]),
    )
    found = rotavg.refine_poses(rotavg.solve(graph))
    return float(max(np.abs(found.rotations - R).max(), np.abs(found.positions - p).max()))


@case("DPGO", "testConstruction, testLineGraph (a line of five)", 0)
def line() -> float:
    rng = np.random.default_rng(0)
    solution = rotavg.solve(
        rotavg.MeasurementGraph([(k, k + 1) for k in range(4)], _random(rng, 4))
    )
    return holds(len(solution) == 5 and solution.residual_angles.max() < 1e-7)
