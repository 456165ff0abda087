"""How far rotations are from a reference, after the best common rotation of every component."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import ReadOnly, read_only, rows_by_label
from rotavg.base.errors import GraphError
from rotavg.evaluation.known import Known, Rotations, by_common_ids, known
from rotavg.graph.ids import IdArray, rows_of

SHARES_DEG = (1, 2, 5, 10)


@dataclass(frozen=True, eq=False)
class Comparison(ReadOnly):
    """Angles between rotations and a reference.

    Attributes:
        angles: (k,) radians, after the alignment.
        rows: (k,) which rotations these are: all but those alone in their component, which could
            be turned to meet any reference.
        num_components: how many components these are in, each aligned by itself.
        left_out: how many rotations are alone in their component.
        nodes: (k,) their ids; where neither side had ids, the rows.
        only_in_rotations: how many nodes the reference does not have.
        only_in_reference: how many nodes it has in addition.
    """

    angles: NDArray[np.float64]
    rows: NDArray[np.int64]
    num_components: int
    left_out: int
    nodes: IdArray
    only_in_rotations: int
    only_in_reference: int

    @property
    def mean(self) -> float:
        """Mean angle, radians."""
        return float(self.angles.mean())

    @property
    def median(self) -> float:
        """Median angle, radians."""
        return float(np.median(self.angles))

    @property
    def rms(self) -> float:
        """Root of the mean square angle, radians."""
        return float(np.sqrt(np.mean(self.angles**2)))

    def share_below(self, angle: float) -> float:
        """Share of the nodes whose angle is below this one, radians."""
        return float(np.mean(self.angles < angle))

    def __str__(self) -> str:
        mean, median, rms = np.degrees([self.mean, self.median, self.rms])
        shares = [f"{100 * self.share_below(np.radians(d)):.3g} % below {d}" for d in SHARES_DEG]
        aligned = f" in {self.num_components} components" if self.num_components > 1 else ""
        alone = f"; {self.left_out} alone in a component left out" if self.left_out else ""
        for count, where in (
            (self.only_in_rotations, "missing in the reference"),
            (self.only_in_reference, "in the reference only"),
        ):
            alone += f"; {count} {where}" if count else ""
        return (
            f"{len(self.angles)} rotations{aligned}: median {median:.4g} deg, mean {mean:.4g}, "
            f"RMS {rms:.4g}; {', '.join(shares)} deg{alone}"
        )


def compare(
    rotations: Rotations,
    reference: Rotations,
    *,
    component: ArrayLike | None = None,
) -> Comparison:
    """Compare rotations with a reference, up to one common rotation from the left per component.

    That rotation is the one with the least sum of angles (Hartley, Aftab and Trumpf 2011: the L1
    mean, by Weiszfeld's algorithm from the best of the nodes), so that a few wrong rotations do
    not turn all the others away.

    Either may be a Solution, a dict from ids to matrices (3, 3) world_from_node, a tuple of ids
    (n,) and matrices (n, 3, 3), a file or a COLMAP model's folder that `rotavg.read_rotations`
    reads, or a `pycolmap.Reconstruction` (of which ids are the images' names, or where the other
    side has numbers, the images' ids): then nodes are
    matched by their ids, and those that only one of the two has are counted. Or it is an array
    (n, 3, 3) without ids, of the same nodes as the other in the same order.

    Args:
        rotations: what is compared.
        reference: what it is compared with.
        component: (n,) labels of the rows of `rotations`; each component has a gauge, and so an
            alignment, of its own. By default those of a solution, or in a file; two nodes are
            together where both sides have them so. Of arrays all are in one.

    Raises:
        GraphError: for what are no rotations, or do not match; where no node is in both, or no two
            are in one component.
        FormatError, FileAccessError: for a file that cannot be read.
    """
    ours, theirs = by_common_ids(known(rotations, "rotations"), known(reference, "reference"))
    n = len(ours.rotations)
    label = ours.component if component is None else _labels(component, n)
    if ours.nodes is None or theirs.nodes is None:
        if len(theirs.rotations) != n:
            raise GraphError(
                f"rotations have shape {ours.rotations.shape}, expected those of the reference, "
                f"{theirs.rotations.shape}: without ids on both sides the order tells the nodes"
            )
        here, there = np.arange(n), np.arange(n)
    else:
        rows = rows_of(ours.nodes, theirs.nodes)
        here = np.flatnonzero(rows >= 0)
        there = rows[here]
        if not len(here):
            example = f"{ours.nodes[0].item()!r} and {theirs.nodes[0].item()!r}"
            raise GraphError(f"no node is in both (ids are as {example}), expected common ids")
    sides = (label, here), (theirs.component, there)
    told = [np.asarray(side)[rows] for side, rows in sides if side is not None]
    groups = np.zeros(len(here), dtype=np.int64)
    for values in told:
        pairs = np.stack([groups, np.unique(values, return_inverse=True)[1].reshape(-1)], axis=1)
        groups = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
    return _aligned(ours.rotations[here], theirs.rotations[there], groups, here, ours.nodes, theirs)


def _labels(component: ArrayLike, n: int) -> NDArray[Any]:
    try:
        label = np.asarray(component)
    except ValueError as error:
        raise GraphError(f"component is not an array of labels: {error}") from None
    if label.shape != (n,):
        raise GraphError(f"component has shape {label.shape}, expected ({n},)")
    return label


def _aligned(
    R: NDArray[np.float64],
    S: NDArray[np.float64],
    label: NDArray[np.int64],
    rows: NDArray[np.int64],
    nodes: IdArray | None,
    reference: Known,
) -> Comparison:
    """Compare R (k, 3, 3), which are these rows of the nodes given, with S in every component."""
    _, label, count = np.unique(label, return_inverse=True, return_counts=True)
    compared = count[label] > 1
    if not compared.any():
        found = "no two rotations are in the same component"
        raise GraphError(f"{found}: one alone can be turned to meet any reference")
    angles = np.empty(len(R))
    for chosen in rows_by_label(label, len(count)):
        if len(chosen) > 1:
            left = S[chosen] @ np.swapaxes(R[chosen], 1, 2)
            angles[chosen] = _angles(left, _l1_mean(left))
    ids = nodes if nodes is not None else reference.nodes
    kept = rows[compared]
    return Comparison(
        read_only(angles[compared]),
        read_only(kept),
        num_components=int((count > 1).sum()),
        left_out=len(R) - int(compared.sum()),
        nodes=read_only(kept.copy() if ids is None else ids[kept]),
        only_in_rotations=(len(R) if nodes is None else len(nodes)) - len(R),
        only_in_reference=len(reference.rotations) - len(R),
    )


def _l1_mean(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    candidates = rotations[np.linspace(0, len(rotations) - 1, min(len(rotations), 100)).astype(int)]
    start = np.argmin([_angles(rotations, c).sum() for c in candidates])
    mean: NDArray[np.float64] = candidates[start]
    for _ in range(100):
        # With the weights of the L1 mean, the nearest rotation to the weighted sum.
        weights = 1 / np.maximum(_angles(rotations, mean), 1e-9)
        U, _, Vt = np.linalg.svd(np.einsum("k,kab->ab", weights / weights.sum(), rotations))
        next_mean = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        step = float(_angles(next_mean[None], mean)[0])
        mean = next_mean
        if step < 1e-10:
            break
    return mean


def _angles(rotations: NDArray[np.float64], to: NDArray[np.float64]) -> NDArray[np.float64]:
    chord = np.linalg.norm(rotations - to, axis=(1, 2)) / np.sqrt(8)
    return np.asarray(2 * np.arcsin(np.minimum(chord, 1)), dtype=np.float64)
