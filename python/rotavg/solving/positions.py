"""Where the nodes are, once it is known how they are turned: a linear least-squares problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import as_floats
from rotavg.base.errors import GraphError, SolverError, expect, require
from rotavg.graph.conventions import first_no_rotation
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import why_row_is_no_rotation
from rotavg.solving.chi_noise import ChiNoise
from rotavg.solving.pose_losses import LEAST_SHARE, PoseLoss, check_pose_loss, reweighted
from rotavg.solving.translation_fit import translation_residuals


def positions(
    graph: MeasurementGraph,
    rotations: ArrayLike,
    *,
    fixed: Mapping[int, ArrayLike] | None = None,
    loss: PoseLoss = "l2",
    loss_scale: float | Literal["auto"] = "auto",
    edge_shares: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Positions of the nodes, given their rotations, by one sparse linear solve.

    They minimise sum over the edges of r^T Omega r with r = R_ij^T (R_i^T (p_j - p_i) - t_ij), the
    translational part of chi^2 as g2o has it (Kuemmerle et al. 2011), for the given R. With a
    robust loss of chi = sqrt(r^T Omega r) there are several such solves, with less and less of
    the edges that the others contradict. Needs SciPy.

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

    Returns:
        (n, 3) in the world that `rotations` lead to.

    Raises:
        GraphError: the graph has no translations, these are not n rotations, or a fixed position
            is not finite or of no row, or shares are out of range.
        OptionError: a loss or scale that is none.
        MissingExtraError: SciPy is not installed.
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
    held, known = _known(graph, fixed or {})
    i, j = graph.indices.T
    steps = np.einsum("mab,mb->ma", R[i], measured.vectors)

    # Where all information is a multiple of the identity, x, y and z part: the scalar Laplacian
    # of the graph, and three right-hand sides. Otherwise every edge weighs with a 3 x 3 block.
    omega = measured.information
    weights = omega[:, :1, :1]
    if (omega == weights * np.eye(3)).all():
        steps = steps[:, None, :]
    else:
        world_from_j = R[i] @ graph.rotations
        weights = world_from_j @ omega @ np.swapaxes(world_from_j, 1, 2)
        steps = steps[:, :, None]
    weights = weights / np.abs(weights).max()
    counted = _shares(graph, edge_shares)

    def solved(left: NDArray[np.float64]) -> NDArray[np.float64]:
        of_edges = weights * (counted * left)[:, None, None]
        result = held.copy()
        with np.errstate(over="ignore", invalid="ignore"):
            result[~known] = _least_squares(n, i, j, of_edges, steps, held, known)
        if not np.isfinite(result).all():
            raise SolverError(
                "the positions cannot be solved for: the translations' numbers overflow"
            )
        return result

    def chi_with(left: NDArray[np.float64]) -> NDArray[np.float64]:
        return translation_residuals(graph, R, solved(left))[1]

    everything = np.ones(graph.num_edges)
    scale = check_pose_loss(loss, loss_scale)
    if loss == "l2":
        return solved(everything)
    noise = ChiNoise(graph)
    if scale is None and noise.num_series == 0:  # nothing checks any edge
        return solved(everything)
    left, _, _ = reweighted(
        chi_with,
        (everything, chi_with(everything)),
        loss,
        scale,
        lambda chi: noise(chi, measured.dimension),
        rounding=noise.rounding,
        graduate=loss != "huber",
    )
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


def _known(
    graph: MeasurementGraph, fixed: Mapping[int, ArrayLike]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Positions (n, 3), zero but where they are known, and which nodes (n,) these are."""
    result = np.zeros((graph.num_nodes, 3))
    known = np.zeros(graph.num_nodes, dtype=np.bool_)
    for row, position in fixed.items():
        if not (isinstance(row, (int, np.integer)) and 0 <= row < graph.num_nodes):
            expected = f"expected a row of the graph's nodes, 0 to {graph.num_nodes - 1}"
            raise GraphError(f"a position is fixed for row {row!r}, {expected}")
        result[row] = as_floats(position, (3,), f"position of row {row}")
        if not np.isfinite(result[row]).all():
            raise GraphError(f"position of row {row} is {result[row].tolist()}, expected finite")
        known[row] = True
    label = graph.components()
    first = np.unique(label, return_index=True)[1]
    anchored = np.zeros(len(first), dtype=np.bool_)
    anchored[label[known]] = True
    known[first[~anchored]] = True
    return result, known


def _least_squares(
    n: int,
    i: NDArray[np.int32],
    j: NDArray[np.int32],
    weights: NDArray[np.float64],
    steps: NDArray[np.float64],
    start: NDArray[np.float64],
    known: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """The unknown positions (u, 3) that minimise sum (p_j - p_i - step)^T W (p_j - p_i - step).

    `weights` (m, d, d) and `steps` (m, d, 3 / d): d = 3, or d = 1 for three problems at once.
    """
    sparse = require("scipy.sparse", "scipy")
    linalg = require("scipy.sparse.linalg", "scipy")
    d = weights.shape[1]
    unknown = np.flatnonzero(np.repeat(~known, d))
    if unknown.size == 0:
        return np.empty((0, 3))

    # The normal matrix has W on the diagonal at i and j, and -W at (i, j) and (j, i).
    offset = np.arange(d)
    rows = np.concatenate([i, j, i, j])[:, None, None] * d + offset[:, None] + 0 * offset
    columns = np.concatenate([i, j, j, i])[:, None, None] * d + offset + 0 * offset[:, None]
    values = np.concatenate([weights, weights, -weights, -weights])
    normal = sparse.csc_matrix(
        (values.ravel(), (rows.ravel(), columns.ravel())), shape=(n * d, n * d)
    )
    right = np.zeros((n, d, 3 // d))
    np.add.at(right, j, weights @ steps)
    np.subtract.at(right, i, weights @ steps)
    flat = right.reshape(n * d, 3 // d) - normal @ start.reshape(n * d, 3 // d)
    try:
        factor = linalg.splu(
            normal[unknown][:, unknown],
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:  # exactly singular: weights too far apart
        raise SolverError(f"the positions cannot be solved for: {error}") from error
    solved: NDArray[np.float64] = factor.solve(flat[unknown])
    return solved.reshape(-1, 3)
