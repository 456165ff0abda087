"""A solution as a mapping from ids to rotations, and comparisons of all that people have."""

from __future__ import annotations

import builtins
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from rotavg.base.errors import GraphError, MissingExtraError, UnknownNodeError
from rotavg.graph.conventions import matrices_from_rotvecs

NAMES = ["d", "b", "a", "c"]


def solution(seed: int = 0) -> rotavg.Solution:
    rng = np.random.default_rng(seed)
    edges = [["a", "b"], ["b", "c"], ["c", "d"], ["d", "a"]]
    R = matrices_from_rotvecs(rng.standard_normal((4, 3)))
    return rotavg.solve(rotavg.MeasurementGraph(edges, R, nodes=NAMES))


@pytest.mark.parametrize("kind", ["solution", "known"])
def test_it_is_a_mapping(kind: str) -> None:
    found: Any = solution()
    if kind == "known":
        found = rotavg.KnownRotations(found.graph, found.rotations)
    assert isinstance(found, Mapping)
    assert list(found) == list(found.keys()) == found.nodes.tolist() == NAMES
    assert len(found) == 4
    assert "a" in found
    assert "z" not in found
    assert 3 not in found
    assert [] not in list(found.keys())
    for k, (name, R) in enumerate(found.items()):
        assert name == NAMES[k]
        np.testing.assert_array_equal(R, found.rotations[k])
        np.testing.assert_array_equal(found[name], R)
    np.testing.assert_array_equal(np.array(list(found.values())), found.rotations)
    assert {name: R.shape for name, R in dict(found).items()} == dict.fromkeys(NAMES, (3, 3))
    assert found.get("z") is None
    for error in (GraphError, KeyError, UnknownNodeError):
        with pytest.raises(error, match=r"^node 'z' is not in the graph$"):
            found["z"]
    with pytest.raises(GraphError, match="is not in the graph"):
        found[[1]]
    assert found == found
    assert found != solution(1)
    assert len({found, found}) == 1
    np.testing.assert_array_equal(np.asarray(found), found.rotations)
    assert np.array(found, dtype=np.float32).dtype == np.float32
    # Functions that take rotations (n, 3, 3) take it, in the order of the graph.
    assert rotavg.objective(found.graph, found) == rotavg.objective(found.graph, found.rotations)


def test_scipy() -> None:
    pytest.importorskip("scipy")
    found = solution()
    turned = found.to_scipy()
    assert len(turned) == 4
    np.testing.assert_allclose(turned.as_matrix(), found.rotations, atol=1e-12)


def test_pandas() -> None:
    pandas = pytest.importorskip("pandas")
    found = solution()
    frame = found.to_dataframe()
    assert frame.index.tolist() == NAMES
    assert list(frame.columns) == ["qx", "qy", "qz", "qw", "component"]
    np.testing.assert_array_equal(frame.loc["a", ["qx", "qy", "qz", "qw"]].to_numpy(dtype=float),
                                  found.quaternions[2])  # fmt: skip
    assert frame["component"].tolist() == [0] * 4
    assert isinstance(frame, pandas.DataFrame)


