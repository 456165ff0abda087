"""The terms e^T Omega e of a pose graph's chi^2, and their derivatives.

A term is of one node or of two; all terms of a kind are evaluated at once. Derivatives are along
T_i exp((rho_i, phi_i)), see `rotavg.graph.se3`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError
from rotavg.graph.covariances import information
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.se3 import (
    adjoint,
    hat,
    inverse_left_jacobian_so3,
    inverse_right_jacobian_se3,
    log_se3,
    log_so3,
)

Floats = NDArray[np.float64]

_LEAST_PIVOT = 1e-13  # of information, in parts of its largest entry


class Terms(Protocol):
    """k terms of one kind."""

    @property
    def rows(self) -> NDArray[np.int64]:
        """(k, a) the nodes of each, as rows of the graph's."""
        ...

    @property
    def omega(self) -> Floats:
        """(k, d, d)."""
        ...

    def errors(self, rotations: Floats, positions: Floats) -> Floats:
        """Errors (k, d) at poses (n, 3, 3) and (n, 3)."""
        ...

    def jacobians(self, rotations: Floats, positions: Floats) -> list[Floats]:
        """(k, d, 6) for each of the nodes of a term."""
        ...


def cost(terms: Terms, rotations: Floats, positions: Floats) -> float:
    """Sum of e^T Omega e."""
    e = terms.errors(rotations, positions)
    return float(np.einsum("ka,kab,kb->", e, terms.omega, e, optimize=True))


def chi_of(terms: Terms, rotations: Floats, positions: Floats) -> Floats:
    """sqrt(e^T Omega e) (k,) of every term."""
    e = terms.errors(rotations, positions)
    return np.asarray(np.sqrt(np.maximum(np.einsum("ka,kab,kb->k", e, terms.omega, e), 0.0)))


@dataclass(frozen=True, eq=False)
class Between:
    """Measured relative poses Z of edges (i, j): e = log(Z^-1 T_i^-1 T_j)."""

    rows: NDArray[np.int64]
    omega: Floats
    rotations: Floats
    vectors: Floats

    def errors(self, rotations: Floats, positions: Floats) -> Floats:
        """Errors (m, 6)."""
        return log_se3(*self._left(rotations, positions))

    def jacobians(self, rotations: Floats, positions: Floats) -> list[Floats]:
        """E exp(xi_j), and E exp(-Ad(T_j^-1 T_i) xi_i), of E = Z^-1 T_i^-1 T_j."""
        of_j = inverse_right_jacobian_se3(self.errors(rotations, positions))
        i, j = self.rows.T
        j_from_world = np.swapaxes(rotations[j], 1, 2)
        t_ji = np.einsum("mab,mb->ma", j_from_world, positions[i] - positions[j])
        return [-of_j @ adjoint(j_from_world @ rotations[i], t_ji), of_j]

    def _left(self, rotations: Floats, positions: Floats) -> tuple[Floats, Floats]:
        """The motion E."""
        i, j = self.rows.T
        i_from_world = np.swapaxes(rotations[i], 1, 2)
        measured = np.swapaxes(self.rotations, 1, 2)
        t = np.einsum("mab,mb->ma", i_from_world, positions[j] - positions[i]) - self.vectors
        R = measured @ i_from_world @ rotations[j]
        return R, np.einsum("mab,mb->ma", measured, t)


@dataclass(frozen=True, eq=False)
class KnownRotations:
    """Absolute rotations P: e = log(P^T R)."""

    rows: NDArray[np.int64]
    omega: Floats
    rotations: Floats

    def errors(self, rotations: Floats, positions: Floats) -> Floats:
        """Errors (k, 3)."""
        return log_so3(np.swapaxes(self.rotations, 1, 2) @ rotations[self.rows[:, 0]])

    def jacobians(self, rotations: Floats, positions: Floats) -> list[Floats]:
        """J_r(e)^-1 for the rotation."""
        result = np.zeros((len(self.rows), 3, 6))
        result[:, :, 3:] = inverse_left_jacobian_so3(-self.errors(rotations, positions))
        return [result]


@dataclass(frozen=True, eq=False)
class KnownPositions:
    """Absolute positions q: e = p - q."""

    rows: NDArray[np.int64]
    omega: Floats
    positions: Floats

    def errors(self, rotations: Floats, positions: Floats) -> Floats:
        """Errors (k, 3), in the world."""
        return positions[self.rows[:, 0]] - self.positions

    def jacobians(self, rotations: Floats, positions: Floats) -> list[Floats]:
        """R for the translation."""
        result = np.zeros((len(self.rows), 3, 6))
        result[:, :, :3] = rotations[self.rows[:, 0]]
        return [result]


@dataclass(frozen=True, eq=False)
class KnownGravity:
    """Down d as a node sees it, and g in the world: e = R d - g."""

    rows: NDArray[np.int64]
    omega: Floats
    seen: Floats
    down: Floats

    def errors(self, rotations: Floats, positions: Floats) -> Floats:
        """Errors (k, 3), in the world."""
        turned = np.einsum("kab,kb->ka", rotations[self.rows[:, 0]], self.seen)
        return np.asarray(turned - self.down)

    def jacobians(self, rotations: Floats, positions: Floats) -> list[Floats]:
        """-R [d] for the rotation."""
        result = np.zeros((len(self.rows), 3, 6))
        result[:, :, 3:] = -rotations[self.rows[:, 0]] @ hat(self.seen)
        return [result]


def measured_terms(graph: MeasurementGraph, share: Floats) -> Between:
    """The terms of the edges, whose information is multiplied by `share` (m,).

    Raises GraphError for a graph without translations, and for the first edge whose information is
    not positive definite.
    """
    measured = graph.translations
    if measured is None:
        raise GraphError("the graph has no relative translations, so its nodes have no positions")
    omega = np.zeros((graph.num_edges, 6, 6))
    omega[:, :3, :3] = measured.information
    if graph.covariances is None:
        omega[:, 3:, 3:] = 2 * graph.weights[:, None, None] * np.eye(3)
    else:
        omega[:, 3:, 3:] = information(graph.covariances, np.ones(graph.num_edges))
    if measured.cross is not None:
        omega[:, :3, 3:] = measured.cross
        omega[:, 3:, :3] = np.swapaxes(measured.cross, 1, 2)
        # Scaled to a unit diagonal: units of length must not matter.
        scale = 1 / np.sqrt(np.einsum("maa->ma", omega))
        least = np.linalg.eigvalsh(omega * scale[:, :, None] * scale[:, None, :])[:, 0]
        if (least < _LEAST_PIVOT).any():
            edge = int(np.argmax(least < _LEAST_PIVOT))
            i, j = graph.edges[edge].tolist()
            raise GraphError(
                f"edge {edge} ({i!r} -> {j!r}): the information about its pose is not positive "
                "definite",
                edge=edge,
            )
    return Between(
        graph.indices.astype(np.int64),
        share[:, None, None] * omega,
        graph.rotations,
        measured.vectors,
    )
