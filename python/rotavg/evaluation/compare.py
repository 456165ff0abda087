"""How far rotations are from a reference, after the best common rotation of every component."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats, read_only, rows_by_label
from rotavg.base.errors import GraphError
from rotavg.graph.conventions import first_no_rotation
from rotavg.solving.solution import Solution

SHARES_DEG = (1, 2, 5, 10)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Angles between rotations and a reference.

    Attributes:
        angles: (k,) radians, after the alignment.
        rows: (k,) which rotations these are: all but those alone in their component, which could
            be turned to meet any reference.
        num_components: how many components these are in, each aligned by itself.
        left_out: how many rotations are alone in their component.
    """

    angles: NDArray[np.float64]
    rows: NDArray[np.int64]
    num_components: int
    left_out: int

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
        return (
            f"{len(self.angles)} rotations{aligned}: median {median:.4g} deg, mean {mean:.4g}, "
            f"RMS {rms:.4g}; {', '.join(shares)} deg{alone}"
        )


def compare(
    rotations: ArrayLike | Solution,
    reference: ArrayLike,
    *,
    component: ArrayLike | None = None,
) -> Comparison:
    """Compare rotations with a reference, up to one common rotation from the left per component.

    That rotation is the one with the least sum of angles (Hartley, Aftab and Trumpf 2011: the L1
    mean, by Weiszfeld's algorithm from the best of the nodes), so that a few wrong rotations do
    not turn all the others away.

    Args:
        rotations: (n, 3, 3) world_from_node, or a solution.
        reference: (n, 3, 3) of the same nodes, in the same order.
        component: (n,) labels; each component has a gauge, and so an alignment, of its own. By
            default those of the solution; of an array all are in one.

    Raises:
        GraphError: for arrays that do not match, or no two rotations in any component.
    """
    if isinstance(rotations, Solution):
        component = rotations.component if component is None else component
        rotations = rotations.rotations
    n = len(np.atleast_1d(np.asarray(reference, dtype=object)))
    if n == 0:
        raise GraphError("there are no rotations to compare")
    R = as_floats(rotations, (n, 3, 3), "rotations")
    S = as_floats(reference, (n, 3, 3), "reference")
    for name, values in (("rotations", R), ("reference", S)):
        bad = first_no_rotation(values)
        if bad is not None:
            raise GraphError(f"{name}: the matrix in row {bad} is not a rotation")
    label = np.zeros(n, dtype=np.int64) if component is None else np.asarray(component)
    if label.shape != (n,):
        raise GraphError(f"component has shape {label.shape}, expected ({n},)")
    _, label, count = np.unique(label, return_inverse=True, return_counts=True)
    compared = count[label] > 1
    if not compared.any():
        found = "no two rotations are in the same component"
        raise GraphError(f"{found}: one alone can be turned to meet any reference")
    angles = np.empty(n)
    for chosen in rows_by_label(label, len(count)):
        if len(chosen) > 1:
            left = S[chosen] @ np.swapaxes(R[chosen], 1, 2)
            angles[chosen] = _angles(left, _l1_mean(left))
    return Comparison(
        read_only(angles[compared]),
        read_only(np.flatnonzero(compared)),
        num_components=int((count > 1).sum()),
        left_out=n - int(compared.sum()),
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
