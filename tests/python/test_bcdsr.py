"""BCDSR against a literal version of its algorithm, and against the other solvers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import sqrtm

import rotavg


def literal_bcdsr(
    graph: rotavg.MeasurementGraph, start: NDArray[np.float64], sweeps: int
) -> tuple[NDArray[np.float64], list[float]]:
    """Y after some sweeps, and the objectives 6 sum w - tr(Rt Y), by the formulas as printed."""
    n = graph.num_nodes
    Rt = np.zeros((3 * n, 3 * n))
    for (i, j), R_ij, w in zip(graph.indices, graph.rotations, graph.weights):
        Rt[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += w * R_ij
        Rt[3 * j : 3 * j + 3, 3 * i : 3 * i + 3] += w * R_ij.T
    R = np.hstack(list(start))
    Y = (np.eye(3 * n) + R.T @ R) / 2
    objectives = [6 * graph.weights.sum() - np.trace(Rt @ Y)]
    for _ in range(sweeps):
        for k in range(n):
            own = np.arange(3 * k, 3 * k + 3)
            rest = np.delete(np.arange(3 * n), own)
            B, W = Y[np.ix_(rest, rest)], Rt[np.ix_(rest, own)]
            S = B @ W @ np.linalg.pinv(np.real(sqrtm(W.T @ B @ W)))
            Y[np.ix_(rest, own)], Y[np.ix_(own, rest)] = S, S.T
        objectives.append(6 * graph.weights.sum() - np.trace(Rt @ Y))
    return Y, objectives


def nearest_rotations(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    U, _, Vt = np.linalg.svd(blocks)
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    return U @ Vt


@pytest.mark.parametrize("kind", ["complete", "cycle", "sphere"])
@pytest.mark.parametrize("init", ["shortest_path", "random"])
def test_it_does_what_the_formulas_say(kind: str, init: str) -> None:
    graph = rotavg.simulate(kind, 12, noise=0.4, seed=3).graph
    graph = graph.with_weights(np.random.default_rng(4).uniform(0.5, 2, graph.num_edges))
    start = rotavg.solve(graph, init=init, seed=5, max_iterations=0).rotations
    solution = rotavg.solve(graph, method="bcdsr", init=start, max_iterations=4, certify=False)
    Y, objectives = literal_bcdsr(graph, start, sweeps=4)
    np.testing.assert_allclose(solution.trace.objective, objectives, rtol=1e-9)
    first_row = np.stack(np.split(Y[:3], 12, axis=1))
    np.testing.assert_allclose(solution.rotations, nearest_rotations(first_row), atol=1e-8)
    assert solution.objective == pytest.approx(rotavg.objective(graph, solution.rotations))


@pytest.mark.parametrize("noise", [0.2, 0.5])
@pytest.mark.parametrize("drop", [0.0, 0.3])
def test_it_finds_the_optimum_of_the_papers_graphs(noise: float, drop: float) -> None:
    graph = rotavg.simulate("complete", 20, noise=noise, drop=drop, seed=7).graph
    solution = rotavg.solve(graph, method="bcdsr")
    optimum = rotavg.solve(graph, method="bcd")
    assert solution.solved
    assert solution.method == "bcdsr"
    assert solution.objective == pytest.approx(optimum.objective, rel=1e-9)
    assert solution.trace.objective[-1] == pytest.approx(optimum.objective, rel=1e-9)
    np.testing.assert_allclose(solution.rotations, optimum.rotations, atol=1e-7)


def test_the_objective_of_the_relaxation_never_rises() -> None:
    graph = rotavg.simulate("cycle", 30, noise=0.1, seed=1).graph
    for init in ("shortest_path", "random"):
        solution = rotavg.solve(graph, method="bcdsr", init=init, max_iterations=50, certify=False)
        assert (np.diff(solution.trace.objective) <= 1e-12).all()


def test_the_papers_rule_stops_it_earlier() -> None:
    graph = rotavg.simulate("complete", 20, noise=0.5, seed=1).graph
    solution = rotavg.solve(graph, method="bcdsr", stop="step", tolerance=1e-4)
    assert solution.status is rotavg.Status.STEP_CONVERGED
    assert solution.trace.step[-1] < 1e-4 <= solution.trace.step[-2]


def test_no_noise_is_solved_by_the_shortest_paths() -> None:
    graph = rotavg.simulate("sphere", 30, seed=1).graph
    solution = rotavg.solve(graph, method="bcdsr")
    assert solution.iterations == 0
    assert solution.objective < 1e-20


def test_what_does_not_fit_in_memory_is_refused() -> None:
    graph = rotavg.simulate("cycle", 200_000, seed=1).graph
    with pytest.raises(rotavg.SolverError, match=r"200000 nodes is a dense matrix of 2\.88e"):
        rotavg.solve(graph, method="bcdsr")
