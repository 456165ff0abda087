"""The certificate of a distributed solution."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.chebyshev import Chebyshev, Outcome, Told
from rotavg.distributed.edges import Edges
from rotavg.distributed.operator import UNIT_ROUNDOFF, Operator, make_operator
from rotavg.distributed.part import Part
from rotavg.distributed.rounds import Rounds, as_they_are
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.certificate import Certificate, ComponentCertificate, Shortfall, Verdict
from rotavg.solving.solve import certify

FEW_PRODUCTS, MANY_PRODUCTS = 300, 5000
GATHERED = 3_000_000  # edges that one worker can hold: some 2 GB


def prove(rounds: Rounds, tolerance: float, probability: float, seed: int) -> Certificate:
    """The certificate of where the rounds have led.

    By a random start, across workers, where that is quick. Where it would take many steps, as on
    graphs with long thin parts, and one worker can hold the graph, that one factorises; else the
    steps are taken.
    """
    network, state = rounds.network, rounds.state
    component, num_components = rounds.components()
    degrees = network.with_neighbours(as_they_are, network.each(_degree))
    operators = network.with_neighbours(make_operator, state.rotations, degrees, component)
    told = Told.joined(network.gather(network.each(_told, operators, count=num_components)))
    proof = Chebyshev(network, operators, told, num_components)
    outcome = proof.tried(probability, seed, FEW_PRODUCTS)
    if not outcome.is_decided(proof) and told.num_edges <= GATHERED:
        options = {"tolerance": tolerance, "failure_probability": probability, "seed": seed}
        certificate: Certificate = network.client.submit(
            _certified, network.parts, state.rotations, options, pure=False
        ).result()
        return certificate
    if not outcome.is_decided(proof):
        outcome = proof.tried(probability, seed, MANY_PRODUCTS, outcome.quotient)
    return _certificate(outcome, proof, told, state.level.objective, tolerance, probability)


def _certificate(
    outcome: Outcome,
    proof: Chebyshev,
    told: Told,
    objective: float,
    tolerance: float,
    probability: float,
) -> Certificate:
    few = 16.0 * float(np.finfo(np.float64).eps)
    total = 0.5 * float(told.degrees.sum())
    f = objective * (1.0 + UNIT_ROUNDOFF * told.num_edges)
    f += few * (math.sqrt(total * f) + few * total)
    # f(R) - f* <= |D^-1/2 K|_F^2 / cut, and it is at most f(R).
    gap, method, chance = f, "nonnegativity", 0.0
    if outcome.cut > 0:
        leftover = (math.sqrt(told.leftover) + math.sqrt(told.leftover_rounding)) ** 2
        by_cut = (1.0 + 1e-9) * leftover / outcome.cut
        if by_cut < gap:
            gap, method, chance = by_cut, "random_start", probability
    relative = gap / max(f, 1e-20 * total)
    shortfall, lambda_min = Shortfall.NONE, 0.0
    if relative > tolerance:
        if outcome.cut > 0:
            shortfall = Shortfall.LEFTOVER
        else:
            shortfall, lambda_min = Shortfall.UNDECIDED, math.nan
            if outcome.is_negative(proof):
                shortfall, lambda_min = Shortfall.NEGATIVE, outcome.quotient * told.least_degree
    verdict = Verdict.PROVED if relative <= tolerance else Verdict.NOT_CERTIFIED
    whole = (verdict, lambda_min, gap, relative, method, chance, shortfall)
    return Certificate(*whole, tolerance, (ComponentCertificate(*whole),))


def _degree(part: Part) -> NDArray[np.float64]:
    return part.degree


def _told(part: Part, operator: Operator, count: int) -> Told:
    return Told(
        np.asarray(np.bincount(operator.component, operator.degree, minlength=count), np.float64),
        *operator.leftover,
        operator.rounding,
        part.num_own,
        int(np.count_nonzero(part.counted)),
        float(operator.degree.min(initial=np.inf)),
    )


def _certified(
    parts: list[Part], rotations: list[NDArray[np.float64]], options: dict[str, Any]
) -> Certificate:
    """Of the whole graph, put together in one process."""
    nodes = np.concatenate([part.nodes[: part.num_own] for part in parts])
    order = np.argsort(nodes)
    edges = Edges.concatenated([part.edges_between_ids() for part in parts])
    graph = MeasurementGraph(
        np.stack([edges.i, edges.j], axis=1), edges.rotations, edges.weights, nodes=nodes[order]
    )
    return certify(graph, np.concatenate(rotations)[order], **options)
