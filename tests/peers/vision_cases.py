"""Theia and OpenMVG; vision family, as these have it."""

from __future__ import annotations

import numpy as np

import rotavg
from rotavg.graph.se3 import log_so3
from tests.peers.suite import (
    Floats,
    about,
    cameras_of,
    case,
    degrees_between,
    noisy,
    random_pairs,
    relative_of,
    turns,
)


def _theia(n: int, m: int, noise: float, loss: str, init: str, seed: int) -> float:
    """The largest error of a camera, degrees."""
    rng = np.random.default_rng(seed)
    R = turns(rng, n, 0.2)
    pairs = random_pairs(rng, n, m)
    measured = noisy(rng, relative_of(R, pairs), np.full(m, noise))
    graph = rotavg.MeasurementGraph(pairs, measured, convention="vision")
    found = rotavg.solve(graph, loss=loss, init=init)
    return float(degrees_between(found.rotations, cameras_of(R)).max())


def _draws(*arguments: object) -> float:
    """The median of 21 draws: the peer's test is one."""
    return float(np.median([_theia(*arguments, seed) for seed in range(21)]))  # type: ignore[arg-type]


@case("Theia", "robust_rotation_estimator_test: SmallTestNoNoise", 1e-8, "deg")
def robust_small() -> float:
    return max(_theia(4, 6, 0.0, "l1", "maximum_spanning_tree", seed) for seed in range(21))


@case("Theia", "robust_rotation_estimator_test: SmallTestWithNoise", 1.0, "deg")
def robust_small_with_noise() -> float:
    return _draws(4, 6, 1.0, "l1", "maximum_spanning_tree")


@case("Theia", "robust_rotation_estimator_test: LargeTestWithNoise", 5.0, "deg")
def robust_large_with_noise() -> float:
    return max(_theia(100, 800, 2.0, "l1", "spanning_tree", seed) for seed in range(5))


@case("Theia", "linear_rotation_estimator_test: SmallTestNoNoise", 1e-6, "deg")
def linear_small() -> float:
    return max(_theia(4, 6, 0.0, "l2", "chordal", seed) for seed in range(21))


@case("Theia", "linear_rotation_estimator_test: SmallTestWithNoise", 2.0, "deg")
def linear_small_with_noise() -> float:
    return max(_theia(4, 6, 1.0, "l2", "chordal", seed) for seed in range(21))


@case("Theia", "linear_rotation_estimator_test: LargeTestWithNoise", 5.0, "deg")
def linear_large_with_noise() -> float:
    return max(_theia(100, 800, 5.0, "l2", "chordal", seed) for seed in range(5))


@case("Theia", "filter_view_graph_cycles_by_rotation_test: No-, Few-, ManyBadRotations", 0, "edges")
def cycles_filter() -> float:
    limit, wrong = np.radians(4), 0
    for bad in (0, 5, 15):
        for seed in range(5):
            rng = np.random.default_rng(seed)
            R = turns(rng, 10)
            pairs = [(k, k + 1) for k in range(9)] + [(k, k + 2) for k in range(8)]
            others = [(i, j) for j in range(10) for i in range(j) if (i, j) not in pairs]
            good: set[int] = set()
            while len(good) < 30:  # until every right pair has a triangle
                order = rng.permutation(len(others))
                drawn = pairs + [others[k] for k in order[: 13 + bad]]
                found = _triangles(drawn[:30], relative_of(R, drawn[:30]))
                good = {edge for edges, _ in found for edge in edges}
            measured = relative_of(R, drawn)
            while True:  # until no wrong pair closes a triangle by accident
                measured[30:] = turns(rng, bad)
                apart = _triangles(drawn, measured)
                if all(angle > limit for edges, angle in apart if max(edges) >= 30):
                    break
            graph = rotavg.MeasurementGraph(drawn, measured, convention="vision")
            least = rotavg.cycle_evidence(graph, limit).least_error
            wrong += int(np.sum((least > limit) != (np.arange(30 + bad) >= 30)))
    return float(wrong)


def _triangles(pairs: list[tuple[int, int]], R: Floats) -> list[tuple[tuple[int, ...], float]]:
    """The three edges of every triangle, and the angle by which it does not close."""
    row = {pair: k for k, pair in enumerate(pairs)}
    found = []
    for i, j in pairs:
        for k in range(j + 1, 10):
            edges = [row.get(pair) for pair in ((i, j), (j, k), (i, k))]
            if None not in edges:
                a, b, c = (R[e] for e in edges)
                angle = float(np.linalg.norm(log_so3((c.T @ b @ a)[None])))
                found.append((tuple(int(e) for e in edges if e is not None), angle))
    return found


@case("Theia", "orientations_from_maximum_spanning_tree_test: SmallTest, LargeTest", 1e-12)
def maximum_spanning_tree() -> float:
    worst = 0.0
    for n, m in ((4, 6), (50, 100)):
        rng = np.random.default_rng(n)
        R = turns(rng, n)
        pairs = random_pairs(rng, n, m)
        graph = rotavg.MeasurementGraph(
            pairs, relative_of(R, pairs), rng.integers(50, 100, m), convention="vision"
        )
        found = rotavg.solve(graph, init="maximum_spanning_tree", max_iterations=0, certify=False)
        worst = max(worst, float(np.sin(found.residual_angles).max()))
    return worst


