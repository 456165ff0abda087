"""The smallest eigenvalues of the certificate's matrix S = Lambda - Rt (Theorem 1)."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats
from rotavg.base.errors import OptionError, require
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.plot.canvas import axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rotavg.solving.solution import Solution

_DENSE = 600  # rows up to which the full matrix is decomposed
_WELL_CONNECTED = 0.02  # lambda_2 over the mean degree from which the degrees precondition enough


def spectrum(solution: Solution, ax: Axes | None = None, *, count: int = 12) -> Axes:
    """The `count` smallest eigenvalues of S, of the largest component.

    At a stationary point three of them are zero (the gauge). S >= 0 proves that the rotations are
    globally optimal (Theorem 1 of Dong, Xie and Shi 2021); a negative eigenvalue refutes it. This
    picture is an estimate in floating point, the proof is in `solution.certificate`.

    Args:
        solution: whose S, with the weights that its edges had in the objective.
        ax: axes to draw into; a new figure's by default.
        count: number of eigenvalues.

    Raises:
        OptionError: for a solution with priors, rigs, headings or full covariances, whose
            certificate is by another matrix.
        MissingExtraError: Matplotlib or SciPy is not installed.
    """
    _check_has_this_matrix(solution)
    drawn = axes(ax)
    graph, R = _largest(solution)
    count = min(count, 3 * graph.num_nodes)
    S = certificate_matrix(graph, R)
    values = smallest_eigenvalues(graph, S, count)
    rounding = 3 * graph.num_nodes * np.finfo(np.float64).eps * float(S.diagonal().max())
    gauge = np.arange(count) < 3
    refuted = values < -rounding
    drawn.axhspan(-rounding, rounding, color="0.9", label="zero to rounding")
    for chosen, colour, label in (
        (gauge & ~refuted, "0.5", "the gauge: zero at a stationary point"),
        (~gauge & ~refuted, "tab:blue", "others"),
        (refuted, "tab:red", "negative: not optimal"),
    ):
        if chosen.any():
            number = np.flatnonzero(chosen) + 1
            drawn.plot(number, values[chosen], "o", color=colour, label=label)
    drawn.set_yscale("symlog", linthresh=10 * rounding)
    locator: Any = drawn.yaxis.get_major_locator()
    locator.set_params(numticks=8)
    drawn.set(
        xlabel="number, from the smallest",
        ylabel="eigenvalue of S [unit of the weights]",
        title=f"{count} smallest of {3 * graph.num_nodes} eigenvalues of S",
    )
    drawn.legend()
    return drawn


def _check_has_this_matrix(solution: Solution) -> None:
    for has, what in (
        (bool(solution.anisotropic), "full covariances"),
        (solution.upright, "headings"),
        (solution.rigs is not None, "rigs"),
        (solution.grounded is not None, "priors"),
    ):
        if has:
            raise OptionError(
                f"the spectrum is that of S for rotations alone; this solution has {what}, and its "
                "certificate is by another matrix (solution.certificate)"
            )


def certificate_matrix(graph: MeasurementGraph, rotations: ArrayLike) -> Any:
    """S in the frame of the solution as a SciPy CSR array (3n, 3n).

    With E_ij = R_i R_ij R_j^T: blocks -w_ij E_ij off the diagonal, the symmetric part of
    sum_j w_ij E_ij on it. The eigenvalues are those of S, the null vectors of a stationary point
    are constant. MissingExtraError without SciPy.
    """
    sparse = require("scipy.sparse", "scipy")
    n = graph.num_nodes
    R = as_floats(rotations, (n, 3, 3), "rotations")
    i, j = graph.indices.astype(np.int64).T
    E = graph.weights[:, None, None] * (R[i] @ graph.rotations @ np.swapaxes(R[j], 1, 2))
    diagonal = np.zeros((n, 3, 3))
    symmetric = (E + np.swapaxes(E, 1, 2)) / 2
    np.add.at(diagonal, i, symmetric)
    np.add.at(diagonal, j, symmetric)
    k = np.arange(n)
    blocks = np.concatenate([diagonal, -E, -np.swapaxes(E, 1, 2)])
    rows, columns = np.concatenate([k, i, j]), np.concatenate([k, j, i])
    inside = np.arange(3)
    at = np.broadcast_arrays(
        3 * rows[:, None, None] + inside[:, None], 3 * columns[:, None, None] + inside
    )
    return sparse.coo_array(
        (blocks.ravel(), (at[0].ravel(), at[1].ravel())), shape=(3 * n, 3 * n)
    ).tocsr()


def smallest_eigenvalues(graph: MeasurementGraph, S: Any, count: int) -> NDArray[np.float64]:
    """The smallest eigenvalues (count,) of S, ascending, of a connected graph.

    By LOBPCG, preconditioned by a factorisation of the scalar graph Laplacian, which S is close to
    in the frame of a solution; by the degrees alone where these do, as factors would fill in.
    """
    linalg = require("scipy.linalg", "scipy")
    if S.shape[0] <= max(_DENSE, 5 * count):
        values = linalg.eigh(S.toarray(), eigvals_only=True, subset_by_index=[0, count - 1])
        return np.asarray(values)
    sparse_linalg = require("scipy.sparse.linalg", "scipy")
    n = graph.num_nodes
    rng = np.random.default_rng(0)
    start = rng.standard_normal((3 * n, count + 3))
    start[:, :3] = np.tile(np.eye(3), (n, 1))
    solve = _preconditioner(graph)
    preconditioner = sparse_linalg.LinearOperator(
        S.shape,
        matvec=lambda x: solve(x.reshape(n, -1)).reshape(-1, 1),
        matmat=lambda X: solve(X.reshape(n, -1)).reshape(3 * n, -1),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a tolerance not reached: close enough for a picture
        values, _ = sparse_linalg.lobpcg(
            S, start, M=preconditioner, largest=False, tol=1e-7 * S.diagonal().max(), maxiter=150
        )
    return np.sort(values)[:count]


def _preconditioner(graph: MeasurementGraph) -> Any:
    """Solves (L + a little) X = B for B (n, k), or divides by the degrees."""
    sparse = require("scipy.sparse", "scipy")
    n = graph.num_nodes
    i, j = graph.indices.T
    w = graph.weights
    adjacency = sparse.coo_array((w, (i, j)), shape=(n, n))
    degree = np.bincount(i, w, n) + np.bincount(j, w, n)
    connectivity = _core.algebraic_connectivity(graph._core, 0)
    if connectivity > _WELL_CONNECTED * degree.mean():
        return lambda B: B / degree[:, None]
    shifted = sparse.diags_array(degree + 0.1 * connectivity) - adjacency - adjacency.T
    factor = require("scipy.sparse.linalg", "scipy").splu(
        shifted.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
    )
    return factor.solve


def _largest(solution: Solution) -> tuple[MeasurementGraph, NDArray[np.float64]]:
    """The graph of the component with the most nodes, weighted as solved, and its rotations."""
    graph = solution.graph.with_weights(solution.edge_weights)
    largest = solution.component == np.argmax(np.bincount(solution.component))
    if largest.all():
        return graph, solution.rotations
    return graph.subgraph(graph.nodes[largest]), solution.rotations[largest]
