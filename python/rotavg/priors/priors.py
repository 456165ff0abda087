"""What is known beforehand of absolute rotations: some of them, which way is down, rigs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Rigs:
    """Which images the sensors of rigs took together: R_i = Q_f C_s.

    Sensors whose rotation C is not given are estimated, together with the rotations Q of the
    frames. What hangs together by frames is one rig; where none of its sensors is given, its first
    one is the reference and has C = I.

    Attributes:
        images: (frame, sensor) of a node, each an integer or a name; a sensor is in a frame once.
        rotations: C (3, 3) = rig_from_sensor of the sensors that are known.
    """

    images: Mapping[Any, tuple[Any, Any]]
    rotations: Mapping[Any, ArrayLike] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Priors:
    """Prior knowledge of the rotations R_i = world_from_i.

    With any of it but rigs alone, the world is no free gauge.

    Attributes:
        fixed: rotation (3, 3) of every node that is held.
        absolute: (rotation P (3, 3), weight w) of a node: w |R_i - P|_F^2 is added to the
            objective, as an edge of weight w from the world would add.
        gravity: (down d (3,), weight w) of a node, down in the frame of the node, of any length:
            2 w |R_i d - g|^2 is added, which makes a tilt count like the angle of an edge of
            weight w. The larger w, the more certain; only the heading stays free.
        down: g (3,), down in the world: by default (0, 1, 0), as COLMAP and GLOMAP have it.
        rigs: (frame, rotation C (3, 3)) of a node that is a camera of a calibrated rig: cameras
            with the same frame, an integer or a name, share its rotation Q, R_i = Q C with
            C = rig_from_camera. Or Rigs, where some sensors are not known (docs/rigs.md).
        positions: (position p (3,) in the world, information (3, 3)) of a node of a pose graph, for
            `refine_poses` alone: averaging rotations does not use them.
    """

    fixed: Mapping[Any, ArrayLike] = field(default_factory=dict)
    absolute: Mapping[Any, tuple[ArrayLike, float]] = field(default_factory=dict)
    gravity: Mapping[Any, tuple[ArrayLike, float]] = field(default_factory=dict)
    down: ArrayLike = (0.0, 1.0, 0.0)
    rigs: Mapping[Any, tuple[Any, ArrayLike]] | Rigs = field(default_factory=dict)
    positions: Mapping[Any, tuple[ArrayLike, ArrayLike]] = field(default_factory=dict)

    @property
    def hold_world(self) -> bool:
        """Whether there is something that the world is held by."""
        return bool(self.fixed or self.absolute or self.gravity)
