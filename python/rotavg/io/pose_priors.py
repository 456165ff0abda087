"""Priors of single poses, as the files of pose graphs and factor graphs hold them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import IncompleteWarning
from rotavg.io.places import Places
from rotavg.priors.priors import Priors

Floats = NDArray[np.float64]
_HELD = 1e9  # the information about a position that is constrained
_SAME = 1e-12  # rotations that differ in rounding


@dataclass(frozen=True, eq=False)
class PosePrior:
    """What one line, or factor, says of the pose world_from_node of a node.

    Attributes:
        node: its id.
        place: where it stands, for errors.
        line: of the file; None where no line is to blame.
        rotation: (3, 3).
        about_rotation: (3, 3) information about the turn e of rotation exp([e]), zero where
            nothing is known of it, infinite on the diagonal where it is held; in the plane the
            one number times I.
        position: (3,).
        about_position: (3, 3) information in the world; the same.
    """

    node: Any
    place: str
    line: int | None
    rotation: Floats
    about_rotation: Floats
    position: Floats
    about_position: Floats


@dataclass(frozen=True, eq=False)
class PriorsOfFile:
    """Priors as they stand in a file: what they say is read where they are used.

    Attributes:
        path: the file.
        count: how many they are.
        entries: the lines, or what else `parse` reads.
        parse: (path, entries) -> what they say; raises FormatError.
    """

    path: Path
    count: int
    entries: Sequence[Any] = field(repr=False)
    parse: Callable[[Path, Sequence[Any]], list[PosePrior]] = field(repr=False)

    @property
    def knows(self) -> str:
        """What they know beside the measurements."""
        return f"{self.count} prior{'s' * (self.count != 1)} of poses"

    @property
    def pose_priors(self) -> PriorsOfFile:
        """Themselves, as the source of a graph that keeps nothing else."""
        return self

    def select(self, edges: NDArray[np.bool_]) -> PriorsOfFile:
        """The same: they are of nodes."""
        return self


def priors_in(source: Any) -> PriorsOfFile | None:
    """The priors that the source of a graph holds; None without such."""
    found = getattr(source, "pose_priors", None)
    return found if isinstance(found, PriorsOfFile) else None


def of_poses(
    places: Places, nodes: Sequence[Any], rotations: Floats, positions: Floats, information: Floats
) -> list[PosePrior]:
    """Priors of whole poses.

    Args:
        places: of the k priors.
        nodes: k ids.
        rotations: (k, 3, 3).
        positions: (k, 3).
        information: (k, 6, 6) in the frame of the prior, translation first.
    """
    moved = rotations @ information[:, :3, :3] @ np.swapaxes(rotations, 1, 2)
    return [
        PosePrior(node, places.other(k), places.line(k), R, about[3:, 3:], where, in_world)
        for k, (node, R, where, about, in_world) in enumerate(
            zip(nodes, rotations, positions, information, moved)
        )
    ]


def tell(path: Path, notes: Sequence[str]) -> None:
    """Warn of what was mended, or is not used."""
    for note in notes:
        warnings.warn(f"{path}: {note}", IncompleteWarning, stacklevel=5)


def weight_of(about_rotation: Floats) -> float:
    """SE-Sync's concentration 3 / (2 tr(Omega^-1)) of information (3, 3) about a rotation.

    0 without information, infinite of what is held, NaN of information about some turns alone.
    """
    if not about_rotation.any():
        return 0.0
    if np.isinf(about_rotation).any():
        return float(np.inf)
    if np.linalg.eigvalsh(about_rotation)[0] <= 1e-13 * np.abs(about_rotation).max():
        return float(np.nan)
    return float(1.5 / np.trace(np.linalg.inv(about_rotation)))


def in_plane(omega: Floats) -> Floats:
    """Information (3, 3) about a position of which x and y are known: z gets their mean."""
    result = np.zeros((3, 3))
    result[:2, :2] = omega
    result[2, 2] = np.trace(omega) / 2
    return result


def priors_of(
    found: Iterable[PosePrior],
    error: Callable[[PosePrior, str], Exception],
    *,
    unit_weights: bool = False,
) -> Priors:
    """What these say of rotations and positions, for `rotavg.solve` and `rotavg.refine_poses`.

    Several of one node become one that adds the same to the objective, up to a constant. Of
    different rotations there is none, unless one is held.

    Args:
        found: the priors.
        error: (prior, reason) -> what is raised where information is about some turns alone, or
            two priors of a node have different rotations.
        unit_weights: weigh every rotation 1.
    """
    held: dict[Any, tuple[Floats, float, str]] = {}  # rotation, weight, and where it stands
    weighed: dict[Any, tuple[Floats, float, str]] = {}
    positions: dict[Any, tuple[Floats, Floats]] = {}
    for prior in found:
        node, R = prior.node, prior.rotation
        weight = weight_of(prior.about_rotation)
        if np.isnan(weight):
            raise error(prior, "has information about some rotations alone")
        if weight > 0:
            same = held if weight == np.inf else weighed
            P, given, before = same.get(node, (R, 0.0, prior.place))
            if np.abs(R - P).max() > _SAME:
                reason = f"is a second prior of node {node!r}, of another rotation than {before}"
                raise error(prior, f"{reason}; expected one at most")
            same[node] = P, given + (1.0 if unit_weights else weight), before
        omega = prior.about_position
        if np.isinf(omega).any():
            omega = _HELD * np.eye(3)
        if omega.any():
            one = prior.position, omega
            positions[node] = _both(positions[node], one) if node in positions else one
    return Priors(
        fixed={node: R for node, (R, _, _) in held.items()},
        absolute={node: (R, w) for node, (R, w, _) in weighed.items() if node not in held},
        positions=positions,
    )


def _both(one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """The position that two priors say together, and the information about it."""
    omega = one[1] + other[1]
    # From the first on, so that large coordinates keep their digits.
    step = np.linalg.lstsq(omega, other[1] @ (other[0] - one[0]), rcond=None)[0]
    return one[0] + step, omega
