"""How well the positions of a pose graph fit its translations, and whether some must be wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError, expect
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving.chi_noise import ChiNoise

Floats = NDArray[np.float64]

# Of the public graphs, whose information is uneven, no edge lies beyond 20 times the noise that
# most show, and .4 % beyond 10 times.
_FAR, _NEAR, _MANY = 30, 10, 0.02
_LEAST_SERIES = 20  # fewer do not tell noise from errors


@dataclass(frozen=True, eq=False)
class TranslationFit:
    """What the translations of a graph miss the positions by.

    Attributes:
        edges: (m, 2) ids.
        lengths: (m,) |r|, r = R_ij^T (R_i^T (p_j - p_i) - t_ij), in units of the file.
        chi: (m,) sqrt(r^T Omega r): standard deviations, if the information is right.
        kept: (m,) which edges count in what follows: those that no robust loss has rejected.
        noise: of chi along an axis, as most edges show it; 0 where no cycle checks any.
        num_beyond: edges that lie so far beyond it (`times`) that they, or others, must be wrong;
            0 where that is not sure.
        times: so many times the noise.
        resisted: whether a robust loss of the poses was in use.
    """

    edges: NDArray[Any]
    lengths: Floats
    chi: Floats
    kept: NDArray[np.bool_]
    noise: float
    num_beyond: int
    times: int
    resisted: bool = False

    @property
    def chi2(self) -> float:
        """The sum of chi^2 of the edges that are kept."""
        return float(self.chi[self.kept] @ self.chi[self.kept])

    @property
    def advice(self) -> str | None:
        """What to do where translations must be wrong; None where that is not sure."""
        if self.num_beyond == 0:
            return None
        wrong = (
            f"{self.num_beyond} of {int(self.kept.sum())} edges lie beyond {self.times} times the "
            "noise that most show, so some translations are wrong"
        )
        if self.resisted:
            return f"{wrong}, and the loss of the poses kept them: another one, or a smaller scale"
        return (
            f'{wrong}: a robust loss (refine_poses(loss="tls"), --refine-poses --pose-loss tls) '
            "resists them"
        )

    @property
    def worst(self) -> int:
        """The row of the edge with the largest chi of those that are kept."""
        return int(np.argmax(np.where(self.kept, self.chi, -1.0)))

    def summary(self) -> dict[str, Any]:
        """The figures, as `rotavg solve --json` prints them."""
        lengths = self.lengths[self.kept]
        return {
            "edges": len(lengths),
            "median": float(np.median(lengths)),
            "largest": float(lengths.max()),
            "chi2": self.chi2,
            "noise_chi": self.noise,
            "largest_chi": float(self.chi[self.worst]),
            "worst_edge": self.edges[self.worst].tolist(),
            "beyond": self.num_beyond,
            "advice": self.advice,
        }

    def __str__(self) -> str:
        lengths = self.lengths[self.kept]
        i, j = self.edges[self.worst].tolist()
        told = (
            "translations are missed"
            if self.kept.all()
            else (f"the translations of {len(lengths)} edges that are no outliers are missed")
        )
        return (
            f"{told} by {np.median(lengths):.3g} (median) and up to {lengths.max():.3g}; their "
            f"chi^2 is {self.chi2:.6g}, the largest part of it that of edge {i!r} -> {j!r}"
            + ("" if self.advice is None else f"; {self.advice}")
        )


def translation_fit(
    graph: MeasurementGraph,
    rotations: ArrayLike,
    positions: ArrayLike,
    *,
    kept: ArrayLike | None = None,
) -> TranslationFit:
    """How well positions fit the translations of a graph, for given rotations.

    Some translations must be wrong where an edge lies beyond 30 times the noise that most show, or
    2 % of them beyond 10 times; edges in series count once, and bridges do not.

    Args:
        graph: one that has `translations`.
        rotations: (n, 3, 3) world_from_node, rows as in `graph.nodes`.
        positions: (n, 3) in that world.
        kept: (m,) booleans, which edges count: those that no robust loss has rejected; by default
            all, and all where that leaves none.

    Raises:
        GraphError: the graph has no translations, or arrays of the wrong shape.
    """
    expect(graph, MeasurementGraph)
    n = graph.num_nodes
    R = as_floats(rotations, (n, 3, 3), "rotations")
    p = as_floats(positions, (n, 3), "positions")
    lengths, chi = translation_residuals(graph, R, p)
    assert graph.translations is not None
    counted = np.ones(graph.num_edges, dtype=np.bool_) if kept is None else np.asarray(kept)
    if counted.dtype != np.bool_ or counted.shape != (graph.num_edges,):
        found = f"kept has shape {counted.shape} and type {counted.dtype}"
        raise GraphError(f"{found}, expected booleans ({graph.num_edges},)")
    if not counted.any():
        counted = np.ones_like(counted)
    scatter = ChiNoise(graph)
    noise = scatter(chi, graph.translations.dimension)
    beyond, times = 0, _FAR
    if scatter.num_series >= _LEAST_SERIES and noise > 0:
        of_series, of_edges = (
            scatter.of_series(chi, counted) / noise,
            scatter.standardised(chi) / noise,
        )
        times = _FAR if of_series.max() > _FAR else _NEAR
        if times == _FAR or np.mean(of_series > _NEAR) > _MANY:
            beyond = int((of_edges[counted] > times).sum())
    return TranslationFit(
        graph.edges,
        read_only(lengths),
        read_only(chi),
        read_only(counted.copy()),
        noise,
        beyond,
        times,
    )


def translation_residuals(
    graph: MeasurementGraph, rotations: Floats, positions: Floats
) -> tuple[Floats, Floats]:
    """Lengths (m,) and chi (m,) of what the translations miss; GraphError without any."""
    measured = graph.translations
    if measured is None:
        raise GraphError("the graph has no relative translations, so its nodes have no positions")
    i, j = graph.indices.T
    with np.errstate(over="ignore", invalid="ignore"):
        r = np.einsum("mba,mb->ma", rotations[i], positions[j] - positions[i]) - measured.vectors
        r = np.einsum("mba,mb->ma", np.asarray(graph.rotations), r)
        chi2 = np.einsum("ma,mab,mb->m", r, measured.information, r)
    return np.linalg.norm(r, axis=1), np.sqrt(np.maximum(chi2, 0.0))
