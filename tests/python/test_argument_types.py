"""Arguments of the wrong type are refused in one line that says what was expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg

GRAPH = rotavg.simulate("erdos_renyi", 20, density=0.3, noise=0.05, seed=1).graph
FIXED: Any = {"fixed": {0: np.eye(3)}}
NO_GRAPH: Any = "graph.g2o"
CALLS: list[tuple[Callable[[], Any], str]] = [
    (lambda: rotavg.solve(GRAPH, priors=FIXED), "found a dict, expected a Priors: rotavg.Priors("),
    (lambda: rotavg.certify(GRAPH, rotavg.solve(GRAPH), priors=FIXED), "found a dict, expected a"),
    (lambda: rotavg.doubts(GRAPH, FIXED), "found a dict, expected a Priors"),
    (lambda: rotavg.solve_headings(GRAPH, FIXED), "found a dict, expected a Priors"),
    (
        lambda: rotavg.solve(GRAPH, priors=rotavg.Rigs({0: (0, 0)})),  # type: ignore[arg-type]
        "found a Rigs, expected a Priors",
    ),
    (lambda: rotavg.solve(NO_GRAPH), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.certify(NO_GRAPH, np.eye(3)), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.doubts(NO_GRAPH), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.hardness(NO_GRAPH), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.positions(NO_GRAPH, np.eye(3)), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.cycle_evidence(NO_GRAPH, 0.1), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.read_rigs("x.csv", NO_GRAPH), "found a str, expected a MeasurementGraph"),
    (lambda: rotavg.read_priors("x.db", NO_GRAPH), "found a str, expected a MeasurementGraph"),
    (
        lambda: rotavg.refined_gravity(GRAPH, [1]),  # type: ignore[arg-type]
        "found a list, expected a Mapping of nodes and directions",
    ),
    (
        lambda: rotavg.diagnose(GRAPH),  # type: ignore[arg-type]
        "found a MeasurementGraph, expected a Solution",
    ),
]


@pytest.mark.parametrize(("call", "message"), CALLS)
def test_wrong_types_are_told(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(TypeError) as told:
        call()
    assert isinstance(told.value, rotavg.ArgumentTypeError)
    assert isinstance(told.value, rotavg.GraphError)  # as it was before it had a class of its own
    assert str(told.value).startswith(message)


def test_writers_want_a_solution(tmp_path: Path) -> None:
    for write in (rotavg.write_edges, rotavg.write_covariances, rotavg.write_diagnostics):
        with pytest.raises(TypeError, match="found a MeasurementGraph, expected a Solution"):
            write(tmp_path / "x.csv", GRAPH)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_one_has_and_many_have() -> None:
    with pytest.raises(rotavg.GraphError, match=r"^init has shape \(3, 3\), expected \(20, 3, 3\)"):
        rotavg.solve(GRAPH, init=np.eye(3))
    with pytest.raises(rotavg.GraphError, match=r"^rotations have shape \(3, 3\), expected"):
        rotavg.certify(GRAPH, np.eye(3))
    with pytest.raises(rotavg.GraphError, match=r"^down is not an array of numbers"):
        rotavg.solve(GRAPH, priors=rotavg.Priors(fixed={0: np.eye(3)}, down="x"))
    with pytest.raises(rotavg.GraphError, match=r"^the entries of the fixed prior of node 0 have"):
        rotavg.solve(GRAPH, priors=rotavg.Priors(fixed={0: np.eye(2)}))
