"""The measurement graph: ids, constructors, parts of it."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rotavg
from rotavg.base.errors import GraphError, MissingExtraError, require
from rotavg.graph.conventions import matrices_from_quaternions
from rotavg.graph.ids import rows_of
from rotavg.graph.measurement_graph import MeasurementGraph


def rotations(count: int, seed: int = 7) -> np.ndarray:
    return matrices_from_quaternions(np.random.default_rng(seed).standard_normal((count, 4)))


def test_nodes_are_the_ids_in_order() -> None:
    given = rotations(3)
    graph = MeasurementGraph([[30, -5], [-5, 7], [7, 30]], given)
    assert graph.nodes.tolist() == [-5, 7, 30]
    assert graph.nodes.dtype == np.int64
    assert graph.indices.tolist() == [[2, 0], [0, 1], [1, 2]]
    assert graph.indices.dtype == np.int32
    assert graph.edges.tolist() == [[30, -5], [-5, 7], [7, 30]]
    np.testing.assert_allclose(graph.rotations, given, atol=1e-14)
    assert graph.weights.tolist() == [1, 1, 1]
    assert (graph.num_nodes, graph.num_edges) == (3, 3)
    assert repr(graph) == "MeasurementGraph(3 nodes, 3 edges)"


def test_names_and_an_order_of_ones_own() -> None:
    edges = [["wall", "door"], ["door", "roof"]]
    graph = MeasurementGraph(edges, rotations(2), nodes=["roof", "cellar", "door", "wall"])
    assert graph.nodes.tolist() == ["roof", "cellar", "door", "wall"]
    assert graph.indices.tolist() == [[3, 2], [2, 0]]
    assert graph.components().tolist() == [0, 1, 0, 0]
    objects = np.array(edges, dtype=object)
    assert MeasurementGraph(objects, rotations(2)).nodes.tolist() == ["door", "roof", "wall"]


@pytest.mark.parametrize(
    "ids",
    [
        [2**63 - 1, 2**63 - 2, -(2**63)],  # these differ by less than a double can tell
        [2**64 - 1, 2**64 - 2, 2**53 + 1],
    ],
)
def test_64_bit_ids_are_exact(ids: list[int]) -> None:
    a, b, c = ids
    graph = MeasurementGraph([[a, b], [b, c]], rotations(2))
    assert graph.edges.tolist() == [[a, b], [b, c]]
    assert graph.nodes.tolist() == sorted(ids)
    ordered = MeasurementGraph([[a, b], [b, c]], rotations(2), nodes=ids)
    assert ordered.indices.tolist() == [[0, 1], [1, 2]]


def test_small_edges_among_large_nodes() -> None:
    graph = MeasurementGraph([[1, 2]], rotations(1), nodes=[2**64 - 1, 2, 1])
    assert graph.indices.tolist() == [[2, 1]]


def test_whole_floats_and_small_integers_are_ids() -> None:
    assert MeasurementGraph([[1.0, 2.0]], rotations(1)).nodes.dtype == np.int64
    for dtype in (np.uint8, np.int16, np.uint64):
        graph = MeasurementGraph(np.array([[1, 2]], dtype=dtype), rotations(1))
        assert graph.edges.dtype == np.int64


def test_arrays_are_copies_and_read_only() -> None:
    edges, given, weights = np.array([[0, 1]]), rotations(1), np.array([2.0])
    graph = MeasurementGraph(edges, given, weights)
    edges[0, 0] = 5
    weights[0] = 3
    given[0] = np.eye(3)
    assert graph.edges.tolist() == [[0, 1]]
    assert graph.weights.tolist() == [2]
    assert not np.allclose(graph.rotations[0], np.eye(3))
    for name in ("nodes", "edges", "indices", "rotations", "weights"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(graph, name)[0] = 0


def test_all_constructors_agree() -> None:
    transform = pytest.importorskip("scipy.spatial.transform")
    r = transform.Rotation.random(5, random_state=1)
    edges = [[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]]
    weights = [1, 2, 3, 4, 5]
    expected = MeasurementGraph(edges, r.as_matrix(), weights)
    xyzw = r.as_quat()
    wxyz = xyzw[:, [3, 0, 1, 2]]
    for graph in (
        MeasurementGraph.from_quaternions(edges, xyzw, weights),
        MeasurementGraph.from_quaternions(edges, 1.5 * wxyz, weights, order="wxyz"),
        MeasurementGraph.from_rotvecs(edges, r.as_rotvec(), weights),
        MeasurementGraph.from_scipy(edges, r, weights),
        MeasurementGraph(edges, r.inv().as_matrix(), weights, convention="vision"),
        MeasurementGraph.from_scipy(edges, r.inv(), weights, convention="vision"),
    ):
        np.testing.assert_allclose(graph.rotations, expected.rotations, atol=1e-14)
        np.testing.assert_array_equal(graph.weights, expected.weights)


def test_almost_rotations_are_snapped() -> None:
    given = rotations(20)
    bent = given + 1e-5 * np.random.default_rng(3).standard_normal(given.shape)
    graph = MeasurementGraph([[k, k + 1] for k in range(20)], bent)
    gram = np.swapaxes(graph.rotations, 1, 2) @ graph.rotations
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=1e-14)
    np.testing.assert_allclose(graph.rotations, given, atol=1e-4)


def test_networkx() -> None:
    networkx = pytest.importorskip("networkx")
    r = rotations(2)
    g = networkx.MultiDiGraph()
    g.add_nodes_from(["c", "alone", "a", "b"])
    g.add_edge("a", "b", rotation=r[0], weight=3.0)
    g.add_edge("a", "b", rotation=[0, 0, 2, 0])
    g.add_edge("c", "b", rotation=r[1])
    graph = MeasurementGraph.from_networkx(g)
    assert graph.nodes.tolist() == ["c", "alone", "a", "b"]
    edge = {(*e, w): m for e, w, m in zip(graph.edges.tolist(), graph.weights, graph.rotations)
            for e in [tuple(e)]}  # fmt: skip
    np.testing.assert_allclose(edge["a", "b", 3.0], r[0], atol=1e-14)
    np.testing.assert_allclose(edge["a", "b", 1.0], np.diag([-1, -1, 1]), atol=1e-14)
    np.testing.assert_allclose(edge["c", "b", 1.0], r[1], atol=1e-14)
    turned = MeasurementGraph.from_networkx(g, convention="vision")
    np.testing.assert_allclose(turned.rotations, np.swapaxes(graph.rotations, 1, 2), atol=1e-14)


def test_networkx_that_cannot_be_understood() -> None:
    networkx = pytest.importorskip("networkx")
    with pytest.raises(GraphError, match=r"undirected.*u_from_v or v_from_u"):
        MeasurementGraph.from_networkx(networkx.Graph([(0, 1)]))
    g = networkx.DiGraph()
    g.add_edge(4, 5, turn=np.eye(3))
    with pytest.raises(GraphError, match=r"edge 0 \(4 -> 5\): it has no attribute 'rotation'"):
        MeasurementGraph.from_networkx(g)
    assert MeasurementGraph.from_networkx(g, rotation="turn").num_edges == 1
    for bad, message in (([1, 2, 3], r"shape \(3,\)"), ([0, 0, 0, 0], "quaternion is zero")):
        g.edges[4, 5]["turn"] = bad
        with pytest.raises(GraphError, match=rf"edge 0 \(4 -> 5\): .*{message}"):
            MeasurementGraph.from_networkx(g, rotation="turn")


def two_triangles_and_a_pair() -> MeasurementGraph:
    edges = [[9, 8], [1, 2], [2, 3], [3, 1], [5, 6], [6, 7], [5, 7], [7, 6]]
    return MeasurementGraph(edges, rotations(8), np.arange(1.0, 9.0))


def test_components() -> None:
    graph = two_triangles_and_a_pair()
    assert graph.nodes.tolist() == [1, 2, 3, 5, 6, 7, 8, 9]
    assert graph.components().tolist() == [0, 0, 0, 1, 1, 1, 2, 2]
    largest = graph.largest_component()
    assert largest.nodes.tolist() == [1, 2, 3]
    assert largest.largest_component() is largest


def test_subgraph_follows_the_order_asked_for() -> None:
    graph = two_triangles_and_a_pair()
    part = graph.subgraph([7, 5, 6, 1])
    assert part.nodes.tolist() == [7, 5, 6, 1]
    assert part.edges.tolist() == [[5, 6], [6, 7], [5, 7], [7, 6]]
    assert part.weights.tolist() == [5, 6, 7, 8]
    np.testing.assert_allclose(part.rotations, graph.rotations[4:], atol=1e-15)
    with pytest.raises(GraphError, match="node 4 is not in the graph"):
        graph.subgraph([1, 2, 4])
    with pytest.raises(GraphError, match="node 1 is listed more than once"):
        graph.subgraph([1, 2, 1])
    with pytest.raises(GraphError, match="no edge joins two of the 2 nodes"):
        graph.subgraph([1, 9])


def test_with_weights() -> None:
    graph = two_triangles_and_a_pair()
    other = graph.with_weights(np.full(8, 0.5))
    assert other.weights.tolist() == [0.5] * 8
    assert graph.weights[0] == 1
    np.testing.assert_array_equal(other.edges, graph.edges)


@pytest.mark.parametrize(
    "clone", [copy.copy, copy.deepcopy, lambda g: pickle.loads(pickle.dumps(g))]
)
def test_copies(clone) -> None:  # type: ignore[no-untyped-def]
    graph = MeasurementGraph([["a", "b"]], rotations(1), [2], ["b", "x", "a"], notes=("hello",))
    other = clone(graph)
    assert other.nodes.tolist() == ["b", "x", "a"]
    assert other.notes == ("hello",)
    np.testing.assert_allclose(other.rotations, graph.rotations, atol=1e-15)
    assert other.components().tolist() == [0, 1, 0]


def test_missing_extra_names_itself() -> None:
    with pytest.raises(MissingExtraError, match=r'pip install "rotavg\[images\]"') as caught:
        require("rotavg_no_such_module", "images")
    assert isinstance(caught.value, ImportError)
    assert require("json", "x").dumps([1]) == "[1]"


def test_an_edge_takes_64_bytes_and_arrays_are_made_when_asked_for() -> None:
    graph = rotavg.simulate("complete", 60, noise=0.1, seed=1).graph
    assert graph.num_bytes <= 64 * graph.num_edges + 24 * graph.num_nodes + 8
    made = rotavg.MeasurementGraph(graph.edges, graph.rotations)
    lazy = ("edges", "indices", "rotations", "quaternions", "weights")
    assert not set(lazy) & made.__dict__.keys()
    for name in lazy:
        array = getattr(made, name)
        assert getattr(made, name) is array
        assert not array.flags.writeable
    with pytest.raises(AttributeError):
        made.rotations = made.rotations  # type: ignore[misc]


@pytest.mark.parametrize("convention", ["pose", "vision"])
def test_quaternions_come_back_as_they_were_given(convention: str) -> None:
    rng = np.random.default_rng(5)
    q = rng.normal(size=(40, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q *= np.sign(q[:, 3:])
    edges = np.column_stack([np.arange(40), np.arange(1, 41)])
    graph = rotavg.MeasurementGraph.from_quaternions(edges, q, convention=convention)
    expected = q if convention == "pose" else q * [-1, -1, -1, 1]
    np.testing.assert_array_equal(graph.quaternions, expected)
    matrices = rotavg.MeasurementGraph(edges, graph.rotations)
    np.testing.assert_allclose(matrices.quaternions, graph.quaternions, atol=1e-15)


def test_what_is_made_of_a_graph_keeps_its_bits() -> None:
    graph = rotavg.simulate("grid", 25, noise=0.1, seed=2).graph
    graph = graph.with_weights(np.linspace(0.01, 30, graph.num_edges))
    raw = graph._core.scaled_quaternions
    copy = pickle.loads(pickle.dumps(graph))
    np.testing.assert_array_equal(copy._core.scaled_quaternions, raw)
    part = graph.subgraph(graph.nodes)
    np.testing.assert_array_equal(part._core.scaled_quaternions, raw)


@pytest.mark.parametrize("spread", [1, 3, 10_000])
def test_ids_near_and_far_apart_find_their_rows(spread: int) -> None:
    rng = np.random.default_rng(spread)
    ids = (rng.permutation(200) - 50) * spread
    edges = np.column_stack([ids, np.roll(ids, 1)])
    graph = rotavg.MeasurementGraph(edges, np.broadcast_to(np.eye(3), (200, 3, 3)))
    np.testing.assert_array_equal(graph.nodes, np.sort(ids))
    np.testing.assert_array_equal(graph.edges, edges)
    given = rotavg.MeasurementGraph(edges, np.broadcast_to(np.eye(3), (200, 3, 3)), nodes=ids)
    np.testing.assert_array_equal(given.nodes[given.indices], edges)
    far = np.array([np.iinfo(np.int64).min, np.iinfo(np.int64).max, 10**15, -(10**15)])
    np.testing.assert_array_equal(rows_of(far, graph.nodes), -1)
    np.testing.assert_array_equal(rows_of(ids, ids), np.arange(200))
