"""Priors beside full covariances: closed forms, brute force, headings, outliers, covariances."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from benchmarks.anisotropic_graphs import RATIOS, simulated
from rotavg.graph.conventions import matrices_from_rotvecs

Array = NDArray[np.float64]
DOWN = np.array([0.0, 1.0, 0.0])


def cost(error: Array, H: Array) -> float:
    """4 v^T H v of rotations (k, 3, 3), v = sin(angle / 2) axis."""
    from scipy.spatial.transform import Rotation

    v = Rotation.from_matrix(error).as_quat()[:, :3]
    return float(4 * np.einsum("ka,kab,kb->", v, H, v))


def objective(graph: rotavg.MeasurementGraph, R: Array, priors: rotavg.Priors) -> float:
    """From the definitions; weights of priors are precisions, radians^-2."""
    assert graph.covariances is not None
    i, j = graph.indices.T
    f = cost(np.swapaxes(R[i] @ graph.rotations, 1, 2) @ R[j], np.linalg.inv(graph.covariances))
    for node, (P, w) in priors.absolute.items():
        f += w / 2 * float(np.sum((R[node] - P) ** 2))
    for node, (d, w) in priors.gravity.items():
        f += w * float(np.sum((R[node] @ d / np.linalg.norm(d) - priors.down) ** 2))
    return f


def turn_about_z(angle: float) -> Array:
    return matrices_from_rotvecs(np.array([0, 0, angle]))


@pytest.mark.parametrize("kind", ["absolute", "gravity"])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_weight_means_the_same_everywhere(kind: str, scale: float) -> None:
    """Two nodes, one held: tan phi = h sin theta / (h cos theta + w) whoever says h and w."""
    theta, h, w = 0.7, 30.0 * scale, 12.0 * scale
    prior: Any = (np.eye(3), w) if kind == "absolute" else (DOWN, w)
    priors = rotavg.Priors(fixed={0: np.eye(3)}, **{kind: {1: prior}})
    expected = turn_about_z(np.arctan2(h * np.sin(theta), h * np.cos(theta) + w))
    edges, R = [(0, 1)], [turn_about_z(theta)]
    weighted = rotavg.MeasurementGraph(edges, R, weights=[h])
    alike = rotavg.MeasurementGraph(edges, R, covariances=[np.eye(3) / h])
    # Heavier about x and y; the mean variance is 1 / h, and so is that about z.
    spread = rotavg.MeasurementGraph(edges, R, covariances=[np.diag([0.5, 1.5, 1]) / h])
    # Weights of their own: the prior counts as an edge of its weight all the same.
    counted = rotavg.MeasurementGraph(edges, R, covariances=[np.eye(3) / (700 * h)], weights=[h])
    for graph, full in [
        (weighted, False), (alike, False), (alike, True), (spread, True), (counted, True)
    ]:  # fmt: skip
        solution = rotavg.solve(graph, priors=priors, anisotropic=full)
        np.testing.assert_allclose(solution.rotations[1], expected, atol=1e-8)
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved"


def graph_with_priors(seed: int) -> tuple[rotavg.MeasurementGraph, rotavg.Priors, Array]:
    rng = np.random.default_rng(seed)
    graph, truth = simulated(rng, 9, 0.4, RATIOS[1 + seed % 3], 0.05)
    assert graph.covariances is not None
    size = 1 / np.trace(graph.covariances, axis1=1, axis2=2).mean()
    noise = matrices_from_rotvecs(0.05 * rng.normal(size=(9, 3)))
    known = truth @ noise
    priors = rotavg.Priors(
        absolute={2: (known[2], 2 * size)} if seed % 2 else {},
        gravity={k: (known[k].T @ DOWN, (1 + k) * size) for k in (0, 3, 4, 8)},
    )
    return graph, priors, truth


@pytest.mark.parametrize("seed", range(8))
def test_gravity_and_absolute_priors_are_solved_and_proved(seed: int) -> None:
    graph, priors, _ = graph_with_priors(seed)
    solution = rotavg.solve(graph, anisotropic=True, priors=priors)
    assert solution.certificate is not None
    f = objective(graph, solution.rotations, priors)
    assert solution.objective == pytest.approx(f, rel=1e-9)
    assert solution.certificate.verdict == "proved"
    again = rotavg.certify(graph, solution.rotations, priors=priors, anisotropic=True)
    assert again.verdict == "proved"
    rng = np.random.default_rng(seed)
    for k in range(40):  # nothing is lower than the bound says, be it near or far
        e = matrices_from_rotvecs(10 ** rng.uniform(-4, 0.3) * rng.normal(size=(9, 3)))
        R = e @ solution.rotations
        g = objective(graph, R, priors)
        assert g >= f - solution.certificate.gap - 1e-12 * f
        if k < 10:
            bound = rotavg.certify(graph, R, priors=priors, anisotropic=True)
            assert g - bound.gap <= f * (1 + 1e-9)
    for start in range(4):  # other descents end at the same optimum, or higher
        other = rotavg.solve(
            graph, anisotropic=True, priors=priors, init="random", seed=start, method="bcd"
        )
        assert other.objective >= f * (1 - 1e-6)


def test_priors_of_nodes_that_are_held_are_constants() -> None:
    graph, priors, truth = graph_with_priors(1)
    held = next(node for node in priors.gravity if node not in priors.absolute)
    both = rotavg.Priors(
        fixed={node: truth[node] for node in {0, held} - set(priors.absolute)},
        absolute=priors.absolute,
        gravity=priors.gravity,
    )
    solution = rotavg.solve(graph, anisotropic=True, priors=both)
    f = objective(graph, solution.rotations, both)
    assert solution.objective == pytest.approx(f, rel=1e-9)
    assert solution.trace.objective[-1] == pytest.approx(f, rel=1e-9)
    assert rotavg.diagnose(solution).node_costs.sum() == pytest.approx(f, rel=1e-9)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_heading_that_is_free_changes_nothing(seed: int) -> None:
    graph, priors, _ = graph_with_priors(seed)
    assert not priors.absolute
    solution = rotavg.solve(graph, anisotropic=True, priors=priors)
    assert "free" in str(solution)
    turned = matrices_from_rotvecs(1.1 * DOWN) @ solution.rotations
    assert objective(graph, turned, priors) == pytest.approx(solution.objective, rel=1e-9)
    certificate = rotavg.certify(graph, turned, priors=priors, anisotropic=True)
    assert certificate.verdict == "proved"
    tilted = matrices_from_rotvecs(np.array([0.3, 0, 0])) @ solution.rotations
    assert rotavg.certify(graph, tilted, priors=priors, anisotropic=True).verdict != "proved"


def test_parts_that_gravity_alone_holds() -> None:
    """Two parts and a node alone hang from one world; each has a heading of its own."""
    rng = np.random.default_rng(5)
    one, truth = simulated(rng, 7, 0.5, RATIOS[2], 0.05)
    assert one.covariances is not None
    edges = np.concatenate([one.indices, one.indices + 7])
    graph = rotavg.MeasurementGraph(
        edges,
        np.concatenate([one.rotations, one.rotations]),
        covariances=np.concatenate([one.covariances, one.covariances]),
        nodes=range(15),
    )
    known = np.concatenate([truth, truth, truth[:1]])
    down = {k: (known[k].T @ DOWN, 100.0) for k in (1, 3, 8, 10, 12, 14)}
    priors = rotavg.Priors(gravity=down)
    solution = rotavg.solve(graph, anisotropic=True, priors=priors)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    assert solution.objective == pytest.approx(
        objective(graph, solution.rotations, priors), rel=1e-9
    )
    covariances = solution.covariances()
    assert np.isfinite(covariances).all()


def test_rigs_hang_with_their_cameras() -> None:
    rng = np.random.default_rng(2)
    graph, truth = simulated(rng, 10, 0.6, RATIOS[2], 0.05)
    rig = matrices_from_rotvecs(rng.normal(size=(2, 3)))
    # Cameras 2 f and 2 f + 1 are those of frame f.
    moved = np.array([truth[k - k % 2] @ rig[0].T @ rig[k % 2] for k in range(10)])
    i, j = graph.indices.T
    noise = np.swapaxes(np.swapaxes(truth[i], 1, 2) @ truth[j], 1, 2) @ graph.rotations
    measured = np.swapaxes(moved[i], 1, 2) @ moved[j] @ noise
    graph = rotavg.MeasurementGraph(graph.edges, measured, covariances=graph.covariances)
    priors = rotavg.Priors(
        rigs={k: (k // 2, rig[k % 2]) for k in range(10)},
        gravity={k: (moved[k].T @ DOWN, 50.0) for k in (1, 4, 7)},
    )
    solution = rotavg.solve(graph, anisotropic=True, priors=priors)
    R = solution.rotations
    assert solution.objective == pytest.approx(objective(graph, R, priors), rel=1e-9)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    for f in range(5):
        np.testing.assert_allclose(R[2 * f].T @ R[2 * f + 1], rig[0].T @ rig[1], atol=1e-12)
    broken = R.copy()
    broken[3] = broken[3] @ matrices_from_rotvecs(np.array([0.01, 0, 0]))
    with pytest.raises(rotavg.GraphError, match="rig holds the node"):
        rotavg.certify(graph, broken, priors=priors, anisotropic=True)
    assert np.isfinite(solution.covariances()).all()


def numerical_covariances(graph: rotavg.MeasurementGraph, R: Array, priors: rotavg.Priors) -> Array:
    """(n, 3, 3) 2 H^-1 by second differences of the objective, the world held."""
    n, h = len(R), 1e-4

    def f(step: Array) -> float:
        return objective(graph, matrices_from_rotvecs(step.reshape(n, 3)) @ R, priors)

    hessian = np.empty((3 * n, 3 * n))
    unit = h * np.eye(3 * n)
    for a in range(3 * n):
        for b in range(a + 1):
            x, y = unit[a], unit[b]
            value = (f(x + y) - f(x - y) - f(y - x) + f(-x - y)) / (4 * h * h)
            hessian[a, b] = hessian[b, a] = value
    inverse = 2 * np.linalg.inv(hessian)
    return np.array([inverse[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(n)])


def test_covariances_are_those_of_the_hessian() -> None:
    rng = np.random.default_rng(11)
    graph, truth = simulated(rng, 6, 0.6, RATIOS[2], 0.01)
    assert graph.covariances is not None
    size = 3 / np.trace(graph.covariances, axis1=1, axis2=2).mean()
    priors = rotavg.Priors(
        absolute={2: (truth[2], 0.5 * size)},
        gravity={k: (truth[k].T @ DOWN, 3 * size) for k in (0, 5)},
    )
    solution = rotavg.solve(graph, anisotropic=True, priors=priors)
    found = solution.covariances(noise_variance=1.0)
    expected = numerical_covariances(graph, solution.rotations, priors)
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=0.02 * np.abs(expected).max())
    # The factor by which the covariances are off, from the residuals, is near one on average.
    factors = []
    for seed in range(30):
        graph, truth = simulated(np.random.default_rng(seed), 8, 0.6, RATIOS[1], 0.01)
        fixed = rotavg.Priors(fixed={0: truth[0]})
        found = rotavg.solve(graph, anisotropic=True, priors=fixed).covariances()
        one = rotavg.solve(graph, anisotropic=True, priors=fixed).covariances(noise_variance=1.0)
        factors.append(found[1, 0, 0] / one[1, 0, 0])
    assert np.mean(factors) == pytest.approx(1.0, abs=0.1)


def test_wrong_gravity_is_seen_through() -> None:
    rng = np.random.default_rng(7)
    graph, truth = simulated(rng, 30, 0.3, RATIOS[2], 0.01)
    down = truth.transpose(0, 2, 1) @ DOWN
    down[:7] = rng.normal(size=(7, 3))
    priors = rotavg.Priors(gravity={k: (down[k], 1e4) for k in range(30)})
    solution = rotavg.solve(graph, loss="auto", anisotropic=True, priors=priors)
    assert solution.robust is not None
    fit = solution.robust.gravity_priors
    assert fit is not None
    assert fit.nodes[fit.is_outlier].tolist() == list(range(7))
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    tilts = np.linalg.norm((solution.rotations @ down[..., None])[..., 0] - DOWN, axis=1)
    assert np.degrees(tilts[7:].max()) < 1.5
    # The objective is that of the final weights.
    weighted = rotavg.Priors(
        gravity={k: (down[k], w) for k, w in zip(fit.nodes.tolist(), fit.weights)}
    )
    held = rotavg.MeasurementGraph(
        graph.edges, graph.rotations,
        covariances=graph.covariances * (graph.weights / solution.edge_weights)[:, None, None],
    )  # fmt: skip
    assert solution.objective == pytest.approx(
        objective(held, solution.rotations, weighted), rel=1e-6
    )


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_scales_of_all_weights_change_nothing(scale: float) -> None:
    graph, priors, _ = graph_with_priors(1)
    assert graph.covariances is not None
    best = rotavg.solve(graph, anisotropic=True, priors=priors)
    scaled = rotavg.MeasurementGraph(
        graph.edges, graph.rotations, covariances=graph.covariances / scale
    )
    weighed = rotavg.Priors(
        absolute={k: (P, w * scale) for k, (P, w) in priors.absolute.items()},
        gravity={k: (d, w * scale) for k, (d, w) in priors.gravity.items()},
    )
    solution = rotavg.solve(scaled, anisotropic=True, priors=weighed)
    np.testing.assert_allclose(solution.rotations, best.rotations, atol=1e-7)
    assert solution.objective == pytest.approx(scale * best.objective, rel=1e-9)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"


@pytest.mark.parametrize("ratio", RATIOS[:3])
@pytest.mark.parametrize("noise", [0.0, 1e-12, 1e-10, 1e-8, 1e-6])
def test_rounding_keeps_no_optimum_from_being_proved(
    ratio: tuple[float, float, float], noise: float
) -> None:
    for seed in range(3):
        graph, _ = simulated(np.random.default_rng(seed), 12, 0.4, ratio, max(noise, 1e-3))
        if noise < 1e-3:
            exact, truth = simulated(np.random.default_rng(seed), 12, 0.4, ratio, 1e-3)
            i, j = exact.indices.T
            left = np.swapaxes(np.swapaxes(truth[i], 1, 2) @ truth[j], 1, 2) @ exact.rotations
            e = np.stack([left[:, 2, 1], left[:, 0, 2], left[:, 1, 0]], axis=1)
            assert exact.covariances is not None
            graph = rotavg.MeasurementGraph(
                exact.edges,
                np.swapaxes(truth[i], 1, 2) @ truth[j] @ matrices_from_rotvecs(e * noise / 1e-3),
                covariances=exact.covariances,
            )
        solution = rotavg.solve(graph, anisotropic=True)
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved", solution.certificate.relative_gap


def test_a_proof_from_a_random_start() -> None:
    for seed in range(3):
        graph, truth = simulated(np.random.default_rng(seed), 40, 0.3, RATIOS[seed + 1], 0.02)
        solution = rotavg.solve(graph, anisotropic=True)
        certificate = rotavg.certify(graph, solution.rotations, anisotropic=True, max_flops=0)
        assert certificate.method == "random_start"
        assert certificate.verdict == "proved"
        assert certificate.failure_probability == pytest.approx(1e-12)
        bare = rotavg.certify(
            graph, solution.rotations, anisotropic=True, max_flops=0, failure_probability=0
        )
        assert bare.verdict == "not_certified"
        # Never for what is not the optimum.
        rng = np.random.default_rng(seed)
        for angle in (1e-3, 0.1, 2.0):
            e = matrices_from_rotvecs(angle * rng.normal(size=truth.shape[:2]))
            far = rotavg.certify(
                graph, e @ solution.rotations, anisotropic=True, max_flops=0, seed=seed
            )
            assert far.verdict != "proved"
            best = solution.objective
            from_definition = objective(graph, e @ solution.rotations, rotavg.Priors())
            assert from_definition - far.gap <= best * (1 + 1e-9)


def test_sensors_that_are_not_known_are_found_first() -> None:
    rng = np.random.default_rng(4)
    rig = matrices_from_rotvecs(rng.normal(size=(2, 3)))
    rig[0] = np.eye(3)
    frames = matrices_from_rotvecs(rng.normal(size=(6, 3)))
    moved = np.array([frames[k // 2] @ rig[k % 2] for k in range(12)])
    graph, truth = simulated(rng, 12, 0.8, RATIOS[2], 0.01)
    i, j = graph.indices.T
    noise = np.swapaxes(np.swapaxes(truth[i], 1, 2) @ truth[j], 1, 2) @ graph.rotations
    measured = np.swapaxes(moved[i], 1, 2) @ moved[j] @ noise
    graph = rotavg.MeasurementGraph(graph.edges, measured, covariances=graph.covariances)
    images = {k: (k // 2, "lr"[k % 2]) for k in range(12)}
    rigs = rotavg.Rigs(images, {"l": np.eye(3)})
    solution = rotavg.solve(graph, priors=rotavg.Priors(rigs=rigs), anisotropic=True)
    assert solution.rigs is not None
    C = solution.rigs.rotation_of["r"]
    assert np.linalg.norm(C - rig[1]) < 0.05
    assert solution.rigs.lower_bound is None
    for k, (frame, sensor) in images.items():
        Q = solution.rigs.frames[frame]
        np.testing.assert_allclose(
            solution.rotations[k], Q @ (np.eye(3) if sensor == "l" else C), atol=1e-9
        )
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    held = rotavg.solve(graph, priors=solution.rigs.priors, anisotropic=True)
    assert held.objective == pytest.approx(solution.objective, rel=1e-9)


def test_what_nodes_add_makes_the_objective() -> None:
    for seed in range(4):
        graph, priors, _ = graph_with_priors(seed)
        for full in (False, True):
            solution = rotavg.solve(graph, priors=priors, anisotropic=full)
            told = rotavg.diagnose(solution)
            assert told.node_costs.sum() == pytest.approx(solution.objective, rel=1e-9)
    spread = rotavg.solve(simulated(np.random.default_rng(1), 9, 0.4, RATIOS[2], 0.05)[0],
                          anisotropic="log")  # fmt: skip
    assert rotavg.diagnose(spread).node_costs.sum() == pytest.approx(spread.objective, rel=1e-9)


def test_priors_that_contradict_one_another_count_with_what_is_left_of_them() -> None:
    rng = np.random.default_rng(3)
    truth = matrices_from_rotvecs(rng.normal(size=(6, 3)))
    edges = np.array([(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 4)])
    noise = matrices_from_rotvecs(0.02 * rng.normal(size=(7, 3)))
    R = np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]] @ noise
    graph = rotavg.MeasurementGraph(edges, R)
    wrong = truth[3] @ matrices_from_rotvecs(np.array([0, 0, 2.6]))
    directions = [d / np.linalg.norm(d) for d in rng.normal(size=(3, 3))]
    absolute = {0: (truth[0], 1.0), 3: (wrong, 4.0)}
    gravity = {k: (d, 3.0) for k, d in zip((1, 2, 4), directions)}
    priors = rotavg.Priors(absolute=absolute, gravity=gravity)
    solution = rotavg.solve(graph, priors=priors, loss="cauchy")
    robust = solution.robust
    assert robust is not None
    assert robust.absolute_priors is not None
    assert robust.gravity_priors is not None
    assert solution.verdict == "proved"
    assert not robust.absolute_priors.is_outlier.any()  # so few can be no outliers
    assert "0 of 2 priors are outliers, beyond 180 deg" in str(solution)
    left = rotavg.Priors(
        absolute={k: (absolute[k][0], w) for k, w in zip((0, 3), robust.absolute_priors.weights)},
        gravity={k: (gravity[k][0], w) for k, w in zip((1, 2, 4), robust.gravity_priors.weights)},
    )
    same = rotavg.solve(graph, priors=left)
    found = solution.covariances(noise_variance=1e-3)
    expected = same.covariances(noise_variance=1e-3)
    np.testing.assert_allclose(found, expected, atol=0.1 * expected.max())
    chords = 2 * np.sin(solution.residual_angles / 2)
    variance = float(chords @ chords) / (3 * (7 - 6 + 1))  # of the edges
    np.testing.assert_allclose(solution.covariances(), found * (variance / 1e-3), rtol=1e-6)
