"""The certificate of a distributed solution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.chebyshev import Chebyshev, Outcome, Told
from rotavg.distributed.deadline import Deadline
from rotavg.distributed.edges import Edges
from rotavg.distributed.network import Network
from rotavg.distributed.operator import UNIT_ROUNDOFF, Operator, make_operator
from rotavg.distributed.part import Part, Rotations
from rotavg.distributed.rounds import Rounds, as_they_are
from rotavg.graph.counted_weights import counted_weights
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.certificate import Certificate, ComponentCertificate, Shortfall, Verdict
from rotavg.solving.certify import certify

FEW_PRODUCTS, MANY_PRODUCTS = 300, 5000
GATHERED = 3_000_000  # edges that one worker can hold: some 2 GB


def prove(
    rounds: Rounds,
    component: list[Any],
    num_components: int,
    *,
    tolerance: float,
    probability: float,
    seed: int,
) -> Certificate | None:
    """The certificate of where the rounds have led; None where their deadline comes before it.

    By a random start, across workers, where that is quick. Where it would take many steps, as on
    graphs with long thin parts, or falls short by what the least eigenvalue makes of the gradient,
    one worker that can hold the graph certifies it; else the steps are taken.

    Args:
        rounds: which have ended.
        component: of every own node, of every part.
        num_components: how many have an edge.
        tolerance: the largest relative gap that is called optimal.
        probability: that the proof may fail with.
        seed: of its random start.
    """
    network, state, deadline = rounds.network, rounds.state, rounds.deadline
    if deadline.passed:
        return None
    rounds.forget()
    measure = _measured(network, state.rotations, component, num_components)
    degrees = network.with_neighbours(as_they_are, network.each(_degree))
    operators = network.with_neighbours(make_operator, state.rotations, degrees, component)
    gathered = measure.num_edges <= GATHERED
    if not gathered:  # a part's edges make room for the operator of the next
        network.forget_edges()
    sums = network.each(_told, operators, count=num_components)
    if not network.done(sums, deadline):
        return None
    told = Told.joined(network.gather(sums))
    proof = Chebyshev(network, operators, told, num_components, deadline)
    outcome = proof.tried(probability, seed, FEW_PRODUCTS)
    if outcome.late:
        return None
    if not outcome.is_decided(proof) and not gathered:
        outcome = proof.tried(probability, seed, MANY_PRODUCTS, outcome.quotient)
    if outcome.late:
        return None
    certificate = _certificate(outcome, proof, told, measure, tolerance, probability)
    if gathered and certificate.shortfall in (Shortfall.UNDECIDED, Shortfall.LEFTOVER):
        options = {"tolerance": tolerance, "failure_probability": probability, "seed": seed}
        one = network.client.submit(
            _certified, network.parts, state.rotations, options, deadline, pure=False
        )
        (by_one,) = network.gather([one])
        assert isinstance(by_one, Certificate)
        # It may have been stopped before it knew as much.
        certificate = min(by_one, certificate, key=lambda known: known.relative_gap)
    return certificate


def stopped(objective: float, tolerance: float) -> Certificate:
    """Where there was no time for more: f(R) - f* <= f(R), of the graph as a whole."""
    gap, none = objective * (1.0 + 1e-9), Shortfall.STOPPED
    return Certificate(Verdict.NOT_CERTIFIED, math.nan, gap, 1.0, "none", 0.0, none, tolerance)


def _certificate(
    outcome: Outcome,
    proof: Chebyshev,
    told: Told,
    measure: Measure,
    tolerance: float,
    probability: float,
) -> Certificate:
    """Of every component by itself, and of the graph: the sum of the gaps, else the worst."""
    few = 16.0 * float(np.finfo(np.float64).eps)
    parts = []
    for c, (objective, total) in enumerate(zip(measure.objective, 0.5 * told.degrees)):
        f = objective * (1.0 + UNIT_ROUNDOFF * measure.num_edges)
        f += few * (math.sqrt(total * f) + few * total)
        # f(R) - f* <= |D^-1/2 K|_F^2 / cut, and it is at most f(R).
        gap, method, chance = f, "nonnegativity", 0.0
        if outcome.cut > 0:
            leftover = math.sqrt(told.leftover[c]) + math.sqrt(told.leftover_rounding[c])
            by_cut = (1.0 + 1e-9) * leftover**2 / outcome.cut
            if by_cut < gap:
                gap, method, chance = by_cut, "random_start", probability
        relative = gap / max(f, 1e-20 * measure.weight[c])
        verdict, shortfall, lambda_min = Verdict.PROVED, Shortfall.NONE, 0.0
        if relative > tolerance:
            verdict, shortfall = Verdict.NOT_CERTIFIED, Shortfall.LEFTOVER
            if outcome.cut == 0:
                shortfall, lambda_min = Shortfall.UNDECIDED, math.nan
            if outcome.is_negative(proof):
                shortfall, lambda_min = Shortfall.NEGATIVE, outcome.quotient * told.least_degree
        parts.append(
            ComponentCertificate(verdict, lambda_min, gap, relative, method, chance, shortfall)
        )
    worst = max(parts, key=lambda part: part.relative_gap)
    by_start = [part for part in parts if part.method == "random_start"]
    return Certificate(
        worst.verdict,
        worst.lambda_min,
        sum(part.gap for part in parts),
        worst.relative_gap,
        "random_start" if by_start else "nonnegativity",
        # The starts of all components are one.
        probability if by_start else 0.0,
        worst.shortfall,
        tolerance,
        tuple(parts),
    )


@dataclass(frozen=True, eq=False)
class Measure:
    """What the gaps of components are held against.

    Attributes:
        num_edges: of the graph.
        objective: (components,) their parts of f.
        weight: (components,) sums of weights; no edge counts for more than
            1000 times the lightest, but for at least 1/200 of its weight.
    """

    num_edges: int
    objective: NDArray[np.float64]
    weight: NDArray[np.float64]


def _measured(network: Network, rotations: list[Any], component: list[Any], count: int) -> Measure:
    sums = network.with_neighbours(_objectives, rotations, component, count=count)
    told = network.gather(sums)
    lightest = np.min([least for _, least in told], axis=0)
    weights = network.each(_counted_weights, component, lightest=lightest)
    return Measure(
        sum(network.gather(network.each(_num_edges))),
        np.sum([objective for objective, _ in told], axis=0),
        np.sum(network.gather(weights), axis=0),
    )


def _objectives(
    part: Part, R: Rotations, component: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(count,) the objective of the counted edges, and the lightest of them."""
    objective, lightest = np.zeros(count), np.full(count, np.inf)
    for edges, counted in part.blocks():
        edges = edges.take(counted)
        label = component[edges.i]
        squares = ((R[edges.i] @ edges.rotations - R[edges.j]) ** 2).sum(axis=(1, 2))
        objective += np.bincount(label, edges.weights * squares, minlength=count)
        np.minimum.at(lightest, label, edges.weights)
    return objective, lightest