def test_without_pandas_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def fake(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "pandas":
            raise ImportError("no pandas here")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", fake)
    monkeypatch.setattr("importlib.import_module", lambda name: fake(name))
    with pytest.raises(MissingExtraError, match=r'pip install "rotavg\[pandas\]"'):
        solution().to_dataframe()


def test_everything_is_compared_with_everything(tmp_path: Path) -> None:
    """Turned, shuffled and with other nodes in addition, the same rotations are 0 apart."""
    ours = solution()
    rng = np.random.default_rng(4)
    turn = matrices_from_rotvecs(rng.standard_normal(3))
    order = [3, 1, 0, 2]
    extra = matrices_from_rotvecs(rng.standard_normal((2, 3)))
    names = [*(NAMES[k] for k in order), "x", "y"]
    R = np.concatenate([turn @ ours.rotations[order], extra])
    path = tmp_path / "theirs.csv"
    chain = [[names[k], names[k + 1]] for k in range(5)]
    graph = rotavg.MeasurementGraph(chain, np.broadcast_to(np.eye(3), (5, 3, 3)), nodes=names)
    known = rotavg.KnownRotations(graph, R)
    rotavg.write(path, known)
    theirs: list[Any] = [
        dict(zip(names, R)), (names, R), (np.array(names), R.tolist()), path, str(path), known,
    ]  # fmt: skip
    for reference in theirs:
        for first in (ours, dict(ours), (NAMES, ours.rotations)):
            result = rotavg.compare(first, reference)
            assert result.angles.max() < 1e-7
            assert result.nodes.tolist() == NAMES
            assert result.rows.tolist() == [0, 1, 2, 3]
            assert (result.only_in_rotations, result.only_in_reference) == (0, 2)
            back = rotavg.compare(reference, first)
            assert back.angles.max() < 1e-7
            assert back.nodes.tolist() == names[:4]
            assert (back.only_in_rotations, back.only_in_reference) == (2, 0)
            assert "2 missing in the reference" in str(back)
    # Without ids on one side the order counts.
    assert rotavg.compare(ours, turn @ ours.rotations).angles.max() < 1e-7
    assert rotavg.compare(turn @ ours.rotations, ours).nodes.tolist() == NAMES
    assert rotavg.compare(ours, turn @ ours.rotations[order]).angles.max() > 0.1
    assert rotavg.compare(ours.rotations, turn @ ours.rotations).nodes.tolist() == [0, 1, 2, 3]


def test_scipy_rotations_are_compared() -> None:
    Rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    ours = solution()
    assert rotavg.compare(ours, ours.to_scipy()).angles.max() < 1e-7
    each = {name: Rotation.from_matrix(R) for name, R in ours.items()}
    assert rotavg.compare(each, ours).angles.max() < 1e-7


def test_components_on_both_sides() -> None:
    edges = [[0, 1], [1, 2], [10, 11], [11, 12]]
    R = matrices_from_rotvecs(np.random.default_rng(1).standard_normal((4, 3)))
    ours = rotavg.solve(rotavg.MeasurementGraph(edges, R))
    turns = matrices_from_rotvecs(np.random.default_rng(2).standard_normal((2, 3)))
    turned = {node: turns[int(node) // 10] @ Q for node, Q in ours.items()}
    assert rotavg.compare(ours, turned).angles.max() < 1e-7
    assert rotavg.compare(turned, ours).angles.max() < 1e-7
    assert rotavg.compare(dict(ours), turned).angles.max() > 0.1
    labels = ["left", "left", "left", "right", "right", "right"]
    assert rotavg.compare(dict(ours), turned, component=labels).num_components == 2


I3 = np.eye(3)


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ({"a": I3}, {"b": I3}, "no node is in both .ids are as 'a' and 'b'"),
        ({1: I3, 2: I3}, {"1": I3, "2": I3}, "no node is in both"),
        ({"a": I3, "b": 2 * I3}, {"a": I3, "b": I3}, "rotations: the matrix of node 'b' is not"),
        ((["a", "b"], [I3]), {"a": I3}, r"rotations have shape \(1, 3, 3\), expected \(2, 3, 3\)"),
        ((["a", "a"], [I3, I3]), {"a": I3}, "node 'a' is listed more than once"),
        ({"a": I3, "b": [1]}, {"a": I3}, "rotations are not an array of numbers"),
        ({}, {"a": I3}, "rotations: there are no rotations"),
        ([], {"a": I3}, "rotations: there are no rotations"),
        (
            [I3],
            [I3, I3],
            "expected those of the reference",
        ),
        (None, [I3], "rotations"),
        ([[1], [1, 2]], [I3, I3], "rotations are not an array of numbers"),
        ([I3, I3], ["a", "b"], "reference: found \\['a', 'b'\\], expected a solution"),
        ({"a": I3, "b": I3}, 7, r"reference: found 7, expected a solution, a mapping"),
        ({1.5: I3}, {1: I3}, "nodes hold 1.5"),
        ({"a": I3, 1: I3}, {1: I3}, "nodes hold values of type int, str"),
    ],
)
def test_what_does_not_fit_is_a_graph_error(first: Any, second: Any, message: str) -> None:
    with pytest.raises(GraphError, match=message):
        rotavg.compare(first, second)


def test_labels_that_do_not_fit() -> None:
    for labels in ([0], [[0], [0, 1]], [[0, 0], [0, 0]]):
        with pytest.raises(GraphError, match="component"):
            rotavg.compare([I3, I3], [I3, I3], component=labels)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(rotavg.FileAccessError, match=r"gone\.txt: cannot be read"):
        rotavg.compare(solution(), tmp_path / "gone.txt")
