"""Where the nodes are, once it is known how they are turned: a linear least-squares problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, SolverError, expect
from rotavg.graph.conventions import first_no_rotation
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import why_row_is_no_rotation
from rotavg.solving.chi_noise import ChiNoise
from rotavg.solving.known_edges import trusted_edges
from rotavg.solving.pose_losses import (
    LEAST_SHARE,
    PoseLoss,
    check_pose_loss,
    reweighted,
    scale_of,
)
from rotavg.solving.translation_fit import translation_residuals

_DIVISORS = (4.0, 16.0, 64.0, 256.0)  # of the scale


def positions(
    graph: MeasurementGraph,
    rotations: ArrayLike,
    *,
    fixed: Mapping[int, ArrayLike] | None = None,
    loss: PoseLoss = "l2",
    loss_scale: float | Literal["auto"] = "auto",
    edge_shares: ArrayLike | None = None,
    trusted: ArrayLike | str | None = None,
) -> NDArray[np.float64]:
    """Positions of the nodes, given their rotations, by one sparse linear solve.

    They minimise sum over the edges of r^T Omega r with r = R_ij^T (R_i^T (p_j - p_i) - t_ij), the
    translational part of chi^2 as g2o has it (Kuemmerle et al. 2011), for the given R. With a
    robust loss of chi = sqrt(r^T Omega r) there are several such solves, with less and less of
    the edges that the others contradict.

    Args:
        graph: one that has `translations`.
        rotations: (n, 3, 3) world_from_node, rows as in `graph.nodes`.
        fixed: positions (3,) that are known, by row of `graph.nodes`. In a component without any,
            the first node is at the origin.
        loss: "l2", "huber", "cauchy", "geman_mcclure" or "tls" (docs/pose_graphs.md).
        loss_scale: of a robust loss, in units of chi: standard deviations, if the information is
            right; "auto" several times the noise that most edges show.
        edge_shares: (m,) from 0 to 1: what of each edge's information counts, by default all; so
            what a robust loss has left of their rotations.
        trusted: edges that a robust loss does not touch, as those of `solve`: a mask (m,), pairs of
            ids (k, 2), or "odometry".

    Returns:
        (n, 3) in the world that `rotations` lead to.

    Raises:
        GraphError: the graph has no translations, these are not n rotations, or a fixed position
            is not finite or of no row, shares are out of range, or trusted edges are none.
        OptionError: a loss or scale that is none, or trusted edges without a robust loss.
        SolverError: the numbers are too large or too far apart.
    """
    expect(graph, MeasurementGraph)
    measured = graph.translations
    if measured is None:
        raise GraphError("the graph has no relative translations, so its nodes have no positions")
    n = graph.num_nodes
    R = as_floats(rotations, (n, 3, 3), "rotations")
    bad = first_no_rotation(R)
    if bad is not None:
        node = graph.nodes[bad].item()
        raise GraphError(f"the matrix of node {node!r} {why_row_is_no_rotation(R, bad)}")
    rows, held = _held(graph, fixed or {})
    information = measured.information / np.abs(measured.information).max()
    counted = _shares(graph, edge_shares)
    trust = trusted_edges(graph, loss, trusted)

    def solved(left: NDArray[np.float64]) -> NDArray[np.float64]:
        omega = information * (counted * left)[:, None, None]
        try:
            return _core.positions(graph._core, R, measured.vectors, omega, rows, held)
        except _core.InvalidEdge as error:  # of information that underflows
            i, j = graph.edges[error.args[0]].tolist()
            where = f"edge {error.args[0]} ({i!r} -> {j!r})"
            raise SolverError(f"positions cannot be solved for: {where}: {error.args[1]}") from None
        except ValueError as error:
            raise SolverError(str(error)) from None

    def chi_with(left: NDArray[np.float64]) -> NDArray[np.float64]:
        return translation_residuals(graph, R, solved(left))[1]

    everything = np.ones(graph.num_edges)
    scale = check_pose_loss(loss, loss_scale)
    if loss == "l2":
        return solved(everything)
    noise = ChiNoise(graph)
    if scale is None and noise.num_series == 0:  # nothing checks any edge
        return solved(everything)

    def noise_of(chi: NDArray[np.float64]) -> float:
        return noise(chi, measured.dimension)

    start = (everything, chi_with(everything))

    def weighed(scale: float | None) -> tuple[NDArray[np.float64], float]:
        left, used, _ = reweighted(
            chi_with,
            start,
            loss,
            scale,
            noise_of,
            rounding=noise.rounding,
            graduate=loss != "huber",
            trusted=trust,
        )
        return left, used

    left, used = weighed(scale)
    if scale is None and loss != "huber":
        # Wrong edges may have bent everything until that looked like noise: a far smaller scale is
        # right if what it leaves shows no more than its noise, and most cycles stay.
        for divisor in _DIVISORS:
            other, _ = weighed(used / divisor)
            shown = scale_of(loss, noise_of(chi_with(other)))
            if shown <= used / divisor and 2 * (other < 0.5).sum() <= noise.num_cycles:
                left, _ = weighed(shown)
    return solved(left)


def _shares(graph: MeasurementGraph, given: ArrayLike | None) -> NDArray[np.float64]:
    if given is None:
        return np.ones(graph.num_edges)
    result = as_floats(given, (graph.num_edges,), "edge_shares")
    bad = ~((result >= 0) & (result <= 1))
    if bad.any():
        edge = int(np.argmax(bad))
        raise GraphError(
            f"edge_shares of edge {edge} is {result[edge]}; expected a number from 0 to 1",
            edge=edge,
        )
    return np.maximum(result, LEAST_SHARE)


def _held(
    graph: MeasurementGraph, fixed: Mapping[int, ArrayLike]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Rows (k,) whose positions are known, and these (k, 3)."""
    held = np.zeros((len(fixed), 3))
    for k, (row, position) in enumerate(fixed.items()):
        if not (isinstance(row, (int, np.integer)) and 0 <= row < graph.num_nodes):
            expected = f"expected a row of the graph's nodes, 0 to {graph.num_nodes - 1}"
            raise GraphError(f"a position is fixed for row {row!r}, {expected}")
        held[k] = as_floats(position, (3,), f"position of row {row}")
        if not np.isfinite(held[k]).all():
            raise GraphError(f"position of row {row} is {held[k].tolist()}, expected finite")
    return np.array(list(fixed), dtype=np.int32), held
