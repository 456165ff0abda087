"""Chebyshev's iteration from a random start, across workers.

`certify/random_start.hpp` is the same in one process, and has the derivation of the proof.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.deadline import NEVER, Deadline
from rotavg.distributed.network import Network
from rotavg.distributed.operator import (
    UNIT_ROUNDOFF,
    Operator,
    along_null,
    apply,
    without_null,
)
from rotavg.distributed.part import Part

COLUMNS = 2
BATCH = 12  # steps that are submitted before their lengths are asked for
TRIES = 12  # of an estimate of the smallest eigenvalue
SMALLEST_CUT = 1e-9


@dataclass(frozen=True)
class Outcome:
    """Of one try.

    Attributes:
        cut: M is at least this on the complement of its null vectors; 0 where nothing was proved.
        quotient: otherwise the least Rayleigh quotient of where the iteration led; NaN if it was
            not begun, as too long.
        late: whether the deadline passed before it could tell.
    """

    cut: float = 0.0
    quotient: float = math.nan
    late: bool = False

    def is_negative(self, proof: Chebyshev) -> bool:
        """Whether R is refuted."""
        return self.quotient < -2.0 * proof.error

    def is_decided(self, proof: Chebyshev) -> bool:
        """Whether R is refuted, or not."""
        return self.cut > 0 or self.is_negative(proof)


@dataclass(frozen=True, eq=False)
class Told:
    """What all parts together know of S.

    Attributes:
        degrees: (components,) sums of the degrees.
        leftover, leftover_rounding: (components,) sums, see `Operator`.
        rounding: of a product with M, for a vector of length one.
        num_nodes: those with an edge.
        least_degree: of a node with an edge.
    """

    degrees: NDArray[np.float64]
    leftover: NDArray[np.float64]
    leftover_rounding: NDArray[np.float64]
    rounding: float
    num_nodes: int
    least_degree: float

    @staticmethod
    def joined(parts: Sequence[Told]) -> Told:
        """Of several parts."""
        return Told(
            np.sum([part.degrees for part in parts], axis=0),
            np.sum([part.leftover for part in parts], axis=0),
            np.sum([part.leftover_rounding for part in parts], axis=0),
            # Every row is in one part, and what holds for each row holds for the whole product.
            max(part.rounding for part in parts),
            sum(part.num_nodes for part in parts),
            min(part.least_degree for part in parts),
        )


class Chebyshev:
    """Vectors y (num_own, 3, 2) in parts, and Chebyshev's iteration on them.

    Args:
        network: the parts.
        operators: of every part, futures.
        told: of them all.
        num_components: of the graph, with an edge.
        deadline: after which nothing more is tried.
    """

    def __init__(
        self,
        network: Network,
        operators: Sequence[Any],
        told: Told,
        num_components: int,
        deadline: Deadline = NEVER,
    ) -> None:
        self.deadline = deadline
        self.network, self.operators = network, list(operators)
        self.component_degrees = told.degrees
        self.dimension = 3 * (told.num_nodes - num_components)
        self.error = 4.5 * told.rounding + 100.0 * UNIT_ROUNDOFF

    def tried(
        self, probability: float, seed: int, max_products: int, theta: float = 0.5
    ) -> Outcome:
        """With one estimate of the smallest eigenvalue after the other: where the vectors grew, it
        was too large, and they tell by how much.

        All tries begin with the same vectors: what may go wrong is that these are short along some
        direction, whatever is tried with them. So the probability is that of one.
        """
        outcome = Outcome(quotient=theta)
        for _ in range(TRIES):
            theta = outcome.quotient
            outcome = self.run(theta, probability, seed, max_products)
            if outcome.late:
                return outcome
            if outcome.cut > 0 or not 8.0 * SMALLEST_CUT < outcome.quotient < theta:
                break
        begun = outcome.cut > 0 or not math.isnan(outcome.quotient)
        return outcome if begun else Outcome(quotient=theta)

    def run(self, theta: float, probability: float, seed: int, max_products: int) -> Outcome:
        """Whether no eigenvalue of M is below a cut of theta / 8, but for the probability."""
        if probability <= 0.0:
            return Outcome()
        tau = min(0.9 * theta, 1.0)
        cut = 0.125 * tau
        eta = math.acosh(1.0 + 2.0 * (tau - cut) / (2.0 - tau))
        # |b_1| < t has probability sqrt(2 / pi) t sqrt(N') at most; the columns are independent.
        t = math.sqrt(probability) / (math.sqrt(2.0 / math.pi) * math.sqrt(self.dimension))
        settled = self.error / (math.sinh(eta) * (1.0 - math.exp(-eta)))
        steps = int(2.0 * math.acosh(2.0 / t) / eta) + 10
        if settled > 0.5 * t or 0.5 * steps > max_products:
            return Outcome()
        scale, shift = -2.0 / (2.0 - tau), (2.0 + tau) / (2.0 - tau)
        previous = self._start(seed)
        y, lengths = self._step(previous, None, scale, shift)
        r = self.error * (1.0 + 1.0 / math.sinh(eta))
        k, longest = 1, 1.0
        while k <= steps:
            told = [lengths]
            for _ in range(BATCH):
                following, lengths = self._step(y, previous, 2.0 * scale, 2.0 * shift)
                previous, y = y, following
                told.append(lengths)
            told.pop()  # the next batch begins with it
            if not self.network.done(told, self.deadline):
                return Outcome(late=True)
            for length in self.network.gather(told):
                longest = max(longest, length)
                if not length < 1e3:
                    return Outcome(quotient=self._quotient(previous))
                if (1.0 + 1e-9) * length < math.cosh(k * eta) * (t - r):
                    return Outcome(cut=cut)
                r += self.error * longest * math.exp(-k * eta) / math.sinh(eta)
                k += 1
        return Outcome(quotient=self._quotient(y))

    def _start(self, seed: int) -> list[Any]:
        """Uniform on the unit sphere of the complement."""
        drawn = self._projected(self.network.each(_drawn, self.operators, seed=seed))
        squares = sum(self.network.gather(self.network.each(_squares, drawn)), np.zeros(COLUMNS))
        return self.network.each(_scaled, drawn, by=1.0 / np.sqrt(squares))

    def _step(
        self, y: list[Any], previous: list[Any] | None, scale: float, shift: float
    ) -> tuple[list[Any], Any]:
        """On the complement, scale M y + shift y - previous, and its length (the greater)."""
        if previous is None:
            previous = self.network.each(_zero, y)
        raw = self.network.with_neighbours(
            _applied, y, self.operators, previous, scale=scale, shift=shift
        )
        projected = self._projected(raw)
        squares = self.network.each(_squares, projected)
        return projected, self.network.client.submit(_longest, squares, pure=False)

    def _projected(self, y: list[Any]) -> list[Any]:
        along = self.network.each(_along, self.operators, y, count=len(self.component_degrees))
        means = self.network.client.submit(_means, along, self.component_degrees, pure=False)
        return [
            self.network.at(p, without_null, operator, y[p], means)
            for p, operator in enumerate(self.operators)
        ]

    def _quotient(self, y: list[Any]) -> float:
        """The least Rayleigh quotient of the columns."""
        pairs = self.network.gather(self.network.with_neighbours(_products, y, self.operators))
        total = np.sum(pairs, axis=0)
        return float(np.min(total[0] / total[1]))


def _drawn(part: Part, operator: Operator, seed: int) -> NDArray[np.float64]:
    """Normal; 0 where a node has no edge."""
    y = np.random.default_rng([seed, part.number]).normal(size=(part.num_own, 3, COLUMNS))
    y[operator.degree == 0] = 0.0
    return y


def _scaled(part: Part, y: NDArray[np.float64], by: NDArray[np.float64]) -> NDArray[np.float64]:
    return y * by


def _zero(part: Part, y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros_like(y)


def _squares(part: Part, y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((y**2).sum(axis=(0, 1)))


def _longest(squares: list[NDArray[np.float64]]) -> float:
    return float(np.sqrt(np.sum(squares, axis=0).max()))


def _along(
    part: Part, operator: Operator, y: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    return along_null(operator, y, count)


def _means(along: list[NDArray[np.float64]], degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sum(along, axis=0) / degrees[:, None, None])


def _applied(
    part: Part,
    y: NDArray[np.float64],
    operator: Operator,
    previous: NDArray[np.float64],
    scale: float,
    shift: float,
) -> NDArray[np.float64]:
    return scale * apply(operator, y) + shift * y[: part.num_own] - previous


def _products(part: Part, y: NDArray[np.float64], operator: Operator) -> NDArray[np.float64]:
    own = y[: part.num_own]
    return np.stack([(own * apply(operator, y)).sum(axis=(0, 1)), (own**2).sum(axis=(0, 1))])
