"""GraphOptim (vision family), GTSFM (pose family) and SciPy."""

from __future__ import annotations

import pickle

import numpy as np

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs
from tests.peers.suite import (
    Floats,
    Pairs,
    about,
    cameras_of,
    case,
    degrees_between,
    holds,
    noisy,
    random_pairs,
    relative_degrees,
    relative_of,
)

# --- GraphOptim -------------------------------------------------------------------------------


def _graphoptim(n: int, m: int, variance: float, loss: str) -> float:
    """The largest error of a camera; the peer's tests ask only that all cameras are estimated."""
    rng = np.random.default_rng(n)
    R = np.array([about(2, 2 * np.pi * k / n) for k in range(n)])
    pairs = random_pairs(rng, n, m)
    noise = 2 * np.abs(rng.normal(scale=np.sqrt(variance), size=m)) / rng.integers(1, 11, m)
    measured = noisy(rng, relative_of(R, pairs), noise)
    found = rotavg.solve(rotavg.MeasurementGraph(pairs, measured, convention="vision"), loss=loss)
    assert found.solved
    assert len(found) == n
    return float(degrees_between(found.rotations, cameras_of(R)).max())


_SIZES = (
    (4, 6),
    (20, 30),
    (50, 75),
    (100, 300),
    (200, 400),
    (500, 2000),
    (1000, 4000),
    (5000, 20000),
)


@case("GraphOptim", "lagrange_dual_rotation_estimator_test: all 15, 4 to 5000 views", 4.0, "deg")
def lagrange_dual() -> float:
    return max(_graphoptim(*size, v, "l2") for size in _SIZES for v in (0.2, 0.5))


@case("GraphOptim", "hybrid_rotation_estimator_test: all 15, 4 to 5000 views", 4.0, "deg")
def hybrid() -> float:
    return max(_graphoptim(*size, v, "auto") for size in _SIZES for v in (0.2, 0.5))


@case("GraphOptim", "robust_l1l2_rotation_estimator_test: all 15, 4 to 5000 views", 4.0, "deg")
def l1_then_l2() -> float:
    return max(_graphoptim(*size, v, "l1") for size in _SIZES for v in (0.2, 0.5))


# --- GTSFM ------------------------------------------------------------------------------------


def _gtsfm(truth: Floats, pairs: Pairs) -> float:
    """Of rotations i2Ri1 = R_i2^T R_i1 of pairs (i1, i2), world_from_camera; by loss l2."""
    pairs = list(pairs)
    edges = [(i2, i1) for i1, i2 in pairs]
    graph = rotavg.MeasurementGraph(edges, [truth[i].T @ truth[j] for i, j in edges])
    return relative_degrees(rotavg.solve(graph).rotations, truth[graph.nodes])


@case("GTSFM", "test_shonan.py: circle_two_edges, circle_all_edges", 2.0, "deg")
def circle() -> float:
    truth = np.array([about(2, k * np.pi / 2) @ about(0, 2.0) for k in range(4)])
    every = [(i, j) for j in range(4) for i in range(j)]
    return max(_gtsfm(truth, [(1, 0), (2, 1), (3, 2), (0, 3)]), _gtsfm(truth, every))


@case("GTSFM", "test_shonan.py: line_large_edges, panorama", 2.0, "deg")
def line_and_panorama() -> float:
    every = [(0, 1), (0, 2), (1, 2)]
    line = np.array([about(1, np.radians(10))] * 3)
    panorama = np.array([about(1, np.radians(a)) for a in (-30, 0, 30)])
    return max(_gtsfm(line, every), _gtsfm(panorama, every))


@case("GTSFM", "test_shonan.py: simple, computation_graph", 2.0, "deg")
def simple() -> float:
    first, second = about(1, np.radians(30)), about(2, np.radians(20))
    graph = rotavg.MeasurementGraph([(0, 1), (1, 2)], [first, second])
    truth = np.array([np.eye(3), first, first @ second])
    return relative_degrees(rotavg.solve(graph).rotations, truth)


@case("GTSFM", "test_shonan.py: simple_with_prior (on a pair)", 2.0, "deg")
def prior_on_a_pair() -> float:
    truth = np.array([np.eye(3), about(1, np.radians(30)), about(0, np.radians(30))])
    graph = rotavg.MeasurementGraph([(0, 1), (0, 2)], truth[1:], weights=[0.5, 5e4])
    return relative_degrees(rotavg.solve(graph).rotations, truth)


