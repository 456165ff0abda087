"""The normal equations of least squares on poses: sparse, in blocks of a node each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.solving.pose_terms import Terms

Floats = NDArray[np.float64]


class NormalEquations:
    """H step = -g of terms e^T Omega e, H = J^T Omega J and g = J^T Omega e.

    Args:
        terms: of n nodes.
        free: (n, 6) which coordinates of the nodes may move.
    """

    def __init__(self, terms: Sequence[Terms], free: NDArray[np.bool_]) -> None:
        self._sparse = require("scipy.sparse", "scipy")
        self._linalg = require("scipy.sparse.linalg", "scipy")
        self._terms = terms
        self._place = np.full(free.shape, -1)
        self._size = int(free.sum())
        self._place[free] = np.arange(self._size)
        blocks = [
            (np.repeat(self._place[t.rows[:, a]], 6, axis=1), np.tile(self._place[t.rows[:, b]], 6))
            for t in terms
            for a in range(t.rows.shape[1])
            for b in range(t.rows.shape[1])
        ]
        rows = np.concatenate([block[0].ravel() for block in blocks])
        columns = np.concatenate([block[1].ravel() for block in blocks])
        self._used = (rows >= 0) & (columns >= 0)
        # Every free coordinate has a place on the diagonal, also of a node without an edge.
        diagonal = np.arange(self._size)
        rows = np.concatenate([diagonal, rows[self._used]])
        columns = np.concatenate([diagonal, columns[self._used]])
        keys, self._slot = np.unique(columns * self._size + rows, return_inverse=True)
        self._on_diagonal = self._slot[: self._size]
        ends = np.searchsorted(keys, self._size * np.arange(self._size + 1))
        self._pattern = (keys % max(1, self._size), ends)

    def linearise(self, rotations: Floats, positions: Floats) -> None:
        """Evaluate H and g at poses (n, 3, 3) and (n, 3)."""
        values = [np.zeros(self._size)]
        self._gradient = np.zeros(self._size)
        for t in self._terms:
            J = t.jacobians(rotations, positions)
            weighed = [t.omega @ of_node for of_node in J]
            e = t.errors(rotations, positions)
            for a, of_a in enumerate(J):
                place = self._place[t.rows[:, a]]
                slope = np.einsum("kda,kd->ka", weighed[a], e)
                np.add.at(self._gradient, place[place >= 0], slope[place >= 0])
                values += [(np.swapaxes(of_a, 1, 2) @ of_b).ravel() for of_b in weighed]
        flat = np.concatenate(values[1:])[self._used]
        self._values: Floats = np.bincount(
            self._slot, np.concatenate([values[0], flat]), minlength=len(self._pattern[0])
        ).astype(np.float64)

    def step(self, damping: float) -> tuple[Floats | None, float]:
        """Step (n, 6), and by how much chi^2 should fall; None where H is singular to rounding.

        The diagonal of H is multiplied by 1 + `damping` (Marquardt 1963).
        """
        result = np.zeros(self._place.shape)
        if self._size == 0:
            return result, 0.0
        values: Floats = self._values.copy()
        values[self._on_diagonal] *= 1 + damping
        scale = values[self._on_diagonal]
        if not (np.isfinite(values).all() and (scale >= 0).all()):
            return None, 0.0
        # Scaled to a unit diagonal: lengths have other units than angles.
        scale = 1 / np.sqrt(np.where(scale > 0, scale, 1.0))
        rows, ends = self._pattern
        values *= scale[rows] * np.repeat(scale, np.diff(ends))
        values[self._on_diagonal] = 1
        matrix = self._sparse.csc_matrix((values, rows, ends), shape=(self._size, self._size))
        try:
            factor = self._linalg.splu(
                matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            return None, 0.0
        down = -scale * factor.solve(scale * self._gradient)
        if not np.isfinite(down).all():
            return None, 0.0
        result[self._place >= 0] = down
        # chi^2 falls by -2 g^T d - d^T H d = -g^T d - damping d^T D d, D the diagonal.
        curved = damping / (1 + damping) * np.sum((down / scale) ** 2)
        return result, float(-self._gradient @ down + curved)
