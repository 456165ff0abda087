"""What is known beforehand of absolute rotations: some of them, which way is down, rigs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from rotavg.base.arrays import Brief
from rotavg.base.errors import expect
from rotavg.priors.checks import check_fixed, check_rigs


@dataclass(frozen=True, eq=False)
class Rigs(Brief):
    """Cameras mounted together: the frame f and sensor s of every image, R_i = Q_f C_s.

    Sensors whose rotation C is not given are estimated, together with the rotations Q of the
    frames. Sensors that occur in the same frames form one rig; where none of them is given, its
    first one is the reference and has C = I.

    Attributes:
        images: (frame, sensor) of a node, each an integer or a name; a sensor is in a frame once.
        rotations: C (3, 3) = rig_from_sensor of the sensors that are known.

    Raises:
        GraphError: an image has no frame and sensor, or those of another one; a rotation is none;
            or there are rotations, and of no sensor that an image has.
    """

    images: Mapping[Any, tuple[Any, Any]]
    rotations: Mapping[Any, ArrayLike] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_rigs(self.images, self.rotations)


@dataclass(frozen=True, eq=False)
class Priors(Brief):
    """Prior knowledge of the rotations R_i = world_from_i.

    With any of it but rigs alone, the world is no free gauge.

    Attributes:
        fixed: rotation (3, 3) of every node that is held.
        absolute: (rotation P (3, 3), weight w) of a node: w |R_i - P|_F^2 is added to the
            objective, as an edge of weight w from the world would add.
        gravity: (down d (3,), weight w) of a node, down in the frame of the node, of any length:
            2 w |R_i d - g|^2 is added, which makes a tilt count like the angle of an edge of
            weight w. The larger w, the more certain; only the heading stays free. From a file:
            `rotavg.io.read_gravity(path, graph)`, or `rotavg.read_priors`.
        down: g (3,), down in the world: by default (0, 1, 0), as COLMAP and GLOMAP have it.
        rigs: (frame, rotation C (3, 3)) of a node that is a camera of a calibrated rig: cameras
            with the same frame, an integer or a name, share its rotation Q, R_i = Q C with
            C = rig_from_camera. Or Rigs, where some sensors are not known (docs/rigs.md).
        positions: (position p (3,) in the world, information (3, 3)) of a node of a pose graph, for
            `refine_poses` alone: averaging rotations does not use them.

    Raises:
        GraphError: a fixed rotation is of an image of `Rigs` whose sensor is to be estimated.
    """

    fixed: Mapping[Any, ArrayLike] = field(default_factory=dict)
    absolute: Mapping[Any, tuple[ArrayLike, float]] = field(default_factory=dict)
    gravity: Mapping[Any, tuple[ArrayLike, float]] = field(default_factory=dict)
    down: ArrayLike = (0.0, 1.0, 0.0)
    rigs: Mapping[Any, tuple[Any, ArrayLike]] | Rigs = field(default_factory=dict)
    positions: Mapping[Any, tuple[ArrayLike, ArrayLike]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.rigs, Rigs) and isinstance(self.fixed, Mapping):
            check_fixed(self.fixed, self.rigs.images, self.rigs.rotations)

    @property
    def hold_world(self) -> bool:
        """Whether there is something that the world is held by."""
        return bool(self.fixed or self.absolute or self.gravity)


def check_priors(priors: Any) -> None:
    """ArgumentTypeError where these are no Priors."""
    expect(priors, Priors, ": rotavg.Priors(fixed=..., gravity=..., rigs=...)")
