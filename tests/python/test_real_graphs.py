"""Published pose graphs, where they are at hand."""

from __future__ import annotations

import numpy as np
import pytest

import rotavg
from shared_data import shared_data

# Optimal objectives with unit weights, from independent solvers.
OPTIMA = {
    "smallGrid3D": 38.7980858143,
    "sphere2500": 8.865715229,
    "torus3D": 60.9419314172,
}
PARKING_GARAGE = 0.00258367794822


@pytest.mark.parametrize(("name", "optimum"), [*OPTIMA.items(), ("parking-garage", PARKING_GARAGE)])
def test_auto_reaches_the_proved_optimum_for_any_number_of_threads(
    name: str, optimum: float
) -> None:
    graph = rotavg.read(shared_data(f"g2o/{name}.g2o"), unit_weights=True)
    solution = rotavg.solve(graph)
    assert solution.objective == pytest.approx(optimum, rel=1e-9)
    assert solution.relative_gradient < 1e-9
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    for threads in (1, 3):
        again = rotavg.solve(graph, num_threads=threads, certify=False)
        assert again.rotations.tobytes() == solution.rotations.tobytes()


@pytest.mark.parametrize("name", OPTIMA)
def test_bcd_reaches_the_proved_optimum(name: str) -> None:
    graph = rotavg.read(shared_data(f"g2o/{name}.g2o"), unit_weights=True)
    solution = rotavg.solve(graph, method="bcd")
    assert solution.objective == pytest.approx(OPTIMA[name], rel=1e-8)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"
    threaded = rotavg.solve(graph, method="bcd", num_threads=3, certify=False)
    assert threaded.rotations.tobytes() == solution.rotations.tobytes()


def test_sum_reaches_the_same_optimum() -> None:
    graph = rotavg.read(shared_data("g2o/smallGrid3D.g2o"), unit_weights=True)
    for mu in ("adaptive", "min_eigenvalue"):
        solution = rotavg.solve(graph, method="sum", mu=mu)  # type: ignore[arg-type]
        assert solution.objective == pytest.approx(OPTIMA["smallGrid3D"], rel=1e-8)
        assert np.all(np.diff(solution.trace.objective) <= 1e-13 * solution.objective)


@pytest.mark.parametrize("method", ["bcd", "sum"])
@pytest.mark.parametrize(("name", "optimum"), [*OPTIMA.items(), ("parking-garage", PARKING_GARAGE)])
def test_acceleration_reaches_the_proved_optimum_in_hundreds_of_iterations(
    name: str, optimum: float, method: str
) -> None:
    graph = rotavg.read(shared_data(f"g2o/{name}.g2o"), unit_weights=True)
    solution = rotavg.solve(graph, method=method, accelerate=True, max_iterations=600)  # type: ignore[arg-type]
    assert solution.status is rotavg.Status.GRADIENT_CONVERGED
    assert solution.objective == pytest.approx(optimum, rel=1e-9)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"


def test_bcd_says_honestly_that_it_stopped_early_on_a_long_trajectory() -> None:
    graph = rotavg.read(shared_data("g2o/parking-garage.g2o"), unit_weights=True)
    solution = rotavg.solve(graph, method="bcd", max_iterations=2000)
    assert solution.status is rotavg.Status.ITERATION_LIMIT
    assert solution.certificate is not None
    assert solution.certificate.verdict == "not_certified"
    # What is left to gain is known all the same.
    excess = solution.objective - PARKING_GARAGE
    assert 0 < excess <= solution.certificate.gap < 3 * excess


def test_weights_from_the_information_matrix_give_another_proved_optimum() -> None:
    graph = rotavg.read(shared_data("g2o/smallGrid3D.g2o"))
    assert graph.weights.min() > 1
    solution = rotavg.solve(graph)
    assert solution.certificate is not None
    assert solution.certificate.verdict == "proved"


def test_ellis_island_is_solved_as_one_component() -> None:
    graph = rotavg.read(shared_data("ellis_island/ellis_island.npz"))
    solution = rotavg.solve(graph)
    assert solution.graph.num_edges == 20297
    assert solution.status.converged


def test_the_spanning_tree_of_ellis_island_is_nearer_the_truth_than_the_shortest_paths() -> None:
    path = shared_data("ellis_island/ellis_island.npz")
    graph = rotavg.read(path)
    with np.load(path) as file:
        known, truth = file["has_ground_truth"], file["ground_truth"]
    error = {}
    for init in ("shortest_path", "spanning_tree"):
        R = rotavg.solve(graph, init=init, max_iterations=0, certify=False).rotations  # type: ignore[arg-type]
        # Up to a rotation from the left: the one at the node where that leaves the least.
        left = truth[known] @ np.swapaxes(R[known], 1, 2)
        distance = np.linalg.norm(left[:, None] @ R[known] - truth[known], axis=(2, 3))
        error[init] = np.median(distance, axis=1).min()
    assert error["spanning_tree"] < 0.25 * error["shortest_path"]