@case("GTSFM", "test_shonan.py: nonconsecutive_indices", 0.1, "deg")
def nonconsecutive() -> float:
    graph = rotavg.MeasurementGraph([(2, 1), (3, 2), (3, 1)], [np.eye(3)] * 3)
    found = rotavg.solve(graph)
    assert 0 not in found
    return relative_degrees(found.rotations, np.array([np.eye(3)] * 3))


@case("GTSFM", "test_shonan.py: pickleable", 0)
def pickleable() -> float:
    solution = rotavg.solve(rotavg.simulate("complete", 5, noise=0.1, seed=1).graph)
    again = pickle.loads(pickle.dumps(solution.graph))
    return holds((rotavg.solve(again).rotations == solution.rotations).all())


@case("GTSFM", "test_cycle_consistent_rotation_estimator.py: filter_to_cycle_consistent_edges", 0)
def cycle_consistent() -> float:
    pairs = [(0, 1), (1, 2), (0, 2), (2, 3), (3, 4), (2, 4)]
    R = [np.eye(3)] * 5 + [about(1, np.radians(15))]
    graph = rotavg.MeasurementGraph([(j, i) for i, j in pairs], R)
    kept = rotavg.cycle_evidence(graph, np.radians(7)).median_error < np.radians(7)
    return holds(kept.tolist() == [True, True, True, False, False, False])


@case("GTSFM", "test_shonan_reproducibility.py (the same bits)", 0)
def reproducible() -> float:
    graph = rotavg.simulate("erdos_renyi", 32, density=0.4, noise=0.1, outliers=0.1, seed=2).graph
    runs = [rotavg.solve(graph, loss="auto", num_threads=k).rotations for k in (1, 2, 4)]
    return holds((runs[0] == runs[1]).all() and (runs[0] == runs[2]).all())


# --- SciPy ------------------------------------------------------------------------------------


def _mean(R: Floats, weights: Floats | None = None) -> Floats:
    """The chordal mean, as the second of two nodes."""
    graph = rotavg.MeasurementGraph([(0, 1)] * len(R), R, weights)
    return rotavg.solve(graph, tolerance=1e-12).rotations[1]


@case("SciPy", "test_rotation.py: test_mean, test_mean_axis", 1e-10, "rad")
def scipy_mean() -> float:
    axes = np.concatenate([-np.eye(3), np.eye(3)])
    gaps = [_mean(matrices_from_rotvecs(t * axes)) for t in np.linspace(0, np.pi / 2, 100)]
    return float(np.abs(np.array(gaps) - np.eye(3)).max())


@case("SciPy", "test_rotation.py: test_weighted_mean", 1e-6, "rad")
def scipy_weighted_mean() -> float:
    axes = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]])
    worst = 0.0
    for t in np.linspace(0, np.pi / 2, 100):
        R = matrices_from_rotvecs(t * axes)
        gap = _mean(R) - _mean(R[:2], np.array([1.0, 2]))
        worst = max(worst, float(np.abs(gap).max()))
    return worst


@case(
    "SciPy",
    "test_rotation.py: test_mean_compare_axis (against Rotation.mean)",
    1e-10,
    "rad",
    ("scipy",),
)
def scipy_mean_of_random() -> float:
    from scipy.spatial.transform import Rotation

    worst = 0.0
    for seed in range(20):
        R = Rotation.random(6, rng=np.random.default_rng(seed))
        worst = max(worst, float(np.abs(_mean(R.as_matrix()) - R.mean().as_matrix()).max()))
    return worst


@case("SciPy", "test_rotation.py: test_mean_input_validation, test_zero_rotation_mean", 0)
def scipy_mean_of_nothing() -> float:
    refused = 0
    for build in (
        lambda: _mean(np.array([np.eye(3)] * 4), -np.ones(4)),
        lambda: _mean(np.array([np.eye(3)] * 3), np.ones(2)),
        lambda: rotavg.karcher_mean(np.empty((0, 3, 3))),
    ):
        try:
            build()
        except ValueError:
            refused += 1
    return holds(refused == 3)
