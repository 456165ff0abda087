"""Starting from the solution of another graph: placement, iterations, optimum, proof."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg import GraphError, MeasurementGraph, Solution
from rotavg.graph.conventions import matrices_from_rotvecs
from shared_data import shared_data

Pairs = Any


def measured(
    pairs: Pairs, truth: dict[Any, NDArray[np.float64]], nodes: list[Any] | None = None
) -> MeasurementGraph:
    """A graph without noise."""
    rotations = [truth[i].T @ truth[j] for i, j in pairs]
    return MeasurementGraph(pairs, rotations, None, nodes)


def random_truth(ids: Any, seed: int = 1) -> dict[Any, NDArray[np.float64]]:
    rotvecs = np.random.default_rng(seed).normal(size=(len(ids), 3))
    return dict(zip(ids, matrices_from_rotvecs(rotvecs)))


def placed(graph: MeasurementGraph, last: Solution) -> Solution:
    """Where a warm start begins."""
    return rotavg.solve(graph, init=last, max_iterations=0, certify=False)


def changed(graph: MeasurementGraph, R: NDArray[np.float64], count: int) -> MeasurementGraph:
    """So many edges fewer and as many others more, with noise of 0.05 rad."""
    random = np.random.default_rng(7)
    kept = np.ones(graph.num_edges, dtype=np.bool_)
    while True:
        kept[:] = True
        kept[random.choice(graph.num_edges, count, replace=False)] = False
        edges = graph.indices[kept]
        rotations = graph.rotations[kept]
        n = graph.num_nodes
        i = random.integers(n, size=count)
        j = (i + random.integers(2, n - 1, size=count)) % n
        noise = matrices_from_rotvecs(random.normal(scale=0.05, size=(count, 3)))
        new = MeasurementGraph(
            graph.nodes[np.concatenate([edges, np.stack([i, j], axis=1)])],
            np.concatenate([rotations, np.swapaxes(R[i], 1, 2) @ R[j] @ noise]),
            nodes=graph.nodes,
        )
        if new.components().max() == 0:
            return new


def assert_quicker(graph: MeasurementGraph, last: Solution, **options: Any) -> None:
    cold = rotavg.solve(graph, **options)
    warm = rotavg.solve(graph, init=last, **options)
    assert warm.init == "solution"
    assert warm.iterations < cold.iterations
    assert warm.objective == pytest.approx(cold.objective, rel=1e-9)
    assert warm.certificate is not None
    assert warm.certificate.verdict == "proved"


@pytest.mark.parametrize("kind", ["sphere", "grid", "band", "complete"])
@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_after_new_edges_fewer_iterations_lead_to_the_same_proved_optimum(
    kind: str, noise: float
) -> None:
    graph = rotavg.simulate(kind, 150 if kind == "complete" else 600, noise=noise, seed=2).graph
    last = rotavg.solve(graph)
    assert_quicker(changed(graph, last.rotations, 20), last)


@pytest.mark.parametrize("name", ["sphere2500", "torus3D", "parking-garage"])
def test_pose_graphs_with_20_edges_changed(name: str) -> None:
    graph = rotavg.read(shared_data("g2o") / f"{name}.g2o", unit_weights=True)
    last = rotavg.solve(graph)
    new = changed(graph, last.rotations, 20)
    cold, warm = rotavg.solve(new, init="shortest_path"), rotavg.solve(new, init=last)
    assert warm.iterations < cold.iterations  # from coarser graphs about as many as warm
    assert warm.iterations <= 5
    assert warm.objective == pytest.approx(cold.objective, rel=1e-9)
    assert warm.certificate is not None
    assert warm.certificate.verdict == "proved"


def test_the_same_graph_again_takes_no_iteration_and_keeps_every_bit() -> None:
    graph = rotavg.simulate("sphere", 300, noise=0.1, seed=3).graph
    last = rotavg.solve(graph)
    again = rotavg.solve(graph, init=last)
    assert again.iterations == 0
    np.testing.assert_array_equal(again.rotations, last.rotations)
    assert again.certificate is not None
    assert again.certificate.verdict == "proved"


def test_order_and_kind_of_ids_do_not_matter() -> None:
    graph = rotavg.simulate("grid", 64, noise=0.1, seed=4).graph
    named = MeasurementGraph(
        np.char.add("view", graph.edges.astype(str)),
        graph.rotations,
        nodes=np.char.add("view", graph.nodes[::-1].astype(str)),
    )
    last = rotavg.solve(named)
    other = MeasurementGraph(named.edges[::-1], named.rotations[::-1])
    again = rotavg.solve(other, init=last)
    assert again.iterations == 0
    for node in ("view0", "view17", "view63"):
        relative = last["view5"].T @ last[node]
        np.testing.assert_allclose(again["view5"].T @ again[node], relative, atol=1e-9)


def test_two_components_and_new_nodes_are_joined_exactly() -> None:
    names = [f"n{k}" for k in range(13)]
    truth = random_truth(names)
    ring = [(names[k], names[(k + 1) % 5]) for k in range(5)]
    chain = [(names[k], names[k + 1]) for k in range(5, 8)]
    last = rotavg.solve(measured(ring + chain, truth))
    assert last.num_components == 2
    # n9 hangs on the ring, n10 on n9, n11 on n10 and on the chain; n12 stands alone.
    new = [("n9", "n2"), ("n9", "n10"), ("n11", "n10"), ("n6", "n11")]
    grown = measured(ring + chain + new, truth, names)
    assert placed(grown, last).objective < 1e-20
    joined = measured([*ring, *chain, ("n8", "n0")], truth)
    start = placed(joined, last)
    assert start.objective < 1e-20
    assert start.num_components == 1
    np.testing.assert_allclose(start["n7"], truth["n0"].T @ truth["n7"], atol=1e-14)


def test_nodes_and_edges_that_are_gone_split_a_component_that_may_be_joined_again() -> None:
    truth = random_truth(range(20))
    path = [(k, k + 1) for k in range(19)]
    last = rotavg.solve(measured(path, truth))
    split = measured([p for p in path if 9 not in p], truth)
    halves = placed(split, last)
    assert halves.num_components == 2
    assert halves.objective < 1e-20
    # What held the halves together is gone, but not forgotten: node 30 is enough of one side.
    truth[30] = random_truth([30])[30]
    other = measured([*[p for p in path if 9 not in p], (30, 4), (30, 15)], truth)
    assert placed(other, halves).objective < 1e-20
    assert placed(other, last).objective < 1e-20


def test_the_largest_component_is_held_and_the_edge_that_most_agree_with_is_met() -> None:
    truth = random_truth(range(12))
    parts = [(k, k + 1) for k in range(6)] + [(k, k + 1) for k in range(7, 11)]
    last = rotavg.solve(measured(parts, truth))
    graph = measured([*parts, (0, 7), (3, 9), (2, 8), (6, 11)], truth)
    rotations = graph.rotations.copy()
    rotations[-2] = matrices_from_rotvecs(np.array([[2.0, 0.3, 0.1]]))[0]  # an outlier
    start = placed(MeasurementGraph(graph.edges, rotations), last)
    angles = start.residual_angles
    assert angles[-2] > 1
    assert np.delete(angles, -2).max() < 1e-7
    np.testing.assert_allclose(start.rotations[:7], last.rotations[:7], atol=1e-14)


def test_robust_losses_start_from_it() -> None:
    graph = rotavg.simulate("erdos_renyi", 200, density=0.1, noise=0.05, outliers=0.2, seed=5).graph
    options: dict[str, Any] = {"loss": "cauchy", "loss_scale": 0.05}
    last = rotavg.solve(graph, **options)
    random = np.random.default_rng(6)
    kept = np.sort(random.permutation(graph.num_edges)[20:])
    new = MeasurementGraph(graph.edges[kept], graph.rotations[kept], nodes=graph.nodes)
    cold = rotavg.solve(new, **options)
    warm = rotavg.solve(new, init=last, **options)
    assert warm.init == "solution"
    assert warm.iterations < cold.iterations
    assert warm.robust is not None
    assert cold.robust is not None
    assert warm.robust.objective == pytest.approx(cold.robust.objective, rel=1e-4)
    assert (warm.is_outlier == cold.is_outlier).mean() > 0.99


def test_priors_hold_from_a_warm_start() -> None:
    simulation = rotavg.simulate("grid", 125, noise=0.05, seed=8)
    graph, R = simulation.graph, simulation.ground_truth
    down = {k: (R[k].T @ [0, 1, 0], 5.0) for k in range(0, 125, 7)}
    for priors in (
        rotavg.Priors(fixed={3: R[3]}, gravity=down),
        rotavg.Priors(absolute={k: (R[k], 2.0) for k in (5, 50, 100)}),
        rotavg.Priors(gravity=down),
    ):
        last = rotavg.solve(graph, priors=priors)
        assert rotavg.solve(graph, priors=priors, init=last).iterations <= 2
        assert_quicker(changed(graph, last.rotations, 5), last, priors=priors)
        for before, after in ((last, None), (rotavg.solve(graph), priors)):  # with or without
            cold = rotavg.solve(graph, priors=after)
            warm = rotavg.solve(graph, priors=after, init=before)
            assert warm.objective == pytest.approx(cold.objective, rel=1e-9)
            if after is not None and 3 in after.fixed:
                np.testing.assert_allclose(warm[3], R[3], atol=1e-12)


def test_a_robust_loss_with_priors_starts_from_it() -> None:
    simulation = rotavg.simulate("erdos_renyi", 100, density=0.2, noise=0.05, outliers=0.2, seed=11)
    priors = rotavg.Priors(fixed={3: simulation.ground_truth[3]})
    options: dict[str, Any] = {"loss": "cauchy", "loss_scale": 0.05, "priors": priors}
    last = rotavg.solve(simulation.graph, **options)
    warm = rotavg.solve(simulation.graph, init=last, **options)
    assert warm.iterations < last.iterations
    assert warm.objective == pytest.approx(last.objective, rel=1e-3)
    np.testing.assert_allclose(warm[3], last[3], atol=1e-12)


@pytest.mark.parametrize("kind", [True, "log"])
def test_full_covariances_start_from_it(kind: Any) -> None:
    graph = rotavg.simulate("grid", 64, noise=0.05, seed=9).graph
    covariances = np.diag([1e-3, 4e-3, 2e-3])[None].repeat(graph.num_edges, axis=0)
    graph = MeasurementGraph(graph.edges, graph.rotations, covariances=covariances)
    last = rotavg.solve(graph, anisotropic=kind)
    warm = rotavg.solve(graph, anisotropic=kind, init=last)
    assert warm.init == "solution"
    assert warm.iterations < last.iterations
    assert warm.objective == pytest.approx(last.objective, rel=1e-9)


@pytest.mark.parametrize("method", ["auto", "bcd", "sum", "newton", "staircase", "bcdsr"])
def test_every_method_takes_it(method: Any) -> None:
    graph = rotavg.simulate("erdos_renyi", 30, density=0.3, noise=0.1, seed=10).graph
    last = rotavg.solve(graph)
    fewer = MeasurementGraph(graph.edges[1:], graph.rotations[1:], nodes=graph.nodes)
    cold = rotavg.solve(fewer)
    warm = rotavg.solve(fewer, init=last, method=method, tolerance=1e-7)
    assert warm.objective == pytest.approx(cold.objective, rel=1e-9)


def test_a_solution_that_fits_nothing_is_refused() -> None:
    truth = random_truth(range(6))
    last = rotavg.solve(measured([(0, 1), (1, 2)], truth))
    stranger = measured([(3, 4), (4, 5)], truth)
    with pytest.raises(GraphError, match=r"none of its 3 nodes is in the graph.*\(say, 3\)"):
        rotavg.solve(stranger, init=last)
    named = MeasurementGraph([("0", "1")], np.eye(3)[None])
    with pytest.raises(GraphError, match=r"expected ids as in the graph \(say, '0'\)"):
        rotavg.solve(named, init=last)
    with pytest.raises(GraphError, match="found a Solution, expected a MeasurementGraph"):
        rotavg.solve(last, init=last)  # type: ignore[arg-type]


def test_one_common_node_is_enough() -> None:
    truth = random_truth(range(6))
    last = rotavg.solve(measured([(0, 1), (1, 2)], truth))
    start = placed(measured([(2, 3), (3, 4), (4, 2)], truth), last)
    assert start.objective < 1e-20
