"""Robust averaging in parts: iteratively reweighted least squares at one scale for all of them.

Each part begins with `solve(loss="auto")` of its own edges, with all that this does to find wrong
ones. The parts are joined by the same loss, in which the edges between two pieces have a vote each.
From there the loss is Cauchy's, at the median of the parts' scales: edges are reweighted (Holland
and Welsch 1977), and the weighted least squares are solved by rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.deadline import Deadline
from rotavg.distributed.local import inner_graph
from rotavg.distributed.part import Part, Rotations, degrees
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.solve import solve

LEAST_WEIGHT = 1e-6  # of what was given: the graph stays connected
VOTES = 100  # edges of one part that vote for how two pieces stand to each other


@dataclass(frozen=True)
class Loss:
    """Cauchy's.

    Attributes:
        scale: of the loss, radians: of an edge with the median weight.
        noise: of the measurements, radians.
        median_weight: residuals are judged in units of their sigma, sqrt(median_weight / weight).
    """

    scale: float
    noise: float
    median_weight: float

    def weights(
        self, squares: NDArray[np.float64], given: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Of edges with residuals |R_i R_ij - R_j|^2 and given weights."""
        in_units = 0.5 * squares * (given / self.median_weight) / self.scale**2
        return given * np.maximum(1.0 / (1.0 + in_units), LEAST_WEIGHT)


def solve_alone_robustly(part: Part, deadline: Deadline) -> tuple[Rotations, float, float, float]:
    """The own nodes by the edges between them; scale and noise of the loss, the median weight."""
    graph = inner_graph(part)
    if graph is None:
        return np.tile(np.eye(3), (part.num_own, 1, 1)), np.nan, np.nan, np.nan
    solution = solve(graph, loss="auto", certify=False, num_threads=1, time_limit=deadline.left())
    fit = solution.robust
    assert fit is not None
    return np.asarray(solution.rotations), fit.scale, fit.noise, float(np.median(graph.weights))


def common_loss(
    told: Sequence[tuple[float, float, float]], otherwise: tuple[float, float, float]
) -> Loss:
    """That of the median part; where no part has an edge of its own, otherwise."""
    known = [one for one in told if np.isfinite(one).all()] or [otherwise]
    scale, noise, weight = np.median(known, axis=0)
    return Loss(float(scale), float(noise), float(weight))


def votes(
    part: Part, R: Rotations, piece: NDArray[np.float64], seed: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Rotations, NDArray[np.float64]]:
    """Edges between pieces, some of many, as measurements between them: p, q, R_p R_pq ~ R_q, w."""
    edges = part.edges.take(part.counted)
    p, q = piece[edges.i].astype(np.int64), piece[edges.j].astype(np.int64)
    rows = np.flatnonzero(p != q)
    rows = np.random.default_rng([seed, part.number]).permutation(rows)
    _, place = np.unique(np.stack([p[rows], q[rows]], axis=1), axis=0, return_inverse=True)
    order = np.argsort(place.reshape(-1), kind="stable")
    grouped = place.reshape(-1)[order]
    rank = np.arange(len(rows)) - np.searchsorted(grouped, grouped)
    rows = np.sort(rows[order][rank < VOTES])
    edges = edges.take(rows)
    G = R[edges.i] @ edges.rotations @ R[edges.j].transpose(0, 2, 1)
    return p[rows], q[rows], G, edges.weights


def robust_turns(
    found: Sequence[tuple[Any, ...]], num_pieces: int
) -> tuple[Rotations, tuple[float, float, float]]:
    """The rotation of every piece by the votes; scale, noise and median weight as of a part."""
    p, q, G, w = (np.concatenate(arrays) for arrays in zip(*found))
    if len(p) == 0:
        return np.tile(np.eye(3), (num_pieces, 1, 1)), (np.nan, np.nan, np.nan)
    graph = MeasurementGraph(np.stack([p, q], axis=1), G, w, nodes=np.arange(num_pieces))
    solution = solve(graph, loss="auto", certify=False, num_threads=1)
    fit = solution.robust
    assert fit is not None
    told = (fit.scale, fit.noise, float(np.median(graph.weights)))
    return np.asarray(solution.rotations), told


def squares(part: Part, R: Rotations) -> NDArray[np.float64]:
    """(m,) |R_i R_ij - R_j|^2 of all edges of the part."""
    result = np.empty(len(part.edges))
    for rows, edges in part.all_blocks():
        residual = R[edges.i] @ edges.rotations - R[edges.j]
        result[rows] = (residual**2).sum(axis=(1, 2))
    return result


def reweighted(part: Part, R: Rotations, given: NDArray[np.float64], loss: Loss) -> Part:
    """The part with the weights that the loss gives its edges; all that have an edge agree."""
    edges = replace(part.edges, weights=loss.weights(squares(part, R), given))
    return replace(part, edges=edges, degree=degrees(part, edges))


def change(part: Part, before: Part) -> tuple[float, float]:
    """Sum of |w - w before| of the counted edges, and of w."""
    now, then = part.edges.weights[part.counted], before.edges.weights[part.counted]
    return float(np.abs(now - then).sum()), float(now.sum())


def outliers(part: Part, R: Rotations, given: NDArray[np.float64], loss: Loss) -> int:
    """How many counted edges are off by more than three sigma."""
    in_units = 0.5 * squares(part, R) * given / loss.median_weight
    return int(np.count_nonzero(in_units[part.counted] > (3.0 * loss.noise) ** 2))