@case("Theia", "align_rotations_test: NoNoise", 1e-8, "rad")
def align_without_noise() -> float:
    rng = np.random.default_rng(3)
    R = turns(rng, 20)
    return float(np.radians(degrees_between(turns(rng, 1)[0] @ R, R).max()))


@case("Theia", "align_rotations_test: Noise", 5e-2, "rad")
def align_with_noise() -> float:
    rng = np.random.default_rng(4)
    R = turns(rng, 20)
    found = noisy(rng, turns(rng, 1)[0] @ R, np.ones(20))
    return float(np.radians(degrees_between(found, R).max()))


@case("Theia", "pairwise_rotation_error_test: Small, Nontrivial, 180 degrees, Weight", 1e-12)
def residuals() -> float:
    worst = 0.0
    for angle in (1e-4, 1.0, np.pi):
        for weight in (1.0, 2.0):
            graph = rotavg.MeasurementGraph([[0, 1]], [about(0, angle)], [weight])
            f = rotavg.objective(graph, [np.eye(3), np.eye(3)])
            worst = max(worst, abs(f - weight * 8 * np.sin(angle / 2) ** 2))
    return worst


# --- OpenMVG ----------------------------------------------------------------------------------


@case("OpenMVG", "rotation_averaging_test: ClosestSVDRotationMatrix", 1e-8)
def closest_rotation() -> float:
    R = about(0, 0.3)
    return float(np.abs(rotavg.nearest_rotation(R) - R).max())


@case("OpenMVG", "rotation_averaging_test: ClosestSVDRotationMatrixNoisy", 0.02)
def closest_rotation_noisy() -> float:
    M = about(0, 0.3)
    M[2, 2] -= 0.02
    found = rotavg.nearest_rotation(M)
    assert abs(np.linalg.det(found) - 1) < 1e-8
    return float(np.linalg.norm(M - found))


def _triplet(loss: str) -> float:
    turn = about(2, 2 * np.pi / 3)
    graph = rotavg.MeasurementGraph([(0, 1), (1, 2), (2, 0)], [turn] * 3, convention="vision")
    R = cameras_of(rotavg.solve(graph, loss=loss).rotations)
    gaps = [R[j] @ R[i].T - turn for i, j in ((0, 1), (1, 2), (2, 0))]
    return float(max(np.linalg.norm(gap) for gap in gaps))


@case("OpenMVG", "rotation_averaging_test: RotationLeastSquare_3_Camera", 1e-8)
def triplet_least_squares() -> float:
    return _triplet("l2")


@case("OpenMVG", "rotation_averaging_test: RefineRotationsAvgL1IRLS_SimpleTriplet", 1e-8)
def triplet_l1() -> float:
    return _triplet("l1")


def _ring() -> tuple[Floats, list[tuple[int, int]]]:
    """Five cameras in a ring that look at its middle; each is joined to the two next."""
    R = np.array([about(1, 2 * np.pi * k / 5) for k in range(5)])
    return R, [(i, (i + step) % 5) for step in (1, 2) for i in range(5)]


def _ring_error(loss: str) -> float:
    R, pairs = _ring()
    graph = rotavg.MeasurementGraph(pairs, relative_of(R, pairs), convention="vision")
    found = cameras_of(rotavg.solve(graph, loss=loss).rotations)
    return float(np.linalg.norm(found @ found[0].T @ R[0] - R, axis=(1, 2)).max())


@case("OpenMVG", "rotation_averaging_test: RefineRotationsL2_CompleteGraph", 1e-8)
def ring_least_squares() -> float:
    return _ring_error("l2")


@case("OpenMVG", "rotation_averaging_test: RefineRotationsAvgL1IRLS_CompleteGraph", 1e-8)
def ring_l1() -> float:
    return _ring_error("l1")


@case("OpenMVG", "rotation_averaging_test: RefineRotationsAvgL1IRLS_CompleteGraph_outliers", 1e-8)
def ring_with_outliers() -> float:
    R, pairs = _ring()
    measured, weights = relative_of(R, pairs), np.ones(10)
    wrong = [pairs.index((0, 1)), pairs.index((2, 3))]
    for k, degrees in zip(wrong, (0.1, 0.6)):
        measured[k], weights[k] = about(0, np.radians(degrees)), 0.5
    graph = rotavg.MeasurementGraph(pairs, measured, weights, convention="vision")
    first = rotavg.solve(graph, loss="auto")
    assert np.flatnonzero(first.is_outlier).tolist() == sorted(wrong)
    kept = graph.with_weights(np.where(first.is_outlier, 0, 1))
    found = cameras_of(rotavg.solve(kept).rotations)
    return float(np.linalg.norm(found @ found[0].T @ R[0] - R, axis=(1, 2)).max())