def _counted_weights(
    part: Part, component: NDArray[np.int64], lightest: NDArray[np.float64]
) -> NDArray[np.float64]:
    edges = part.edges.take(part.counted)
    label = component[edges.i]
    counted = counted_weights(edges.weights, lightest[label])
    return np.asarray(np.bincount(label, counted, minlength=len(lightest)), np.float64)


def _num_edges(part: Part) -> int:
    return int(np.count_nonzero(part.counted))


def _degree(part: Part) -> NDArray[np.float64]:
    return part.degree


def _told(part: Part, operator: Operator, count: int) -> Told:
    def by_component(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(operator.component, values, minlength=count), np.float64)

    return Told(
        by_component(operator.degree),
        by_component(operator.leftover),
        by_component(operator.leftover_rounding),
        operator.rounding,
        int(np.count_nonzero(part.degree)),
        float(part.degree.min(initial=np.inf, where=part.degree > 0)),
    )


def _certified(
    parts: list[Part],
    rotations: list[NDArray[np.float64]],
    options: dict[str, Any],
    deadline: Deadline,
) -> Certificate:
    """Of the whole graph, put together in one process."""
    nodes = np.concatenate([part.nodes[: part.num_own] for part in parts])
    order = np.argsort(nodes)
    edges = Edges.concatenated([part.edges_between_ids() for part in parts])
    graph = MeasurementGraph(
        np.stack([edges.i, edges.j], axis=1), edges.rotations, edges.weights, nodes=nodes[order]
    )
    R = np.concatenate(rotations)[order]
    return certify(graph, R, time_limit=deadline.left(), **options)
