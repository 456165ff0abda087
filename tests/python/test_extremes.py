"""Arrays however they lie in memory, the smallest graphs and the longest, and more than there is.

The long ones take a tenth of their size unless ROTAVG_LONG is set.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_rotvecs

I3 = np.eye(3)
MANY = 1_000_000 if os.environ.get("ROTAVG_LONG") else 100_000

Array = NDArray[Any]


def read_only(array: Array) -> Array:
    array = array.copy()
    array.setflags(write=False)
    return array


def strided(array: Array) -> Array:
    """The same values, every other one of a larger array, backwards."""
    wide = np.zeros([2 * size for size in array.shape], array.dtype)
    view = wide[tuple(slice(None, None, -2) for _ in array.shape)]
    view[...] = array
    return view


def unaligned(array: Array) -> Array:
    data = np.empty(array.nbytes + 1, np.uint8)[1:]
    view = data.view(array.dtype).reshape(array.shape)
    view[...] = array
    assert array.itemsize == 1 or not view.flags.aligned
    return view


def swapped(array: Array) -> Array:
    return array.astype(array.dtype.newbyteorder())


LAYOUTS: dict[str, Callable[[Array], Any]] = {
    "read-only": read_only,
    "Fortran order": np.asfortranarray,
    "strided": strided,
    "unaligned": unaligned,
    "the other byte order": swapped,
    "lists": lambda array: array.tolist(),
    "object": lambda array: array.astype(object),
}


@pytest.fixture(scope="module")
def simulation() -> rotavg.Simulation:
    return rotavg.simulate("erdos_renyi", 15, density=0.4, noise=0.1, seed=1)


def graph_of(simulation: rotavg.Simulation, change: Callable[[Array], Any]) -> Any:
    graph = simulation.graph
    spread = np.tile(np.diag([1.0, 2.0, 3.0]), (graph.num_edges, 1, 1))
    return rotavg.MeasurementGraph(
        change(graph.edges), change(graph.rotations), change(graph.weights),
        change(graph.nodes), covariances=change(spread),
    )  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_arrays_however_they_lie(simulation: rotavg.Simulation, layout: str) -> None:
    change = LAYOUTS[layout]
    expected = graph_of(simulation, lambda array: array)
    graph = graph_of(simulation, change)
    for name in ("nodes", "edges", "indices", "rotations", "weights", "covariances"):
        found, given = getattr(graph, name), getattr(expected, name)
        assert found.tobytes() == given.tobytes(), name
        assert found.dtype == given.dtype, name
    R = simulation.ground_truth
    start = rotavg.solve(expected, init=R)
    assert rotavg.solve(graph, init=change(R)).rotations.tobytes() == start.rotations.tobytes()
    assert rotavg.certify(graph, change(R)) == rotavg.certify(expected, R)
    assert rotavg.objective(graph, change(R)) == rotavg.objective(expected, R)
    assert rotavg.compare(start, change(R)).mean == rotavg.compare(start, R).mean
    pairs = np.array([[0, 5], [3, 2]])
    assert np.array_equal(start.covariances(change(pairs)), start.covariances(pairs))
    mask = np.arange(graph.num_edges) % 3 == 0
    # Objects may be pairs of nodes: no mask is made of them.
    change_mask = change if layout != "object" else read_only
    kept = [
        rotavg.solve(expected, loss="huber", excluded=which, edge_scales=scales).rotations.tobytes()
        for which, scales in ((mask, mask + 1.0), (change_mask(mask), change(mask + 1.0)))
    ]
    assert kept[0] == kept[1]
    quaternions = expected.quaternions
    for order, columns in (("xyzw", [0, 1, 2, 3]), ("wxyz", [3, 0, 1, 2])):
        again = rotavg.MeasurementGraph.from_quaternions(
            change(expected.edges), change(quaternions[:, columns]), order=order
        )
        assert again.rotations.tobytes() == expected.rotations.tobytes()


@pytest.mark.parametrize("integers", [np.int8, np.int32, np.uint8, np.uint32, np.uint64, np.intp])
@pytest.mark.parametrize("order", ["<", ">"])
def test_integers_of_every_kind(simulation: rotavg.Simulation, integers: Any, order: str) -> None:
    graph = simulation.graph
    kind = np.dtype(integers).newbyteorder(order)
    again = rotavg.MeasurementGraph(graph.edges.astype(kind), graph.rotations)
    assert again.edges.tobytes() == graph.edges.tobytes()
    assert again.edges.dtype == np.int64
    solution = rotavg.solve(again)
    assert solution.covariances(np.array([[0, 1]], kind)).shape == (1, 3, 3)


def test_the_largest_and_the_least_ids() -> None:
    for ids in (np.array([2**64 - 1, 2**63, 0], np.uint64), np.array([-(2**63), 2**63 - 1, 0])):
        graph = rotavg.MeasurementGraph(ids[[[0, 1], [1, 2], [0, 2]]], [I3] * 3)
        assert graph.nodes.tolist() == sorted(ids.tolist())
        assert rotavg.solve(graph)[ids[0]].tolist() == I3.tolist()


@pytest.mark.parametrize("kind", [np.float32, np.float16, np.longdouble])
def test_other_floating_point_numbers(simulation: rotavg.Simulation, kind: Any) -> None:
    """As good as their digits; the nearest rotations are taken."""
    graph = simulation.graph
    rough = rotavg.MeasurementGraph(
        graph.edges, graph.rotations.astype(kind), graph.weights.astype(kind), tolerance=0.01
    )
    error = max(float(np.finfo(kind).eps), 1e-16)
    assert np.abs(rough.rotations - graph.rotations).max() < 4 * error
    expected = rotavg.solve(graph)
    solution = rotavg.solve(rough, init=expected.rotations.astype(np.float32))
    assert solution.verdict == "proved"
    assert rotavg.compare(solution, expected.rotations).angles.max() < 40 * error + 1e-8


def test_one_node_and_none() -> None:
    for arguments in (([], [], None, [7]), ([], []), (np.empty((0, 2), int), [], [], [])):
        with pytest.raises(rotavg.GraphError, match="no edges"):
            rotavg.MeasurementGraph(*arguments)
    with pytest.raises(rotavg.GraphError, match=r"edge 0 \(7 -> 7\)"):
        rotavg.MeasurementGraph([[7, 7]], [I3])
    with pytest.raises(rotavg.GraphError, match="every edge has weight 0"):
        rotavg.MeasurementGraph([[7, 7]], [I3], skip_self_edges=True)
    with pytest.raises(rotavg.GraphError, match="every edge has weight 0"):
        rotavg.MeasurementGraph([[7, 8]], [I3], [0.0])


@pytest.mark.parametrize("method", ["auto", "bcd", "sum", "newton", "staircase", "bcdsr"])
def test_two_nodes(method: Any) -> None:
    """One edge is met exactly; of two that disagree the chordal mean is the optimum."""
    a, b = matrices_from_rotvecs([[0.0, 0.0, 0.2], [0.0, 0.0, 0.6]])
    one = rotavg.solve(rotavg.MeasurementGraph([["p", "q"]], [a]), method=method)
    assert one.verdict == "proved"
    assert np.abs(one["q"] - a).max() < 1e-9
    graph = rotavg.MeasurementGraph([["p", "q"], ["q", "p"]], [a, b.T])
    two = rotavg.solve(graph, method=method)
    assert np.abs(two["q"] - matrices_from_rotvecs([[0.0, 0.0, 0.4]])[0]).max() < 1e-9
    assert abs(two.objective - 2 * 8 * np.sin(0.1) ** 2) < 1e-12  # |R - S|_F^2 = 8 sin^2(angle / 2)
    assert two.verdict == "proved"


def solved(edges: Array, rotations: Array, **options: Any) -> rotavg.Solution:
    graph = rotavg.MeasurementGraph(edges, rotations)
    solution = rotavg.solve(graph, num_threads=2, **options)
    assert np.isfinite(solution.rotations).all()
    return solution


def test_many_parallel_edges() -> None:
    """Their noise averages out: the optimum is the nearest rotation to their sum."""
    rng = np.random.default_rng(1)
    R = matrices_from_rotvecs(rng.normal([0.1, 0.2, 0.3], 0.3, (MANY, 3)))
    solution = solved(np.tile([3, 9], (MANY, 1)), R)
    U, _, Vt = np.linalg.svd(R.sum(axis=0))
    assert np.abs(solution[9] - U @ Vt).max() < 1e-9
    assert solution.verdict == "proved"
    assert solution.covariances([[3, 9]]).max() < 1e-3


@pytest.mark.parametrize("shape", ["chain", "star"])
@pytest.mark.parametrize("options", [{}, {"loss": "huber"}])
def test_a_long_tree(shape: str, options: dict[str, Any]) -> None:
    """All measurements of a tree are met, however long it is."""
    rng = np.random.default_rng(2)
    k = np.arange(MANY - 1)
    edges = np.column_stack([k if shape == "chain" else 0 * k, k + 1])
    solution = solved(edges, matrices_from_rotvecs(rng.normal(0, 2, (MANY - 1, 3))), **options)
    assert solution.objective < 1e-20 * MANY
    assert solution.solved
    assert solution.verdict == "proved"


def test_a_long_ring() -> None:
    """The error of the one cycle is shared out evenly."""
    k = np.arange(MANY)
    turns = np.zeros((MANY, 3))
    turns[0, 2] = 1.0
    ring = solved(np.column_stack([k, (k + 1) % MANY]), matrices_from_rotvecs(turns))
    assert abs(ring.objective * MANY / 2 - 1.0) < 1e-5  # m |angle / m|^2 * 2
    assert ring.solved


MEMORY = r"{} would take about [\d.e+]+ GB, and this process may have [\d.]+ GB"


@pytest.mark.skipif(sys.platform == "win32", reason="how much memory there is is not known")
@pytest.mark.parametrize(
    ("kind", "n", "options"),
    [
        ("complete", 10**6, {}),
        ("erdos_renyi", 10**6, {"density": 0.5}),
        ("cycle", 10**10, {}),
        ("grid", 10**10, {"drop": 0.1}),
        ("sphere", 10**12, {}),
        ("band", 10**30, {}),
        ([(0, 1)], 10**12, {}),
    ],
)
def test_a_simulation_beyond_memory_is_refused(kind: Any, n: int, options: Any) -> None:
    with pytest.raises(rotavg.GraphError, match=MEMORY.format(f"{n} nodes and .* edges")):
        rotavg.simulate(kind, n, **options)


def test_the_command_refuses_it_too(tmp_path: Path) -> None:
    command = ["simulate", "complete", "-n", "1000000", "-o", str(tmp_path / "graph.txt")]
    ended = CliRunner().invoke(commands, command)
    assert isinstance(ended.exception, rotavg.GraphError)
    assert "GB" in str(ended.exception)


def test_dense_results_beyond_memory_are_refused() -> None:
    solution = rotavg.solve(rotavg.simulate("cycle", 100, noise=0.1).graph)
    pairs = np.broadcast_to(np.array([[0, 1]], np.int64), (10**11, 2))
    with pytest.raises(rotavg.SolverError, match=MEMORY.format("the covariances of .* pairs")):
        solution.covariances(pairs)
    chain = rotavg.simulate("cycle", 300_000).graph
    with pytest.raises(rotavg.SolverError, match=r"is a dense matrix of .* GB"):
        rotavg.solve(chain, method="bcdsr")


LITTLE_MEMORY = """
import resource, rotavg
graph = rotavg.simulate("grid", 8000, noise=0.1, seed=1).graph
solution = rotavg.solve(graph, certify=False)
with open("/proc/self/status") as status:
    used = next(int(line.split()[1]) for line in status if line.startswith("VmData"))
limit = (used << 10) + (60 << 20)
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
certificate = rotavg.certify(graph, solution.rotations)
print(certificate.verdict, certificate.method)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited by Linux's means")
def test_a_proof_that_memory_does_not_hold_is_made_in_another_way() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", LITTLE_MEMORY], capture_output=True, text=True, timeout=300
    )
    assert ended.stdout.split() == ["proved", "random_start"], ended.stderr
