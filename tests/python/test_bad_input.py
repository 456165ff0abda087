"""Bad arguments are refused: which edge, what was found, what was expected."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rotavg.base.errors import Error, GraphError
from rotavg.graph.conventions import matrices_from_quaternions
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.simulation.simulate import simulate

I3 = np.eye(3)


def test_matrix_with_determinant_minus_one() -> None:
    with pytest.raises(GraphError, match=r"edge 1 \(1 -> 2\): .*-1") as caught:
        MeasurementGraph([[0, 1], [1, 2]], [I3, np.diag([1.0, 1.0, -1.0])])
    assert caught.value.edge == 1
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, Error)


@pytest.mark.parametrize("off", [0.01, 0.5])
def test_matrix_that_is_not_orthogonal_by_how_much(off: float) -> None:
    bent = matrices_from_quaternions([1, 2, 3, 4]) @ np.diag([1.0 + off, 1.0, 1.0])
    with pytest.raises(GraphError, match=r"edge 0 \('a' -> 'b'\): .*\d\.\d") as caught:
        MeasurementGraph([["a", "b"]], [bent])
    assert caught.value.edge == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_rotation_not_finite(value: float) -> None:
    broken = I3.copy()
    broken[1, 2] = value
    with pytest.raises(GraphError, match=r"edge 1 \(5 -> 6\)"):
        MeasurementGraph([[4, 5], [5, 6]], [I3, broken])
    with pytest.raises(GraphError, match=r"edge 1 \(5 -> 6\): the quaternion is .*finite"):
        MeasurementGraph.from_quaternions([[4, 5], [5, 6]], [[0, 0, 0, 1], [0, value, 0, 1]])
    with pytest.raises(GraphError, match=r"edge 1 \(5 -> 6\): the rotation vector is .*finite"):
        MeasurementGraph.from_rotvecs([[4, 5], [5, 6]], [[0, 0, 1], [0, value, 0]])


def test_zero_matrix() -> None:
    with pytest.raises(GraphError, match=r"edge 0 \(0 -> 1\)"):
        MeasurementGraph([[0, 1]], [np.zeros((3, 3))])


def test_zero_quaternion() -> None:
    with pytest.raises(GraphError, match=r"edge 1 \(5 -> 6\): the quaternion is zero") as caught:
        MeasurementGraph.from_quaternions([[4, 5], [5, 6]], [[0, 0, 0, 1], [0, 0, 0, 0]])
    assert caught.value.edge == 1


def test_edge_from_a_node_to_itself() -> None:
    with pytest.raises(GraphError, match=r"edge 1 \('b' -> 'b'\)") as caught:
        MeasurementGraph([["a", "b"], ["b", "b"]], [I3, I3])
    assert caught.value.edge == 1


@pytest.mark.parametrize("weight", [-1.0, np.nan, np.inf, 1e-150, 1e150])
def test_weight(weight: float) -> None:
    with pytest.raises(GraphError, match=r"edge 1 \(1 -> 2\): .*weight") as caught:
        MeasurementGraph([[0, 1], [1, 2]], [I3, I3], [1.0, weight])
    assert caught.value.edge == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"edges": [], "rotations": []}, "no edges"),
        ({"edges": np.empty((0, 2), int), "rotations": np.empty((0, 3, 3))}, "no edges"),
        ({"edges": [0, 1], "rotations": [I3]}, r"edges have shape \(2,\), expected \(m, 2\)"),
        ({"edges": [[0, 1, 2]], "rotations": [I3]}, r"edges have shape \(1, 3\)"),
        ({"edges": [[0, 1], [2]], "rotations": [I3, I3]}, "not an array of node ids"),
        ({"edges": [[0.5, 1]], "rotations": [I3]}, "edges hold 0.5, expected an integer"),
        ({"edges": [[np.nan, 1]], "rotations": [I3]}, "edges hold nan, expected an integer"),
        ({"edges": [[1e300, 1]], "rotations": [I3]}, "expected an integer"),
        ({"edges": [["a", 1]], "rotations": [I3]}, "type int, str, expected all"),
        ({"edges": np.array([["a", 1]], object), "rotations": [I3]}, "type int, str"),
        ({"edges": [[True, False]], "rotations": [I3]}, "bool"),
        ({"edges": [[None, 1]], "rotations": [I3]}, "NoneType"),
        ({"edges": [[2**64, 1]], "rotations": [I3]}, "expected integers of 64 bits"),
        ({"edges": [[2**63, -1]], "rotations": [I3]}, "expected integers of 64 bits"),
        ({"edges": [[0, 1]], "rotations": I3}, r"shape \(3, 3\), expected \(1, 3, 3\)"),
        ({"edges": [[0, 1]], "rotations": [I3, I3]}, r"shape \(2, 3, 3\), expected \(1, 3, 3\)"),
        ({"edges": [[0, 1]], "rotations": "many"}, "rotations are not an array of numbers"),
        ({"edges": [[0, 1]], "rotations": [I3 * 1j]}, "complex"),
        ({"edges": [[0, 1]], "rotations": [I3], "weights": [1, 2]}, r"weights have shape \(2,\)"),
        ({"edges": [[0, 1]], "rotations": [I3], "weights": 2.0}, r"weights have shape \(\)"),
        (
            {"edges": [[0, 1]], "rotations": [I3], "nodes": [0, 1, 1]},
            "node 1 is listed more than once",
        ),
        ({"edges": [[0, 7]], "rotations": [I3], "nodes": [0, 1]}, r"edge 0 .*node 7 is not among"),
        ({"edges": [[0, 1]], "rotations": [I3], "nodes": ["0", "1"]}, "node 0 is not among"),
        ({"edges": [[0, 1]], "rotations": [I3], "nodes": [[0, 1]]}, r"nodes have shape \(1, 2\)"),
        (
            {"edges": [[0, 1]], "rotations": [I3], "convention": "camera"},
            "expected 'pose' or 'vision'",
        ),
    ],
)
def test_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(GraphError, match=message):
        MeasurementGraph(**arguments)


def test_unknown_order() -> None:
    with pytest.raises(GraphError, match="order is 'wzyx', expected 'xyzw' or 'wxyz'"):
        MeasurementGraph.from_quaternions([[0, 1]], [[0, 0, 0, 1]], order="wzyx")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "torus", "n": 5}, "unknown kind 'torus', expected one of complete"),
        ({"kind": "cycle", "n": 2}, "n is 2, expected an integer of at least 3"),
        ({"kind": "grid", "n": 1}, "n is 1"),
        ({"kind": "grid", "n": 2.5}, "n is 2.5"),
        ({"kind": "grid", "n": 9, "noise": -0.1}, "noise is -0.1"),
        ({"kind": "grid", "n": 9, "noise": np.nan}, "noise is nan"),
        ({"kind": "grid", "n": 9, "drop": 1.5}, "drop is 1.5, expected a fraction"),
        ({"kind": "grid", "n": 9, "outliers": -1}, "outliers is -1, expected a fraction"),
        ({"kind": "grid", "n": 9, "seed": -1}, "seed is -1"),
        ({"kind": "cycle", "n": 10, "drop": 0.5}, "5 of 10 edges, expected at most the 1"),
    ],
)
def test_simulate_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(GraphError, match=message):
        simulate(**arguments)
