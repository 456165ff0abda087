"""The staircase: from any start to the proved optimum, or to the bound of the relaxation."""

from __future__ import annotations

import numpy as np
import pytest

import rotavg
from shared_data import shared_data

STARTS = 20

NOISY = [
    ("sphere", 100, {}),
    ("grid", 100, {}),
    ("band", 80, {}),
    ("erdos_renyi", 60, {"density": 0.15}),
    ("erdos_renyi", 200, {"density": 0.03}),
]


@pytest.mark.parametrize("noise", [0.3, 0.5, 0.7, 1.0])
@pytest.mark.parametrize(("kind", "n", "settings"), NOISY)
def test_all_random_starts_end_at_the_same_answer(
    kind: str, n: int, settings: dict[str, float], noise: float
) -> None:
    graph = rotavg.simulate(kind, n, noise=noise, seed=n, **settings).graph  # type: ignore[arg-type]
    solutions = [rotavg.solve(graph, init="random", seed=seed) for seed in range(STARTS)]
    certificates = [s.certificate for s in solutions if s.certificate is not None]
    assert len(certificates) == STARTS
    lower = [s.objective - c.gap for s, c in zip(solutions, certificates)]
    best = min(s.objective for s in solutions)
    # No bound is above what another start has found.
    assert max(lower) <= best * (1 + 1e-9)
    if any(c.verdict == "proved" for c in certificates):
        assert [c.verdict for c in certificates] == ["proved"] * STARTS
        assert max(s.objective for s in solutions) <= best * (1 + 1e-8)
    else:  # the relaxation is not tight: one and the same bound from everywhere
        assert {c.method for c in certificates} == {"relaxation"}
        assert max(lower) - min(lower) <= 1e-8 * best
        assert all("relaxation" in s.reason for s in solutions)


@pytest.mark.parametrize(
    "name", ["tinyGrid3D", "smallGrid3D", "sphere2500", "torus3D", "parking-garage"]
)
def test_random_starts_on_trajectories_end_at_the_proved_optimum(name: str) -> None:
    graph = rotavg.read(shared_data(f"g2o/{name}.g2o"), unit_weights=True)
    optimum = rotavg.solve(graph)
    assert optimum.solved
    for seed in range(STARTS):
        solution = rotavg.solve(graph, init="random", seed=seed)
        assert solution.objective == pytest.approx(optimum.objective, rel=1e-8), seed
        assert solution.certificate is not None
        assert solution.certificate.verdict == "proved", seed


def test_the_method_staircase_says_where_it_went() -> None:
    graph = rotavg.simulate("grid", 100, noise=0.1, seed=3).graph
    expected = rotavg.solve(graph)
    solution = rotavg.solve(graph, method="staircase", init="random", seed=1)
    assert solution.method == "staircase"
    assert "rank 5" in solution.reason
    assert solution.solved
    assert solution.objective == pytest.approx(expected.objective, rel=1e-10)
    # The gauge is as everywhere.
    np.testing.assert_array_equal(solution.rotations[0], np.eye(3))
    np.testing.assert_allclose(solution.rotations, expected.rotations, atol=1e-6)


def test_where_the_relaxation_is_not_tight_the_solution_says_so() -> None:
    graph = rotavg.simulate("sphere", 100, noise=1.0, seed=0).graph
    solution = rotavg.solve(graph)
    assert not solution.solved
    assert solution.certificate is not None
    assert solution.certificate.method == "relaxation"
    assert 0 < solution.certificate.relative_gap < 0.1
    assert "relaxation" in str(solution)
    # A rank limit below the staircase leaves a worse bound.
    low = rotavg.solve(graph, max_rank=0)
    assert low.certificate is not None
    assert low.certificate.gap > 2 * solution.certificate.gap


def test_threads_leave_the_bits_as_they_are() -> None:
    # A band of many more edges than threads are used for, from a start that is refuted.
    graph = rotavg.simulate("band", 3000, noise=0.1, seed=0).graph
    assert graph.num_edges > 24576
    one = rotavg.solve(graph, init="random", seed=1, num_threads=1)
    assert one.method == "staircase"
    three = rotavg.solve(graph, init="random", seed=1, num_threads=3)
    assert one.rotations.tobytes() == three.rotations.tobytes()


def test_every_component_has_a_certificate() -> None:
    one = rotavg.simulate("sphere", 100, noise=1.0, seed=0).graph  # not tight
    edges = np.concatenate([one.edges, [[1000, 1001], [1001, 1002]]])
    rotations = np.concatenate([one.rotations, np.tile(np.eye(3), (2, 1, 1))])
    solution = rotavg.solve(rotavg.MeasurementGraph(edges, rotations))
    c = solution.certificate
    assert c is not None
    assert [part.verdict.value for part in c.components] == ["not_certified", "proved"]
    assert c.gap == pytest.approx(sum(part.gap for part in c.components))
    assert c.relative_gap == max(part.relative_gap for part in c.components)


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_the_relaxation_is_the_optimum_that_bcdsr_finds(seed: int) -> None:
    graph = rotavg.simulate("erdos_renyi", 30, density=0.12, noise=1.4, seed=seed).graph
    solution = rotavg.solve(graph)
    assert solution.certificate is not None
    lower = solution.objective - solution.certificate.gap
    relaxed = rotavg.solve(graph, method="bcdsr", max_iterations=20000, tolerance=1e-10)
    assert relaxed.status.converged
    assert lower == pytest.approx(relaxed.trace.objective[-1], rel=1e-6)
