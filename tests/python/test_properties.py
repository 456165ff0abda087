"""What must not change with how a problem is put: properties of random small graphs.

Every run takes the same examples, so that what passes once passes again; a failure prints the blob
that replays it. `ROTAVG_PROPERTIES=2000 python -m pytest tests/python/test_properties.py` draws so
many new ones for every property.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, event, given, note, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs
from rotavg.io import FORMATS

LONG = os.environ.get("ROTAVG_PROPERTIES")
EXAMPLES = settings(
    max_examples=int(LONG or 30),
    derandomize=LONG is None,
    print_blob=True,
    database=None,
    deadline=None,
    # Making a failure smaller takes minutes: by hand.
    phases=[Phase.explicit, Phase.generate, *([Phase.shrink] if LONG else [])],
    suppress_health_check=[HealthCheck.too_slow],
)

Array = NDArray[Any]


@dataclass(frozen=True)
class Problem:
    """A connected graph: edges (m, 2) between 0 and n - 1, R_ij (m, 3, 3), weights (m,)."""

    n: int
    edges: Array
    rotations: Array
    weights: Array
    noise: float

    @property
    def graph(self) -> rotavg.MeasurementGraph:
        return rotavg.MeasurementGraph(self.edges, self.rotations, self.weights, np.arange(self.n))

    @property
    def has_one_optimum(self) -> bool:
        """Whether the noise is so small that the optimum is one, and no flat one."""
        return self.noise <= 0.2


def random_rotations(count: int, rng: np.random.Generator) -> Array:
    return matrices_from_quaternions(rng.standard_normal((count, 4)))


@st.composite
def problems(draw: st.DrawFn, most: int = 12) -> Problem:
    """A tree, further edges (parallel ones among them) and noise from none to that of no sense."""
    n = draw(st.integers(2, most))
    parents = [draw(st.integers(0, k - 1)) for k in range(1, n)]
    nodes = st.integers(0, n - 1)
    pair = st.tuples(nodes, nodes).filter(lambda ends: ends[0] != ends[1])
    edges = np.array([*zip(range(1, n), parents), *draw(st.lists(pair, max_size=2 * n))])
    noise = draw(st.sampled_from([0.0, 1e-6, 0.02, 0.2, 0.7, 2.0]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    m = len(edges)
    truth = random_rotations(n, rng)
    spoilt = matrices_from_rotvecs(noise * rng.standard_normal((m, 3)))
    rotations = np.swapaxes(truth, 1, 2)[edges[:, 0]] @ truth[edges[:, 1]] @ spoilt
    weights = np.exp(rng.uniform(-2, 2, m)) if draw(st.booleans()) else np.ones(m)
    event(f"noise {noise}")
    return Problem(n, edges, rotations, weights, noise)


def spread(graph: rotavg.MeasurementGraph, R: Array, other: Array) -> float:
    """The largest angle, radians, between two answers, each turned to have its first node at I."""
    a, b = (np.swapaxes(X[:1], 1, 2) @ X for X in (R, other))
    return float(2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=(1, 2)) / 8**0.5, 0, 1)).max())


def check_same_optimum(
    problem: Problem,
    changed: rotavg.MeasurementGraph,
    back: Callable[[Array], Array] = lambda R: R,
    factor: float = 1.0,
) -> None:
    """The changed graph has the same verdict and `factor` times the objective.

    `back` makes of its rotations those of the problem, which are the same up to the gauge.
    """
    graph = problem.graph
    solution, other = rotavg.solve(graph), rotavg.solve(changed)
    note(f"{solution}\n{other}")
    scale = float(graph.weights.sum())
    assert other.verdict == solution.verdict
    R = back(other.rotations)
    assert abs(rotavg.objective(graph, R) * factor - other.objective) <= 1e-12 * factor * scale
    if solution.verdict == "proved":
        event("proved")
        close = 1e-9 * solution.objective + 1e-13 * scale
        assert abs(other.objective / factor - solution.objective) <= close
        if problem.has_one_optimum:
            assert spread(graph, R, solution.rotations) < 1e-6
        # What is proved of the one is true of the other, whoever asks.
        assert rotavg.certify(graph, R).verdict == "proved"


@EXAMPLES
@given(problems(), st.integers(0, 2**32 - 1))
def test_frames_of_the_nodes(problem: Problem, seed: int) -> None:
    """Node i measured in a frame turned by G_i: R_ij -> G_i R_ij G_j^T, R_i -> R_i G_i^T."""
    G = random_rotations(problem.n, np.random.default_rng(seed))
    i, j = problem.edges.T
    changed = G[i] @ problem.rotations @ np.swapaxes(G[j], 1, 2)
    graph = rotavg.MeasurementGraph(problem.edges, changed, problem.weights, np.arange(problem.n))
    check_same_optimum(problem, graph, lambda R: R @ G)


@EXAMPLES
@given(problems(), st.integers(0, 2**32 - 1))
def test_the_world_may_be_turned(problem: Problem, seed: int) -> None:
    """R_i -> G R_i changes neither objective nor certificate, of any rotations."""
    rng = np.random.default_rng(seed)
    graph = problem.graph
    G = random_rotations(1, rng)
    for R in (rotavg.solve(graph).rotations, random_rotations(problem.n, rng)):
        here, there = rotavg.certify(graph, R), rotavg.certify(graph, G @ R)
        scale = float(graph.weights.sum())
        assert abs(rotavg.objective(graph, R) - rotavg.objective(graph, G @ R)) <= 1e-13 * scale
        assert here.verdict == there.verdict
        turned = rotavg.gradient(graph, R) @ G[0].T  # omega -> G omega
        assert np.abs(rotavg.gradient(graph, G @ R) - turned).max() <= 1e-12 * scale


@EXAMPLES
@given(problems(), st.randoms(use_true_random=False))
def test_order_of_nodes_and_edges(problem: Problem, random: Any) -> None:
    ids = list(range(problem.n))
    order = list(range(len(problem.edges)))
    random.shuffle(ids)
    random.shuffle(order)
    ids_of = np.array(ids)
    graph = rotavg.MeasurementGraph(
        ids_of[problem.edges][order], problem.rotations[order], problem.weights[order],
        np.arange(problem.n),
    )  # fmt: skip
    check_same_optimum(problem, graph, lambda R: R[ids_of])


@EXAMPLES
@given(problems(), st.integers(0, 2**32 - 1))
def test_direction_of_edges(problem: Problem, seed: int) -> None:
    """Edges the other way round: (j, i) with R_ij^T."""
    flip = np.random.default_rng(seed).random(len(problem.edges)) < 0.5
    edges = np.where(flip[:, None], problem.edges[:, ::-1], problem.edges)
    transposed = np.swapaxes(problem.rotations, 1, 2)
    rotations = np.where(flip[:, None, None], transposed, problem.rotations)
    graph = rotavg.MeasurementGraph(edges, rotations, problem.weights, np.arange(problem.n))
    check_same_optimum(problem, graph)


@EXAMPLES
@given(problems(), st.floats(1e-12, 1e12))
def test_scale_of_the_weights(problem: Problem, factor: float) -> None:
    graph = problem.graph.with_weights(factor * problem.weights)
    check_same_optimum(problem, graph, factor=factor)


@EXAMPLES
@given(problems(), st.floats(0.01, 0.99))
def test_edges_split_in_two(problem: Problem, share: float) -> None:
    """Every edge as two of the same measurement, whose weights add up to its own."""
    w = problem.weights
    graph = rotavg.MeasurementGraph(
        np.repeat(problem.edges, 2, axis=0),
        np.repeat(problem.rotations, 2, axis=0),
        np.column_stack([share * w, w - share * w]).ravel(),
        np.arange(problem.n),
    )
    check_same_optimum(problem, graph)


def bits(solution: rotavg.Solution) -> tuple[Any, ...]:
    """All that a solution tells but the time that it took."""
    certificate = solution.certificate
    trace = solution.trace
    return (
        solution.rotations.tobytes(), solution.objective, solution.gradient_norm, solution.status,
        solution.iterations, solution.method, solution.edge_weights.tobytes(),
        trace.objective.tobytes(), trace.gradient_norm.tobytes(), trace.step.tobytes(),
        None if certificate is None else repr(certificate),
    )  # fmt: skip


@EXAMPLES
@given(
    problems(),
    st.sampled_from(["auto", "bcd", "sum", "newton", "staircase"]),
    st.sampled_from(["l2", "huber", "auto"]),
    st.sampled_from(["auto", "chordal", "spanning_tree", "random"]),
)
def test_again_and_on_any_number_of_threads(
    problem: Problem, method: Any, loss: Any, init: Any
) -> None:
    assume(not (method == "staircase" and loss != "l2"))
    found = {
        bits(rotavg.solve(problem.graph, method=method, loss=loss, init=init, num_threads=threads))
        for threads in (1, 1, 2, 3)
    }
    assert len(found) == 1


@EXAMPLES
@given(problems(), st.integers(0, 2**32 - 1))
def test_no_certificate_stands_above_a_better_answer(problem: Problem, seed: int) -> None:
    """f(R) - gap is below whatever any restart finds; R is stationary, nearly so, or anything."""
    graph = problem.graph
    scale = float(graph.weights.sum())
    rng = np.random.default_rng(seed)
    answers = [rotavg.solve(graph).rotations, random_rotations(problem.n, rng)]
    for limit in (3, 30, 20000):
        for start in range(3):
            run = rotavg.solve(
                graph, method="bcd", init="random", seed=start, max_iterations=limit, certify=False
            )
            answers.append(run.rotations)
    costs = [rotavg.objective(graph, R) for R in answers]
    best = min(costs)
    for R, cost in zip(answers, costs):
        certificate = rotavg.certify(graph, R)
        event(certificate.verdict)
        assert cost - certificate.gap <= best + 1e-12 * scale, certificate
        if certificate.verdict == "proved":
            assert cost - best <= 1e-6 * cost + 1e-12 * scale, certificate


NAMES = st.lists(
    st.text("ab0 -_,;\"'#\t%/é漢\\", min_size=1, max_size=6), min_size=12, max_size=12, unique=True
)


def ids_in(names: bool) -> st.SearchStrategy[list[Any]]:
    numbers = st.integers(-(2**63), 2**63 - 1) | st.integers(0, 50)
    return NAMES if names else st.lists(numbers, min_size=12, max_size=12, unique=True)


@EXAMPLES
@pytest.mark.parametrize("name", [form.name for form in FORMATS if form.write and form.read])
@given(problem=problems(), ids=st.booleans().flatmap(ids_in))
def test_what_is_written_is_read_again(name: str, problem: Problem, ids: list[Any]) -> None:
    """The same graph to rounding, where the format has a place for its ids; or it is refused."""
    form = next(form for form in FORMATS if form.name == name)
    if not form.has_graphs:
        pytest.skip(f"{name} holds no graphs")
    nodes = np.array(ids[: problem.n])
    graph = rotavg.MeasurementGraph(nodes[problem.edges], problem.rotations, problem.weights, nodes)
    suffix = form.suffixes[0] if form.suffixes else ".dat"
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", rotavg.IncompleteWarning)  # no place for weights
        path = Path(folder) / (f"graph{suffix}" if suffix.startswith(".") else suffix)
        usual = (
            graph.nodes.dtype.kind != "U" and 0 <= graph.nodes.min() <= graph.nodes.max() < 2**31
        )
        try:
            rotavg.write(path, graph, format=name)
        except rotavg.FormatError:  # it cannot hold such ids
            event("refused")
            if usual or any(Path(folder).iterdir()):
                raise
            return
        again = rotavg.read(path, format=name)
    event("written")
    ids_kept = form.has_ids(graph)
    expected = rotavg.MeasurementGraph(
        graph.edges if ids_kept else graph.indices, graph.rotations, graph.weights
    )
    if name == "irotavg":  # where all edges lead to the larger id
        expected, again = upwards(expected), upwards(again)
    assert again.edges.tolist() == expected.edges.tolist()
    assert np.abs(again.rotations - expected.rotations).max() < 1e-14
    if form.has_weights:
        assert np.allclose(again.weights, expected.weights, rtol=1e-15, atol=0)


def upwards(graph: rotavg.MeasurementGraph) -> rotavg.MeasurementGraph:
    """The same graph with every edge (i, j) with i > j turned round."""
    turn = graph.edges[:, 0] > graph.edges[:, 1]
    edges = np.where(turn[:, None], graph.edges[:, ::-1], graph.edges)
    R = np.where(turn[:, None, None], np.swapaxes(graph.rotations, 1, 2), graph.rotations)
    return rotavg.MeasurementGraph(edges, R, graph.weights)
