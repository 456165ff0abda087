"""How solve is steered: threads, callbacks, limits, and options that it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg


@pytest.mark.parametrize("method", ["auto", "bcd", "sum", "newton"])
@pytest.mark.parametrize(
    "init", ["shortest_path", "spanning_tree", "chordal", "quaternion", "random"]
)
def test_same_input_same_bits_for_any_number_of_threads(method: str, init: str) -> None:
    graph = rotavg.simulate("complete", 230, noise=0.3, seed=9).graph  # 26335 edges: 3 threads
    first = rotavg.solve(graph, method=method, init=init, num_threads=1)  # type: ignore[arg-type]
    for threads in (2, 3, 5):
        again = rotavg.solve(graph, method=method, init=init, num_threads=threads)  # type: ignore[arg-type]
        assert first.rotations.tobytes() == again.rotations.tobytes()
        assert first.trace.objective.tobytes() == again.trace.objective.tobytes()
        assert first.certificate == again.certificate


@pytest.mark.parametrize(
    ("kind", "n", "density"),
    [("sphere", 9000, 0.1), ("erdos_renyi", 2500, 0.009), ("band", 4000, 0.1), ("grid", 3000, 0.1)],
)
def test_sparse_graphs_have_the_same_bits_for_any_number_of_threads(
    kind: str, n: int, density: float
) -> None:
    graph = rotavg.simulate(kind, n, density=density, noise=0.05, seed=3).graph
    first = rotavg.solve(graph, num_threads=1)
    assert first.certificate is not None
    assert first.certificate.verdict == "proved"
    proof = rotavg.certify(graph, first.rotations, num_threads=1)
    for threads in (2, 3, 8):
        again = rotavg.solve(graph, num_threads=threads)
        assert first.rotations.tobytes() == again.rotations.tobytes()
        assert first.certificate == again.certificate
        assert rotavg.certify(graph, first.rotations, num_threads=threads) == proof


def test_a_callback_sees_every_iteration_and_can_stop() -> None:
    graph = rotavg.simulate("sphere", 400, noise=0.1, seed=1).graph
    seen: list[rotavg.Progress] = []

    def stop_after_five(progress: rotavg.Progress) -> bool:
        seen.append(progress)
        return progress.iteration < 5

    solution = rotavg.solve(graph, method="bcd", callback=stop_after_five)
    assert [p.iteration for p in seen] == list(range(6))
    assert solution.status is rotavg.Status.STOPPED
    assert not solution.solved
    assert solution.certificate is not None  # what is left to gain is known all the same
    assert [p.objective for p in seen] == solution.trace.objective.tolist()
    assert "iteration=5" in repr(seen[-1])


def test_once_a_callback_has_said_no_it_is_not_called_again() -> None:
    graph = rotavg.simulate("erdos_renyi", 30, density=0.3, noise=0.1, outliers=0.2, seed=1).graph
    covariances = np.tile(np.diag([1e-4, 1e-4, 25e-4]), (graph.num_edges, 1, 1))
    full = rotavg.MeasurementGraph(graph.edges, graph.rotations, covariances=covariances)
    priors = rotavg.Priors(gravity={node: ([0.0, 1.0, 0.0], 1.0) for node in range(0, 30, 3)})
    calls: list[tuple[rotavg.MeasurementGraph, dict[str, Any]]] = [
        (graph, {}),
        (graph, {"priors": priors}),
        (graph, {"loss": "auto", "priors": priors}),
        (full, {"anisotropic": True}),
        (full, {"anisotropic": "log"}),
        (full, {"anisotropic": "log", "loss": "auto", "priors": priors}),
    ]

    def calls_until(stop: int, given: rotavg.MeasurementGraph, options: dict[str, Any]) -> int:
        told: list[int] = []

        def callback(progress: rotavg.Progress) -> bool:
            told.append(progress.iteration)
            return len(told) != stop

        solution = rotavg.solve(given, callback=callback, **options)
        if len(told) >= stop and solution.verdict != "proved":
            assert solution.status is rotavg.Status.STOPPED
        return len(told)

    for given, options in calls:
        all_calls = calls_until(10**9, given, options)
        for stop in range(1, all_calls, max(1, all_calls // 12)):
            assert calls_until(stop, given, options) == stop, options


def test_an_error_in_a_callback_reaches_the_caller() -> None:
    graph = rotavg.simulate("cycle", 10, noise=0.1, seed=1).graph

    for mine in (LookupError, ValueError, KeyboardInterrupt):

        def fail(progress: rotavg.Progress, error: type[BaseException] = mine) -> None:
            raise error("mine")

        with pytest.raises(mine, match="mine") as caught:
            rotavg.solve(graph, callback=fail)
        assert caught.type is mine


def test_limits_are_a_status_not_an_error() -> None:
    graph = rotavg.simulate("sphere", 900, noise=0.1, seed=1).graph
    slow = rotavg.solve(graph, time_limit=0.0)
    assert slow.status is rotavg.Status.TIME_LIMIT
    assert slow.certificate is not None
    assert slow.certificate.verdict == "not_certified"
    assert slow.certificate.method == "none"
    assert "stopped early" in str(slow)
    assert not slow.solved


def test_the_paper_rule_stops_earlier_on_a_badly_conditioned_graph() -> None:
    graph = rotavg.simulate("sphere", 900, noise=0.1, seed=1).graph
    paper = rotavg.solve(graph, method="sum", stop="step", tolerance=1e-4)
    assert paper.status is rotavg.Status.STEP_CONVERGED
    assert paper.trace.step[-1] < 1e-4
    assert paper.objective > 1.0001 * rotavg.solve(graph).objective


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, r"unknown method 'magic'; expected one of: auto, bcd, sum, newton"),
        ({"init": "magic"}, "unknown init 'magic'"),
        ({"stop": "never"}, "unknown stop 'never'"),
        ({"mu": "large"}, "unknown mu 'large'"),
        ({"method": None}, "method is None; expected a word"),
        ({"loss": None}, "loss is None; expected a word"),
        ({"loss": np.exp}, r"loss is a function; expected the name of a loss \(one of your own"),
        ({"stop": 1}, "stop is 1; expected a word"),
        ({"mu": 0.5}, "mu is 0.5; expected a word"),
        ({"callback": 3}, "callback is 3; expected a function or None"),
        ({"tolerance": -1.0}, "tolerance is -1.0"),
        ({"tolerance": float("nan")}, "tolerance is nan"),
        ({"max_iterations": 2.5}, "max_iterations is 2.5"),
        ({"max_iterations": -1}, "max_iterations is -1"),
        ({"num_threads": 0}, "num_threads is 0"),
        ({"time_limit": -3}, "time_limit is -3"),
        ({"seed": -1}, "seed is -1"),
        ({"certificate_tolerance": "small"}, "certificate_tolerance is 'small'"),
    ],
)
def test_options_that_do_not_exist_are_named(options: dict[str, object], message: str) -> None:
    graph = rotavg.simulate("cycle", 5).graph
    with pytest.raises(rotavg.OptionError, match=message):
        rotavg.solve(graph, **options)  # type: ignore[arg-type]


def test_initial_rotations_are_checked() -> None:
    graph = rotavg.simulate("cycle", 5).graph
    R = np.tile(np.eye(3), (5, 1, 1))
    with pytest.raises(rotavg.GraphError, match=r"init has shape \(4, 3, 3\)"):
        rotavg.solve(graph, init=R[:4])
    R[3, 0, 0] = -1
    with pytest.raises(rotavg.GraphError, match=r"node 3 is not a rotation.*determinant is -1"):
        rotavg.solve(graph, init=R)
    R[3, 0, 0] = np.nan
    with pytest.raises(rotavg.GraphError, match="node 3"):
        rotavg.solve(graph, init=R)


def test_what_is_no_graph_is_refused(tmp_path: Path) -> None:
    simulation = rotavg.simulate("cycle", 5)
    for call in (
        lambda: rotavg.solve("graph.g2o"),  # type: ignore[arg-type]
        lambda: rotavg.certify(simulation, simulation.ground_truth),  # type: ignore[arg-type]
        lambda: rotavg.write(tmp_path / "x.g2o", simulation),  # type: ignore[arg-type]
    ):
        with pytest.raises(rotavg.Error, match="expected a MeasurementGraph"):
            call()
    with pytest.raises(AttributeError, match="cannot be changed"):
        simulation.graph.weights = np.ones(5)
