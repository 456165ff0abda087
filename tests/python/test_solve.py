"""The optimum, how it is reached, and what is said of it."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

import rotavg
from rotavg.solving.solve import Init

PAPER_SETTINGS = [(phi, p) for phi in (0.2, 0.5) for p in (0.0, 0.3)]


def test_noiseless_graphs_are_solved_by_the_shortest_path_start() -> None:
    for kind, n in [("complete", 30), ("cycle", 50), ("grid", 60), ("sphere", 200), ("band", 80)]:
        graph = rotavg.simulate(kind, n, seed=3).graph
        solution = rotavg.solve(graph)
        assert solution.iterations == 0, kind
        assert solution.objective < 1e-20 * graph.num_edges, kind
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved", kind


@pytest.mark.parametrize("init", sorted({*get_args(Init)} - {"auto", "random"}))
def test_an_initial_value_is_exact_without_noise_and_leads_to_the_optimum_with(init: str) -> None:
    for kind in ("complete", "cycle", "grid", "sphere", "band"):
        exact = rotavg.solve(rotavg.simulate(kind, 60, seed=3).graph, init=init, max_iterations=0)  # type: ignore[arg-type]
        assert exact.init == init
        assert exact.solved, kind
        graph = rotavg.simulate(kind, 60, noise=0.1, seed=3).graph
        solution = rotavg.solve(graph, init=init)  # type: ignore[arg-type]
        assert solution.init == init
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved", kind


def test_the_spanning_tree_keeps_outliers_out() -> None:
    s = rotavg.simulate("erdos_renyi", 200, density=0.2, noise=0.03, outliers=0.3, seed=7)
    worst = {}
    for init in ("shortest_path", "spanning_tree"):
        R = rotavg.solve(s.graph, init=init, max_iterations=0, certify=False).rotations  # type: ignore[arg-type]
        error = np.swapaxes(s.ground_truth[:1], 1, 2) @ s.ground_truth - R
        worst[init] = np.linalg.norm(error, axis=(1, 2)).max()
    assert worst["spanning_tree"] < 0.5
    assert worst["shortest_path"] > 2


@pytest.mark.parametrize(("phi", "p"), PAPER_SETTINGS)
def test_bcd_and_sum_end_at_the_same_certified_objective_over_100_seeds(
    phi: float, p: float
) -> None:
    for seed in range(100):
        graph = rotavg.simulate("complete", 20, noise=phi, drop=p, seed=seed).graph
        bcd = rotavg.solve(graph, method="bcd")
        sum_ = rotavg.solve(graph, method="sum")
        newton = rotavg.solve(graph, method="newton")
        assert bcd.objective == pytest.approx(sum_.objective, rel=1e-9), seed
        assert bcd.objective == pytest.approx(newton.objective, rel=1e-9), seed
        for solution in (bcd, sum_, newton):
            assert solution.status.converged, seed
            assert solution.certificate is not None
            assert solution.certificate.verdict == "proved", seed
            assert abs(solution.certificate.lambda_min) < 1e-12 * 20, seed


@pytest.mark.parametrize(("phi", "p"), PAPER_SETTINGS)
@pytest.mark.parametrize("mu", ["adaptive", "min_eigenvalue"])
def test_the_paper_at_n_200(phi: float, p: float, mu: str) -> None:
    graph = rotavg.simulate("complete", 200, noise=phi, drop=p, seed=17).graph
    bcd = rotavg.solve(graph, method="bcd")
    sum_ = rotavg.solve(graph, method="sum", mu=mu)  # type: ignore[arg-type]
    assert bcd.objective == pytest.approx(sum_.objective, rel=1e-9)
    assert bcd.certificate is not None
    assert bcd.certificate.verdict == "proved"


def test_the_mean_residual_is_that_of_the_noise() -> None:
    # Noise of a random axis and an angle ~ N(0, phi^2) leaves a mean unsquared chordal residual of
    # E 2 sqrt(2) |sin(angle / 2)|; on a complete graph of 300 the fit takes only O(1/n) of it away.
    phi = 0.5
    graph = rotavg.simulate("complete", 300, noise=phi, seed=5).graph
    residuals = 2 * np.sqrt(2) * np.sin(rotavg.solve(graph).residual_angles / 2)
    angles = np.linspace(-6, 6, 20001) * phi
    density = np.exp(-0.5 * (angles / phi) ** 2)
    expected = (2 * np.sqrt(2) * np.abs(np.sin(angles / 2)) * density).sum() / density.sum()
    assert residuals.mean() == pytest.approx(expected, rel=0.01)


def test_the_solution_agrees_with_scipy_minimising_the_same_objective() -> None:
    optimize = pytest.importorskip("scipy.optimize")
    transform = pytest.importorskip("scipy.spatial.transform")
    simulation = rotavg.simulate("complete", 6, noise=0.4, seed=2)
    graph = simulation.graph

    def objective(rotvecs: np.ndarray) -> float:
        R = transform.Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix()
        residual = R[graph.indices[:, 0]] @ graph.rotations - R[graph.indices[:, 1]]
        return float((graph.weights * (residual**2).sum(axis=(1, 2))).sum())

    truth = transform.Rotation.from_matrix(simulation.ground_truth).as_rotvec()
    best = optimize.minimize(objective, truth.ravel(), method="BFGS", options={"gtol": 1e-10})
    assert rotavg.solve(graph).objective == pytest.approx(best.fun, rel=1e-9)


def test_everything_returned_is_evaluated_at_the_returned_rotations() -> None:
    graph = rotavg.simulate("sphere", 300, noise=0.1, seed=1).graph
    for iterations in (0, 3, 10):
        s = rotavg.solve(graph, method="bcd", max_iterations=iterations)
        assert s.status is rotavg.Status.ITERATION_LIMIT
        assert s.iterations == iterations
        assert len(s.trace) == iterations + 1
        R = s.rotations
        residual = R[graph.indices[:, 0]] @ graph.rotations - R[graph.indices[:, 1]]
        assert s.objective == pytest.approx((residual**2).sum(), rel=1e-12)
        assert s.objective == s.trace.objective[-1]
        g = rotavg.gradient(graph, R)
        assert s.gradient_norm == pytest.approx(np.linalg.norm(g), rel=1e-9)
        angle = np.arccos(np.clip(1 - (residual**2).sum(axis=(1, 2)) / 4, -1, 1))
        np.testing.assert_allclose(s.residual_angles, angle, atol=1e-7)


def test_the_gradient_is_the_derivative_of_the_objective() -> None:
    simulation = rotavg.simulate("complete", 5, noise=0.5, seed=8)
    graph, R = simulation.graph, simulation.ground_truth
    transform = pytest.importorskip("scipy.spatial.transform")
    g = rotavg.gradient(graph, R)
    h = 1e-5
    for i in range(5):
        for axis in np.eye(3):
            moved = [R.copy(), R.copy()]
            for sign, copy in zip((1, -1), moved):
                turn = transform.Rotation.from_rotvec(sign * h * axis).as_matrix()
                copy[i] = turn @ copy[i]
            slope = (rotavg.objective(graph, moved[0]) - rotavg.objective(graph, moved[1])) / (
                2 * h
            )
            assert g[i] @ axis == pytest.approx(slope, abs=1e-7)


def test_the_first_node_of_every_component_holds_the_gauge() -> None:
    one = rotavg.simulate("complete", 8, noise=0.2, seed=1).graph
    two = rotavg.simulate("cycle", 5, noise=0.2, seed=2).graph
    graph = rotavg.MeasurementGraph(
        np.vstack([one.edges + 100, two.edges]),
        np.concatenate([one.rotations, two.rotations]),
        nodes=[999, *range(104, 108), *range(5), *range(100, 104)],
    )
    solution = rotavg.solve(graph)
    assert solution.num_components == 3
    np.testing.assert_array_equal(solution.component, [0] + [1] * 4 + [2] * 5 + [1] * 4)
    for row in (0, 1, 5):
        np.testing.assert_array_equal(solution.rotations[row], np.eye(3))
    alone = [rotavg.solve(g) for g in (one, two)]
    assert solution.objective == pytest.approx(sum(s.objective for s in alone), rel=1e-9)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"


def test_weights_count() -> None:
    # Two contradicting measurements of one rotation: the answer lies between, nearer the heavier.
    turn = rotavg.MeasurementGraph.from_rotvecs(
        [(0, 1), (0, 1)], [[0, 0, 0.2], [0, 0, -0.2]], weights=[3.0, 1.0]
    )
    w = np.arctan2(*rotavg.solve(turn).rotations[1][[1, 0], 0])
    # 3 sin(0.2 - w) = sin(0.2 + w)
    assert w == pytest.approx(np.arctan2(2 * np.sin(0.2), 4 * np.cos(0.2)), abs=1e-9)


def test_scaling_all_weights_changes_nothing_but_the_objective() -> None:
    graph = rotavg.simulate("grid", 60, noise=0.3, seed=4).graph
    a = rotavg.solve(graph)
    for scale in (1e-90, 1e90):
        b = rotavg.solve(graph.with_weights(scale * graph.weights))
        assert b.iterations == a.iterations
        np.testing.assert_allclose(a.rotations, b.rotations, atol=1e-12)
        assert b.objective == pytest.approx(scale * a.objective, rel=1e-12)
        assert b.certificate is not None
        assert b.certificate.verdict == "proved"


def test_parallel_edges_add_up() -> None:
    graph = rotavg.simulate("complete", 10, noise=0.3, seed=6).graph
    doubled = rotavg.MeasurementGraph(
        np.vstack([graph.edges, graph.edges[:, ::-1]]),
        np.concatenate([graph.rotations, np.swapaxes(graph.rotations, 1, 2)]),
    )
    a, b = rotavg.solve(graph), rotavg.solve(doubled)
    assert b.objective == pytest.approx(2 * a.objective, rel=1e-12)
    np.testing.assert_allclose(a.rotations, b.rotations, atol=1e-7)


@pytest.mark.parametrize("method", ["bcd", "sum"])
def test_acceleration_saves_most_iterations_and_keeps_the_rest(method: str) -> None:
    graph = rotavg.simulate("sphere", 900, noise=0.1, seed=1).graph
    plain = rotavg.solve(graph, method=method)  # type: ignore[arg-type]
    fast = rotavg.solve(graph, method=method, accelerate=True)  # type: ignore[arg-type]
    sweeps = 2 if method == "bcd" else 1
    assert 6 * sweeps * fast.iterations < plain.iterations
    assert fast.method == method
    assert fast.objective == pytest.approx(plain.objective, rel=1e-9)
    assert fast.certificate is not None
    assert fast.certificate.verdict == "proved"
    assert np.all(np.diff(fast.trace.objective) <= 1e-13 * fast.objective)
    for threads in (1, 3):
        again = rotavg.solve(graph, method=method, accelerate=True, num_threads=threads)  # type: ignore[arg-type]
        assert again.rotations.tobytes() == fast.rotations.tobytes()
        assert again.trace.step.tobytes() == fast.trace.step.tobytes()
    paper = rotavg.solve(graph, method=method, accelerate=True, stop="step", tolerance=1e-6)  # type: ignore[arg-type]
    assert paper.status is rotavg.Status.STEP_CONVERGED
    assert paper.trace.step[-1] < 1e-6 <= paper.trace.step[1:-1].min()


def test_a_warm_start_at_the_optimum_has_nothing_to_do() -> None:
    graph = rotavg.simulate("complete", 30, noise=0.3, seed=1).graph
    solution = rotavg.solve(graph)
    again = rotavg.solve(graph, init=solution.rotations)
    assert again.iterations == 0
    assert again.init == "given"


def test_the_printed_solution_says_what_a_user_asks_first() -> None:
    text = str(rotavg.solve(rotavg.simulate("complete", 12, noise=0.1, seed=1).graph))
    for phrase in ("Solved 12 rotations", "proved globally optimal", "objective", "median"):
        assert phrase in text


def test_auto_takes_newton_on_trajectories_and_sweeps_on_dense_graphs() -> None:
    sparse = rotavg.solve(rotavg.simulate("sphere", 900, noise=0.1, seed=1).graph)
    assert sparse.reason.startswith("newton from coarser graphs: average degree 3.9")
    assert sparse.method == "newton"
    assert sparse.init == "multilevel"
    assert sparse.iterations < 10
    assert sparse.reason in str(sparse)
    dense = rotavg.solve(rotavg.simulate("complete", 100, noise=0.2, seed=1).graph)
    assert dense.reason.startswith("sum: average degree 99")
    assert dense.method == "sum"
    assert dense.iterations < 20


def test_auto_leaves_sweeps_that_prove_slow_and_its_trace_is_one() -> None:
    # A band of 14 neighbours to each side: average degree 28, but a long way from end to end.
    n, reach = 600, 14
    edges = [(i, j) for i in range(n) for j in range(i + 1, min(i + reach + 1, n))]
    rng = np.random.default_rng(1)
    rotvecs = 0.2 * rng.standard_normal((len(edges), 3))
    graph = rotavg.MeasurementGraph.from_rotvecs(edges, rotvecs)
    seen: list[rotavg.Progress] = []
    solution = rotavg.solve(graph, init="shortest_path", callback=seen.append)
    assert "newton after" in solution.reason
    assert solution.status.converged
    assert [p.iteration for p in seen] == list(range(solution.iterations + 1))
    assert [p.objective for p in seen] == solution.trace.objective.tolist()
    assert np.all(np.diff(solution.trace.seconds) >= 0)
    assert np.all(np.diff(solution.trace.objective) <= 1e-12 * solution.objective)
    assert solution.objective == pytest.approx(
        rotavg.solve(graph, method="bcd").objective, rel=1e-9
    )


def test_newton_from_random_rotations_never_rises_and_ends_stationary() -> None:
    graph = rotavg.simulate("grid", 125, noise=0.3, seed=4).graph
    for seed in range(10):
        solution = rotavg.solve(graph, method="newton", init="random", seed=seed)
        assert solution.status.converged, seed
        assert np.all(np.diff(solution.trace.objective) <= 1e-12 * solution.objective), seed


def test_a_rotation_is_found_by_the_id_of_its_node() -> None:
    graph = rotavg.MeasurementGraph.from_rotvecs([("b", "a"), ("c", "a")], [[0, 0, 1], [1, 0, 0]])
    solution = rotavg.solve(graph)
    np.testing.assert_array_equal(solution["c"], solution.rotations[2])
    np.testing.assert_allclose(solution["c"] @ graph.rotations[1], solution["a"], atol=1e-12)
    with pytest.raises(rotavg.GraphError, match="node 'd' is not in the graph"):
        solution["d"]
    with pytest.raises(rotavg.GraphError, match=r"node \['a'\] is not in the graph"):
        solution[["a"]]  # type: ignore[index]


def test_a_refuted_answer_gets_a_second_run_from_the_chordal_start() -> None:
    # So noisy that the tree leads into a local minimum.
    graph = rotavg.simulate("band", 1000, noise=0.8, seed=1).graph
    tree = rotavg.solve(graph, init="shortest_path", max_rank=0)  # without the staircase
    assert tree.status.converged
    assert not tree.solved
    best = rotavg.solve(graph)
    assert best.reason.endswith("a second run, from the chordal start, did better")
    assert best.init == "chordal"
    assert best.solved
    assert best.objective < 0.99 * tree.objective
    assert tree.objective - tree.certificate.gap <= best.objective  # type: ignore[union-attr]


def test_where_newtons_method_wanders_it_begins_anew_at_the_chordal_value() -> None:
    graph = rotavg.simulate("grid", 125, noise=1.0, seed=23).graph  # paths are short
    tree = rotavg.solve(graph, init="shortest_path", max_rank=0)  # a local minimum
    chordal = rotavg.solve(graph, init="chordal", max_rank=0)
    iterations: list[int] = []
    best = rotavg.solve(graph, certify=False, callback=lambda p: iterations.append(p.iteration))
    assert best.reason.startswith("newton wandered, and began anew: newton after 3 sweeps")
    assert best.init == "chordal"
    assert iterations == list(range(best.iterations + 1))
    assert best.iterations < tree.iterations
    assert best.objective == pytest.approx(chordal.objective, rel=1e-12)
    assert best.objective < 0.9 * tree.objective
    stopped = rotavg.solve(graph, max_iterations=9)
    assert (stopped.iterations, stopped.status) == (9, rotavg.Status.ITERATION_LIMIT)
