"""The four kinds of lines that pose graphs come in: how they say a pose and its information.

    g2o   EDGE_SE3:QUAT i j  x y z  qx qy qz qw    21 values
    g2o   EDGE_SE2      i j  x y theta              6 values
    TORO  EDGE3         i j  x y z  roll pitch yaw 21 values
    TORO  EDGE2         i j  x y theta              6 values

and the like for vertices, `VERTEX... i pose`. All are in the pose family. The values are the upper
triangle of the pose's information matrix, translation first, row by row (in EDGE2 in an order of
its own). Roll, pitch and yaw are about x, y and z: R = R_z(yaw) R_y(pitch) R_x(roll).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.conventions import (
    angles_about_z,
    matrices_from_angles_about_z,
    matrices_from_quaternions,
    matrices_from_roll_pitch_yaw,
    quaternions_from_matrices,
    roll_pitch_yaw_from_matrices,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Dialect:
    """One kind of lines.

    Attributes:
        vertex, edge: tags.
        dimension: of space, 2 or 3; so many numbers of a pose are its translation.
        turn: how many further numbers are its rotation.
        order: row and column in the information matrix of each of the numbers that give it.
        rotations: numbers (m, turn) -> (m, 3, 3).
        numbers: (m, 3, 3) -> (m, turn).
        angles: what these numbers are called.
    """

    vertex: bytes
    edge: bytes
    dimension: int
    turn: int
    order: tuple[tuple[int, int], ...]
    rotations: Callable[[Floats], Floats]
    numbers: Callable[[Floats], Floats]
    angles: tuple[str, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """What the numbers after the ids of an edge are called: the pose, and its information."""
        about = (f"value {k + 1} of the information" for k in range(len(self.order)))
        return (*"xyz"[: self.dimension], *self.angles, *about)

    @property
    def num_pose(self) -> int:
        """How many numbers a pose has."""
        return self.dimension + self.turn

    def translations(self, poses: Floats) -> Floats:
        """Translations (m, 3) of poses (m, num_pose)."""
        result = np.zeros((len(poses), 3))
        result[:, : self.dimension] = poses[:, : self.dimension]
        return result

    def poses(self, translations: Floats, rotations: Floats) -> Floats:
        """Poses (m, num_pose) of translations (m, 3) and rotations (m, 3, 3)."""
        return np.hstack([translations[:, : self.dimension], self.numbers(rotations)])

    def matrices(self, values: Floats) -> Floats:
        """Information matrices (m, d, d), translation first, of the values on m lines."""
        rows, columns = np.array(self.order).T
        size = rows.max() + 1
        result = np.zeros((len(values), size, size))
        result[:, rows, columns] = result[:, columns, rows] = values
        return result

    def values(self, matrices: Floats) -> Floats:
        """What lines say for information matrices (m, d, d)."""
        rows, columns = np.array(self.order).T
        return matrices[:, rows, columns]

    def _block(self, values: Floats, begin: int, end: int) -> Floats:
        """Rows and columns from begin to end of the information matrices of the values."""
        place = {pair: k for k, pair in enumerate(self.order)}
        rows = range(begin, end)
        return values[:, [[place[min(i, j), max(i, j)] for j in rows] for i in rows]]

    def translation_information(self, values: Floats) -> Floats:
        """(m, 3, 3) of the values on m lines; in the plane, z gets the mean of x and y."""
        d = self.dimension
        block = self._block(values, 0, d)
        if d == 3:
            return block
        result = np.zeros((len(values), 3, 3))
        result[:, :2, :2] = block
        result[:, 2, 2] = np.trace(block, axis1=1, axis2=2) / 2
        return result

    def cross_information(self, values: Floats) -> Floats:
        """(m, 3, 3) of the values on m lines: rows translation, columns rotation (about z last)."""
        d, matrices = self.dimension, self.matrices(values)
        result = np.zeros((len(matrices), 3, 3))
        result[:, :d, 3 - (matrices.shape[1] - d) :] = matrices[:, :d, d:]
        return result

    def rotation_information(self, values: Floats) -> Floats:
        """(m, 3, 3) of the values on m lines; in the plane, a multiple of the identity."""
        d = self.dimension
        block = self._block(values, d, 3 if d == 2 else 6)
        return block * np.eye(3) if d == 2 else block

    def information(
        self,
        translation: Floats,
        weights: Floats,
        rotation: Floats | None = None,
        cross: Floats | None = None,
    ) -> Floats:
        """Information matrices (m, d, d) of that of translations (m, 3, 3), and weights (m,).

        Or, in space, of that of rotations (m, 3, 3) and of both, rows translation (m, 3, 3).
        """
        d = self.dimension
        size = max(max(place) for place in self.order) + 1
        result = np.zeros((len(weights), size, size))
        result[:, :d, :d] = translation[:, :d, :d]
        turned = np.arange(d, size)
        result[:, turned, turned] = 2 * weights[:, None]
        if rotation is not None:
            result[:, d:, d:] = rotation
            if cross is not None:
                result[:, :d, d:] = cross
                result[:, d:, :d] = np.swapaxes(cross, 1, 2)
        return result


def _upper(size: int) -> tuple[tuple[int, int], ...]:
    return tuple((i, j) for i in range(size) for j in range(i, size))


G2O_3D = Dialect(
    vertex=b"VERTEX_SE3:QUAT",
    edge=b"EDGE_SE3:QUAT",
    dimension=3,
    turn=4,
    order=_upper(6),
    rotations=matrices_from_quaternions,
    numbers=quaternions_from_matrices,
    angles=("qx", "qy", "qz", "qw"),
)
G2O_2D = Dialect(
    vertex=b"VERTEX_SE2",
    edge=b"EDGE_SE2",
    dimension=2,
    turn=1,
    order=_upper(3),
    rotations=matrices_from_angles_about_z,
    numbers=angles_about_z,
    angles=("theta",),
)
TORO_3D = Dialect(
    vertex=b"VERTEX3",
    edge=b"EDGE3",
    dimension=3,
    turn=3,
    order=_upper(6),
    rotations=matrices_from_roll_pitch_yaw,
    numbers=roll_pitch_yaw_from_matrices,
    angles=("roll", "pitch", "yaw"),
)
TORO_2D = Dialect(
    vertex=b"VERTEX2",
    edge=b"EDGE2",
    dimension=2,
    turn=1,
    order=((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2)),
    rotations=matrices_from_angles_about_z,
    numbers=angles_about_z,
    angles=("theta",),
)
DIALECTS = (G2O_3D, G2O_2D, TORO_3D, TORO_2D)
