"""Online averaging: the optimum of `solve` after every step, errors, and `solve --follow`."""

from __future__ import annotations

import copy
import os
import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs

SEED = int(os.environ.get("ROTAVG_TEST_SEED", "20210712"))


def measured(
    random: np.random.Generator, edges: np.ndarray, n: int, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Truth (n, 3, 3) and noisy measurements (m, 3, 3)."""
    truth = matrices_from_rotvecs(random.normal(size=(n, 3)))
    errors = matrices_from_rotvecs(random.normal(scale=noise, size=(len(edges), 3)))
    return truth, np.swapaxes(truth[edges[:, 0]], 1, 2) @ truth[edges[:, 1]] @ errors


def random_edges(random: np.random.Generator, n: int, extra: int) -> np.ndarray:
    """A random tree and further edges."""
    tree = [(random.integers(i), i) for i in range(1, n)]
    more = [random.choice(n, size=2, replace=False) for _ in range(extra)]
    return np.array([*tree, *more])


def check(online: rotavg.Online) -> None:
    """The rotations are those of `solve`, and what the state says of them is so."""
    graph = online.graph
    best = rotavg.solve(graph)
    solution = online.solution
    f = rotavg.objective(graph, solution.rotations)
    assert abs(f - online.objective) <= 1e-9 * f + 1e-24
    assert f <= best.objective * (1 + 1e-9) + 1e-24, SEED
    assert f - online.gap <= best.objective * (1 + 1e-12) + 1e-24, SEED
    if best.verdict == "proved":
        assert solution.verdict == rotavg.Verdict.PROVED == online.verdict, SEED
    assert np.array_equal(solution.nodes, graph.nodes)
    assert solution.num_components == 1 + graph.components().max()


def test_it_is_the_optimum_of_solve_at_every_step() -> None:
    random = np.random.default_rng(SEED)
    for noise, names in ((0.1, False), (0.003, True)):
        edges = random_edges(random, 25, 30)
        _, rotations = measured(random, edges, 25, noise)
        weights = 10.0 ** random.uniform(-1, 1, len(edges))
        ids: Any = np.array([f"n{i}" for i in range(25)])[edges] if names else 7 * edges - 3
        online = rotavg.Online()
        there: list[int] = []
        for k in random.permutation(len(edges)):
            there += online.add(ids[k : k + 1], rotations[k], weights[k : k + 1]).tolist()
            check(online)
            if k % 5 == 0:
                online.remove([there.pop(int(random.integers(len(there))))])
                if there:
                    check(online)
            if k % 7 == 0 and there:
                chosen = [there[int(random.integers(len(there)))]]
                online.set_weights(chosen, random.choice([0.0, 0.3, 5.0], size=1))
                if online.num_edges:
                    check(online)


def test_what_gains_less_than_the_tolerance_waits_and_the_gap_says_so() -> None:
    random = np.random.default_rng(SEED)
    edges = random_edges(random, 40, 80)
    _, rotations = measured(random, edges, 40, 0.05)
    online = rotavg.Online(tolerance=0.05)
    waited = 0
    for k, edge in enumerate(edges):
        before = online.objective
        online.add([edge], rotations[k])
        best = rotavg.solve(online.graph).objective
        f = rotavg.objective(online.graph, online.rotations)
        assert abs(f - online.objective) <= 1e-9 * f + 1e-24, SEED
        assert f - best <= online.gap + 1e-12 * f + 1e-24, SEED
        assert online.gap <= 0.05 * f + 1e-20, SEED
        assert online.verdict == rotavg.Verdict.PROVED, SEED
        state = online.state
        waited += online.objective > before and state.iterations == state.eliminated == 0
    assert waited > 4, SEED


def test_two_solutions_are_equal_only_if_they_are_one() -> None:
    online = rotavg.Online()
    online.add([("a", "b")], [np.eye(3)])
    first, second = online.solution, online.solution
    assert first == first
    assert first != second
    assert len({first, second}) == 2


def test_a_node_by_itself_is_in_a_gauge_of_its_own() -> None:
    random = np.random.default_rng(SEED)
    edges = random_edges(random, 12, 8)
    _, rotations = measured(random, edges, 12, 0.05)
    online = rotavg.Online()
    online.add(edges, rotations)
    turn = online[int(online.nodes[0])].T
    for node, rotation in zip(online.nodes.tolist(), online.rotations):
        assert np.allclose(turn @ online[node], rotation, atol=1e-14)
    with pytest.raises(rotavg.UnknownNodeError, match="no node 77"):
        online[77]


def test_vision_family_and_nodes_without_edges() -> None:
    random = np.random.default_rng(SEED)
    edges = random_edges(random, 6, 4)
    _, rotations = measured(random, edges, 6, 0.05)
    pose, vision = rotavg.Online(), rotavg.Online()
    pose.add(edges, rotations, nodes=[9, 8])
    vision.add(edges, np.swapaxes(rotations, 1, 2), convention="vision", nodes=[9, 8])
    assert pose.nodes[:2].tolist() == [9, 8]
    assert np.array_equal(pose.rotations, vision.rotations)
    assert pose.num_nodes == 8
    assert pose.solution.num_components == 3
    only_nodes = rotavg.Online()
    assert len(only_nodes.add(np.zeros((0, 2), int), np.zeros((0, 3, 3)), nodes=["a", "b"])) == 0
    assert only_nodes.nodes.tolist() == ["a", "b"]
    assert only_nodes.verdict == "proved"


def test_bad_input_changes_nothing() -> None:
    online = rotavg.Online()
    one = np.eye(3)
    numbers = online.add([(1, 2), (2, 3)], np.stack([one, one]))
    before = repr(online)
    for arguments, message in (
        ({"edges": [(1, 9), (4, 4)], "rotations": [one, one]}, r"edge 1 \(4 -> 4\)"),
        ({"edges": [(1, 9)], "rotations": [one], "weights": [-1]}, "found the weight -1"),
        ({"edges": [(1, 9)], "rotations": [one], "weights": [np.nan]}, "nan"),
        ({"edges": [(1, 9)], "rotations": [np.nan * one]}, "NaN"),
        ({"edges": [(1, 9)], "rotations": [-one]}, "reflection"),
        ({"edges": [(1, 9)], "rotations": [one, one]}, "shape"),
        ({"edges": [("a", "b")], "rotations": [one]}, "names, unlike"),
        ({"edges": [(1, 9)], "rotations": [one], "nodes": ["a"]}, "names, unlike"),
        ({"edges": [(1, 9)], "rotations": [one], "trusted": [1]}, "trusted"),
        ({"edges": [(1, 9)], "rotations": [one], "convention": "other"}, "other"),
    ):
        with pytest.raises(rotavg.Error, match=message):
            online.add(**arguments)
        assert repr(online) == before
    for edges in ([5], [-1], [numbers[0], numbers[0]], [0.5]):
        with pytest.raises(rotavg.GraphError):
            online.remove(edges)
    with pytest.raises(rotavg.GraphError):
        online.set_weights(numbers, [1.0])
    with pytest.raises(rotavg.GraphError):
        online.set_weights(numbers, [1.0, np.inf])
    assert repr(online) == before
    with pytest.raises(rotavg.OptionError, match="tolerance is 'a'; expected a number between 0"):
        rotavg.Online(tolerance="a")  # type: ignore[arg-type]
    for options in (
        {"loss": "tls"},
        {"loss": "auto", "loss_scale": 1.0},
        {"tolerance": 0.0},
        {"tolerance": 1.0},
        {"tolerance": float("nan")},
        {"certificate_tolerance": -1.0},
    ):
        with pytest.raises(rotavg.OptionError):
            rotavg.Online(**options)  # type: ignore[arg-type]
    with pytest.raises(rotavg.OptionError, match="expected one of 'l2', 'huber'"):
        rotavg.Online(loss="x")
    with pytest.raises(rotavg.OptionError, match="loss_scale is 10; expected an angle in radians"):
        rotavg.Online(loss="tls", loss_scale=10)
    assert len(rotavg.Online().add([], [])) == 0
    names = rotavg.Online()
    with pytest.raises(rotavg.GraphError):
        names.add([("a", "a")], one)
    names.add([(1, 2)], one)  # no name was kept


def test_wrong_closures_are_left_out() -> None:
    random = np.random.default_rng(SEED)
    n = 60
    path = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    closures = np.array([(i, i + 10) for i in range(0, n - 10, 2)])
    truth, odometry = measured(random, path, n, 0.01)
    online = rotavg.Online(loss="tls", loss_scale=0.3)
    online.add(path, odometry)
    right = np.swapaxes(truth[closures[:, 0]], 1, 2) @ truth[closures[:, 1]]
    wrong = []
    for k, closure in enumerate(closures):
        online.add([closure], right[k])
        if k > 3 and k % 3 == 0:
            rotation = matrices_from_rotvecs(np.array([[1.0, 0.5, -1.0]]))[0] @ right[k]
            wrong += online.add([closure], rotation).tolist()
    assert np.flatnonzero(online.edge_weights == 0.0).tolist() == wrong
    assert online.num_outliers == len(wrong) > 0
    assert online.verdict == "proved"


def test_all_closures_are_judged_at_once_where_the_first_ones_were_wrong() -> None:
    random = np.random.default_rng(SEED)
    n = 200
    path = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    truth, odometry = measured(random, path, n, 0.01)
    turn = matrices_from_rotvecs(np.array([1.5, 0.0, 0.0]))
    wrong = [(40, 160), (41, 159), (42, 158)]
    right = np.stack([random.integers(0, 60, 40), random.integers(140, n, 40)], axis=1)
    found = {}
    for asks in (True, False):
        online = rotavg.Online(loss="tls", loss_scale=0.15, second_opinions=asks)
        online.add(path, odometry)
        for i, j in wrong:
            online.add([(i, j)], truth[i].T @ turn @ truth[j])
        asked = 0
        for i, j in right.tolist():
            online.add([(i, j)], truth[i].T @ truth[j])
            asked += online.state.num_second_opinions
        found[asks] = np.flatnonzero(online.edge_weights < 0.5)
        assert (asked > 0) == asks, SEED
        assert online.verdict == "proved"
    assert np.array_equal(found[True], n - 1 + np.arange(3)), SEED
    assert len(found[False]) > 3, SEED


def test_a_single_edge_and_odometry_by_name() -> None:
    online = rotavg.Online(loss="tls", loss_scale=0.2)
    online.add([(1, 2)], np.eye(3), 2.0, trusted="odometry")
    assert online.edge_weights.tolist() == [2.0]
    with pytest.raises(rotavg.GraphError, match="trusted is 'odo'; expected \"odometry\" or"):
        online.add([(2, 3)], np.eye(3), trusted="odo")
    names = rotavg.Online(loss="tls", loss_scale=0.2)
    with pytest.raises(rotavg.GraphError, match="the nodes have names"):
        names.add([("a", "b")], np.eye(3), trusted="odometry")
    assert names.num_nodes == 0


def test_an_online_graph_is_not_copied_and_its_solution_is() -> None:
    online = rotavg.Online()
    online.add([(0, 1), (1, 2)], np.broadcast_to(np.eye(3), (2, 3, 3)))
    for refused in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="cannot be copied or pickled"):
            refused(online)
    solution = pickle.loads(pickle.dumps(online.solution))
    assert (solution.rotations == online.solution.rotations).all()


def test_an_online_solution_is_a_mapping() -> None:
    online = rotavg.Online()
    online.add([("b", "a"), ("a", "c")], np.broadcast_to(np.eye(3), (2, 3, 3)))
    solution = online.solution
    assert isinstance(solution, Mapping)
    assert list(solution) == solution.nodes.tolist() == ["b", "a", "c"]
    assert len(solution) == 3
    assert "a" in solution
    assert "z" not in solution
    for k, (node, R) in enumerate(solution.items()):
        np.testing.assert_array_equal(R, solution.rotations[k])
        np.testing.assert_array_equal(solution[node], R)
    with pytest.raises(rotavg.UnknownNodeError, match="'z'"):
        solution["z"]
    np.testing.assert_array_equal(np.asarray(solution), solution.rotations)
    assert solution.quaternions.tolist() == [[0, 0, 0, 1]] * 3
    scipy = pytest.importorskip("scipy.spatial.transform")
    assert isinstance(solution.to_scipy(), scipy.Rotation)
    frame = pytest.importorskip("pandas") and solution.to_dataframe()
    assert frame.index.tolist() == ["b", "a", "c"]
    assert frame.columns.tolist() == ["qx", "qy", "qz", "qw"]
    assert rotavg.compare(solution, solution).median == 0
