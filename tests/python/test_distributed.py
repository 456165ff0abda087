"""A graph in parts: the same optimum, descent, the proof; most of it without a cluster."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rotavg
from benchmarks.inline_client import InlineClient
from distributed_graphs import GRAPHS, with_two_components

distributed = pytest.importorskip("distributed", reason="needs the extra [distributed]")
pytest.importorskip("pymetis", reason="needs the extra [distributed]")

import rotavg.distributed.coarse as coarse  # noqa: E402
from rotavg.distributed import solve  # noqa: E402
from rotavg.distributed.building import build, sent  # noqa: E402
from rotavg.distributed.chebyshev import Chebyshev  # noqa: E402
from rotavg.distributed.coarse import Joints, turns  # noqa: E402
from rotavg.distributed.deadline import Deadline  # noqa: E402
from rotavg.distributed.local import level, solve_majorised  # noqa: E402
from rotavg.distributed.operator import apply, make_operator  # noqa: E402
from rotavg.distributed.proof import _told, prove  # noqa: E402
from rotavg.distributed.rounds import Rounds, as_they_are  # noqa: E402

pytestmark = pytest.mark.filterwarnings("default")  # Dask's and Tornado's own


@pytest.fixture(scope="module")
def client() -> InlineClient:
    return InlineClient()


def built(client: Any, graph: rotavg.MeasurementGraph, parts: int) -> tuple[Any, list[Any]]:
    return build(client, *sent(client, graph, parts))


def random_rotations(rng: np.random.Generator, *shape: int) -> np.ndarray:
    Q, R = np.linalg.qr(rng.normal(size=(*shape, 3, 3)))
    Q = Q * np.sign(np.einsum("...ii->...i", R))[..., None, :]
    Q[np.linalg.det(Q) < 0, :, 0] *= -1
    return Q


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("name", GRAPHS)
def test_it_is_the_optimum_of_one_process(client: Any, name: str, parts: int) -> None:
    graph = GRAPHS[name]
    expected = rotavg.solve(graph, tolerance=1e-11)
    found = solve(graph, client=client, parts=parts, tolerance=1e-7)
    assert found.converged, found.reason
    assert found.objective == pytest.approx(expected.objective, rel=1e-9, abs=1e-18)
    assert found.certificate is not None
    assert found.certificate.verdict == "proved"
    assert found.solved
    nodes, R = found.gather()
    assert np.array_equal(nodes, graph.nodes)
    assert rotavg.objective(graph, R) == pytest.approx(found.objective, rel=1e-9, abs=1e-18)
    assert (found.num_nodes, found.num_edges) == (len(graph.nodes), len(graph.edges))
    objectives = [round.objective for round in found.rounds]
    assert np.all(np.diff(objectives) <= 1e-12 * max(objectives))


def test_all_parts_at_once_never_raise_the_objective(client: Any) -> None:
    rng = np.random.default_rng(20210712)
    graph = GRAPHS["dense"]
    network, _ = built(client, graph, 4)
    parts = network.gather(network.parts)
    assert sum(part.num_own for part in parts) == len(graph.nodes)
    assert len({node for part in parts for node in part.nodes[: part.num_own]}) == len(graph.nodes)
    for _ in range(10):
        R = [random_rotations(rng, part.num_own) for part in parts]
        before = sum(x.objective for x in network.gather(network.with_neighbours(level, R)))
        swept = network.with_neighbours(solve_majorised, R, tolerance=1e-6, deadline=Deadline())
        after = sum(x.objective for x in network.gather(network.with_neighbours(level, swept)))
        assert after < before


def test_the_levels_of_parts_add_up(client: Any) -> None:
    rng = np.random.default_rng(20210713)
    graph = with_two_components()
    R = random_rotations(rng, len(graph.nodes))
    network, _ = built(client, graph, 3)
    parts = network.gather(network.parts)
    own = [R[np.searchsorted(graph.nodes, part.nodes[: part.num_own])] for part in parts]
    levels = network.gather(network.with_neighbours(level, own))
    g = rotavg.gradient(graph, R)
    assert sum(x.objective for x in levels) == pytest.approx(rotavg.objective(graph, R), rel=1e-12)
    assert sum(x.squares for x in levels) == pytest.approx((g**2).sum(), rel=1e-12)


def test_joints_are_what_whole_parts_cost() -> None:
    # tr(Q_p N Q_q^T) of general N is met by at most three rotations with weights.
    rng = np.random.default_rng(20210714)
    p, q = np.array([0, 0, 1, 2]), np.array([1, 2, 3, 3])
    N = rng.normal(size=(4, 3, 3))
    Q = turns(Joints(p, q, N), 4, first=True)

    def worth(Q: np.ndarray) -> float:
        return float(np.einsum("kab,kbc,kac->", Q[p], N, Q[q]))

    best = max(worth(random_rotations(rng, 4)) for _ in range(20000))
    assert worth(Q) >= best
    swapped = Joints.summed(q, p, N.transpose(0, 2, 1))
    assert np.allclose(swapped.N, N)
    assert np.array_equal(swapped.p, p)


def test_the_operator_is_that_of_the_certificate(client: Any) -> None:
    rng = np.random.default_rng(20210715)
    graph = GRAPHS["dense"]
    n = len(graph.nodes)
    R = random_rotations(rng, n)
    S = np.zeros((n, 3, n, 3))
    for (i, j), R_ij, w in zip(graph.indices, graph.rotations, graph.weights):
        S[i, :, j] -= w * R_ij
        S[j, :, i] -= w * R_ij.T
    Lambda = -np.einsum("iajb,jcb,icd->iad", S, R, R)
    for i in range(n):
        S[i, :, i] += 0.5 * (Lambda[i] + Lambda[i].T)
    degree = np.bincount(graph.indices.ravel(), np.repeat(graph.weights, 2))
    y = rng.normal(size=(n, 3, 2))
    scaled = S.reshape(3 * n, 3 * n) / np.sqrt(np.outer(np.repeat(degree, 3), np.repeat(degree, 3)))
    expected = (scaled @ y.reshape(3 * n, 2)).reshape(n, 3, 2)

    network, _ = built(client, graph, 3)
    parts = network.gather(network.parts)
    rows = [np.searchsorted(graph.nodes, part.nodes) for part in parts]
    for part, at in zip(parts, rows):
        component = np.zeros(part.num_own, np.int64)
        operator = make_operator(part, R[at], degree[at], component)
        assert np.allclose(apply(operator, y[at]), expected[at[: part.num_own]], atol=1e-13)
        K = Lambda - Lambda.transpose(0, 2, 1)
        mine = at[: part.num_own]
        square = (0.25 * (K[mine] ** 2).sum(axis=(1, 2)) / degree[mine]).sum()
        assert operator.leftover.sum() == pytest.approx(square, rel=1e-10)


def test_a_wound_cycle_is_refuted(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotavg.distributed.proof.GATHERED", 0)  # no process may hold it all
    n = 12
    edges = [(k, (k + 1) % n) for k in range(n)]
    graph = rotavg.MeasurementGraph(edges, np.tile(np.eye(3), (n, 1, 1)))
    angles = 2.0 * np.pi * np.arange(n) / n
    R = np.zeros((n, 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angles)
    R[:, 1, 0], R[:, 0, 1], R[:, 2, 2] = np.sin(angles), -np.sin(angles), 1.0
    assert np.abs(rotavg.gradient(graph, R)).max() < 1e-14  # a critical point all the same
    network, pieces = built(client, graph, 3)
    rounds = Rounds(network, pieces)
    parts = network.gather(network.parts)
    for rotations, verdict, shortfall in (
        (R, "not_certified", "negative"),
        (np.tile(np.eye(3), (n, 1, 1)), "proved", "none"),
    ):
        rounds.reweight(network.parts, [rotations[part.nodes[: part.num_own]] for part in parts])
        component, count = rounds.components()
        certificate = prove(rounds, component, count, tolerance=1e-6, probability=1e-12, seed=0)
        assert certificate is not None
        assert certificate.verdict == verdict
        assert certificate.shortfall == shortfall


def test_the_proof_without_a_factorisation(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotavg.distributed.proof.GATHERED", 0)
    for name in ("dense", "two components"):
        found = solve(GRAPHS[name], client=client, parts=3, tolerance=1e-7)
        assert found.certificate is not None
        assert found.certificate.verdict == "proved"
        assert found.certificate.method == "random_start"
        assert found.certificate.failure_probability == 1e-12
        assert "probability" in str(found)


@pytest.mark.parametrize("noise", [1e-12, 1e-9, 1e-7])
def test_little_noise_is_proved_too(client: Any, noise: float) -> None:
    graph = rotavg.simulate("erdos_renyi", 1000, density=0.01, noise=noise, seed=5).graph
    found = solve(graph, client=client, parts=3)
    assert found.certificate is not None
    assert found.certificate.verdict == "proved", found.certificate
    assert found.converged
    assert found.reason == "converged"
    # Or rounding is in the way: the last round has not let it fall.
    *_, before, last = (told.relative_gradient for told in found.rounds)
    assert last <= max(2e-5 * noise, 1e-13) or (0.7 * before <= last < 2e-13)
    # Only the proof needs a gradient so small, and a limit beyond the tolerance is no limit.
    uncertified = solve(graph, client=client, parts=3, certify=False)
    few = len(uncertified.rounds) - 1
    assert uncertified.relative_gradient <= 1e-9
    if noise >= 1e-7:
        assert len(uncertified.rounds) < len(found.rounds)
    limited = solve(graph, client=client, parts=3, max_rounds=few)
    assert limited.converged
    assert limited.reason == "converged"


def test_a_heavy_component_hides_no_light_one(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotavg.distributed.proof.GATHERED", 0)
    light = rotavg.simulate("erdos_renyi", 40, noise=0.5, density=0.4, seed=8).graph
    heavy = rotavg.simulate("complete", 8, noise=0.3, seed=9).graph
    graph = rotavg.MeasurementGraph(
        np.concatenate([light.edges, heavy.edges + 1000]),
        np.concatenate([light.rotations, heavy.rotations]),
        np.concatenate([light.weights, 1e10 * heavy.weights]),
    )
    found = solve(graph, client=client, parts=3, max_rounds=0)  # not at its optimum
    _, R = found.gather()
    expected = rotavg.certify(graph, R)
    assert found.certificate is not None
    assert found.certificate.verdict == expected.verdict == "not_certified"
    assert len(found.certificate.components) == 2
    optimum = solve(graph, client=client, parts=3, tolerance=1e-9)
    assert optimum.certificate is not None
    assert optimum.certificate.verdict == "proved"


def test_the_chance_of_a_wrong_proof_is_what_is_stated(client: Any) -> None:
    # A wound cycle, and a wrong estimate: with a chance of one in five, fewer than that say so.
    n = 8
    edges = np.array([(k, (k + 1) % n) for k in range(n)])
    graph = rotavg.MeasurementGraph(edges, np.tile(np.eye(3), (n, 1, 1)))
    network, _ = built(client, graph, 1)
    part = network.parts[0].result()
    angles = 2.0 * np.pi * part.nodes / n
    R = np.tile(np.eye(3), (n, 1, 1))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angles)
    R[:, 1, 0], R[:, 0, 1] = np.sin(angles), -np.sin(angles)
    component = np.zeros(n, np.int64)
    degrees = network.with_neighbours(as_they_are, [part.degree])
    operators = network.with_neighbours(make_operator, [R], degrees, [component])
    told = network.gather(network.each(_told, operators, count=1))[0]
    chebyshev = Chebyshev(network, operators, told, 1)
    outcomes = [chebyshev.run(0.3, 0.2, seed, 300) for seed in range(30)]
    assert sum(outcome.cut > 0 for outcome in outcomes) < 0.2 * 30


def test_robustly(client: Any) -> None:
    simulated = rotavg.simulate("erdos_renyi", 400, noise=0.03, outliers=0.25, density=0.06, seed=6)
    alone = rotavg.solve(simulated.graph, loss="auto")
    found = solve(simulated.graph, client=client, parts=3, loss="auto", tolerance=1e-6)
    truth = (simulated.graph.nodes, simulated.ground_truth)
    assert found.solved
    assert found.robust is not None
    mean = rotavg.compare(found.gather(), truth).mean
    assert mean < 1.1 * rotavg.compare(alone, truth).mean
    # A quarter of the measurements are wrong.
    assert found.robust.num_outliers == pytest.approx(0.25 * len(simulated.graph.edges), rel=0.1)
    assert "outliers" in str(found)


@pytest.mark.parametrize("loss", ["l2", "auto"])
@pytest.mark.parametrize("parts", [4, 5, 300])
def test_there_may_be_more_parts_than_nodes(client: Any, parts: int, loss: Any) -> None:
    rng = np.random.default_rng(20210716)
    truth = random_rotations(rng, 4)
    edges = [(0, 1), (1, 2), (2, 3), (3, 0)]
    measured = [truth[i].T @ truth[j] for i, j in edges]
    graph = rotavg.MeasurementGraph(edges, measured)
    found = solve(graph, client=client, parts=parts, loss=loss)
    assert found.solved
    assert found.num_parts <= 4
    assert found.objective < 1e-20


def test_aggregates_save_rounds(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    graph = rotavg.simulate("sphere", 3000, noise=0.05, seed=10).graph
    expected = rotavg.solve(graph, tolerance=1e-11).objective
    rounds = {}
    for counts in ((), coarse.AGGREGATES):
        monkeypatch.setattr(coarse, "AGGREGATES", counts)
        found = solve(graph, client=client, parts=8, tolerance=1e-8, certify=False)
        assert found.objective == pytest.approx(expected, rel=1e-9)
        rounds[bool(counts)] = found.rounds[-1].number
    assert rounds[True] <= 0.7 * rounds[False]


def test_where_all_aggregates_meet_there_are_none(client: Any) -> None:
    graph = rotavg.simulate("erdos_renyi", 400, noise=0.1, density=0.1, seed=11).graph
    network, pieces = built(client, graph, 2)
    for part, piece in zip(client.gather(network.parts), client.gather(pieces)):
        assert np.array_equal(coarse.aggregates(part, piece), piece)
    network, pieces = built(client, GRAPHS["sphere"], 2)
    for part, piece in zip(client.gather(network.parts), client.gather(pieces)):
        label = coarse.aggregates(part, piece)
        assert label.max() >= 7  # 150 nodes, of which 8 may be an aggregate
        assert np.array_equal(np.unique(label), np.arange(label.max() + 1))
        assert all(len(np.unique(piece[label == k])) == 1 for k in range(label.max() + 1))
