"""Rotations and positions of a pose graph together, from where averaging and `positions` lead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.base.errors import OptionError, expect
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.node_mapping import NodeMapping
from rotavg.priors.priors import Priors
from rotavg.solving import options
from rotavg.solving.chi_noise import ChiNoise
from rotavg.solving.known_edges import trusted_edges
from rotavg.solving.known_poses import known_poses
from rotavg.solving.normal_equations import NormalEquations
from rotavg.solving.pose_losses import LEAST_SHARE, PoseLoss, check_pose_loss, reweighted
from rotavg.solving.pose_terms import Between, Terms, chi_of, cost, measured_terms
from rotavg.solving.solution import Solution
from rotavg.solving.status import Status
from rotavg.solving.translation_fit import TranslationFit, translation_fit

Floats = NDArray[np.float64]

_LEAST_DAMPING = 1e-6
_MOST_DAMPING = 1e12
_ROUGHLY = 1e-3  # the tolerance, while edges are weighed anew
_NEGLIGIBLE = 1e-12  # a step, in radians and in parts of the graph's size


@dataclass(frozen=True, eq=False)
class PoseSolution(NodeMapping):
    """Poses of the nodes of a pose graph, and a mapping from the ids to their rotations.

    Attributes:
        solution: the averaged rotations that it started from, with their certificate.
        rotations: (n, 3, 3) world_from_node.
        positions: (n, 3) in that world.
        chi2: the sum that was minimised, at these poses.
        chi2_start: the same where it started.
        status: how it ended; where it converged, at a local minimum, which has no certificate.
        iterations: steps that were tried.
        loss: of the edges' chi; of a robust one chi^2 counts what it has left of them.
        loss_scale: in units of chi; infinite with "l2".
        edge_shares: (m,) what the loss has left of each edge's information, from 1 to 1e-12.
        priors: what was known; its rotations and positions hold the world.
    """

    solution: Solution
    rotations: Floats
    positions: Floats
    chi2: float
    chi2_start: float
    status: Status
    iterations: int
    loss: PoseLoss
    loss_scale: float
    edge_shares: Floats
    priors: Priors = field(default_factory=Priors)

    @property
    def graph(self) -> MeasurementGraph:  # type: ignore[override]
        """The graph of n nodes."""
        return self.solution.graph

    @property
    def component(self) -> NDArray[np.int32]:
        """(n,) label of each node's connected component."""
        return self.solution.component

    @cached_property
    def quaternions(self) -> Floats:
        """(n, 4) Hamilton quaternions xyzw, w >= 0."""
        return read_only(quaternions_from_matrices(self.rotations))

    @property
    def is_outlier(self) -> NDArray[np.bool_]:
        """(m,) of which edges the loss has left less than half, and those that are `solution`'s."""
        return read_only((self.edge_shares < 0.5) | self.solution.is_outlier)

    @property
    def inlier_graph(self) -> MeasurementGraph:
        """The graph of all nodes, without these edges.

        Raises GraphError if no edge is left.
        """
        dropped = self.is_outlier
        return self.graph.edge_subgraph(~dropped) if dropped.any() else self.graph

    @cached_property
    def translation_fit(self) -> TranslationFit:
        """How well the positions fit the translations of the edges that are no outliers."""
        fit = translation_fit(self.graph, self.rotations, self.positions, kept=~self.is_outlier)
        return replace(fit, resisted=self.loss != "l2")

    def __str__(self) -> str:
        steps = f"{self.iterations} step{'s' * (self.iterations != 1)}"
        text = f"chi^2 {self.chi2_start:.6g}, refined to {self.chi2:.9g} in {steps}; {self.status}"
        if self.loss == "l2":
            return text
        dropped = int((self.edge_shares < 0.5).sum())
        return (
            f"{text}; {self.loss}, scale {self.loss_scale:.3g}, leaves less than half of "
            f"{dropped} of {self.graph.num_edges} edges"
        )


def refine_poses(
    solution: Solution,
    *,
    fixed: Mapping[Any, tuple[Any, Any]] | None = None,
    priors: Priors | None = None,
    loss: PoseLoss = "l2",
    loss_scale: float | Literal["auto"] = "auto",
    trusted: ArrayLike | str | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-12,
) -> PoseSolution:
    """Refine rotations and positions together, to a local minimum of chi^2.

    chi^2 = sum over the edges of e^T Omega e, e the logarithm of Z_ij^-1 T_i^-1 T_j in SE(3), T_i
    the pose world_from_i, Z_ij the measured one, Omega the edge's whole information, as GTSAM's
    BetweenFactorPose3 and, in the plane, BetweenFactorPose2 have it. The start is the solution's
    rotations and the `positions` that fit them; the method is that of Levenberg and Marquardt.
    After a robust loss of the rotations the information is multiplied by the robust weights, or,
    with a `loss` here, only what that one has rejected is left out. Needs SciPy.

    Args:
        solution: of a graph that has `translations`. Its covariances are the rotations' inverse
            information; without them that of an edge of weight w is 2 w I.
        fixed: poses (rotation (3, 3), position (3,)) world_from_node of nodes that are held; by
            default of those that the file fixes which the graph was read from. Where nothing is
            known of a component, its first node stays where it is, at the origin.
        priors: what else is known, in units of the same weights: rotations, gravity and
            `Priors.positions`; by default what the solution was found with. No rigs.
        loss: of chi = sqrt(e^T Omega e) of every edge: "l2", "huber", "cauchy", "geman_mcclure" or
            "tls", for measurements some of which are wrong (docs/pose_graphs.md). The start is
            then that of positions with this loss, and every time that the poses have converged
            the edges are weighed anew, until that changes nothing.
        loss_scale: of a robust loss, in units of chi: standard deviations, if the information is
            right; "auto" several times the noise that most edges show.
        trusted: edges that a robust loss does not touch, as those of `solve`: a mask (m,), pairs of
            ids (k, 2), or "odometry"; by default those that were trusted in `solution`.
        max_iterations: limit on the number of steps that are tried.
        tolerance: stop when a step promises to lower chi^2 by no more than this share of it.

    Raises:
        GraphError: no translations; an edge whose information is not positive definite; what is
            fixed is no pose of a node, or is held by the priors as well; trusted edges that are
            none of the graph's.
        OptionError: an option out of range, a loss that is none, trusted edges without a robust
            one, or priors with rigs.
        MissingExtraError: SciPy is not installed.
        SolverError: the numbers are too large or too far apart.
    """
    expect(solution, Solution)
    limit = options.whole("max_iterations", max_iterations, 0, 2**31 - 1)
    tolerance = options.nonnegative("tolerance", tolerance)
    if priors is None:
        priors = Priors() if solution.grounded is None else solution.grounded.priors
    expect(priors, Priors)
    if priors.rigs:
        raise OptionError("poses are not refined with rigs among the priors")
    scale = check_pose_loss(loss, loss_scale)
    graph = solution.graph
    shares = solution.edge_weights / graph.weights
    trust = trusted_edges(graph, loss, trusted)
    if loss != "l2" and trusted is None:
        trust = solution.edge_verdicts == "trusted"
    if loss != "l2":  # a sharp loss leaves right edges a tenth or all, which is no information
        shares = np.where(solution.is_outlier, LEAST_SHARE, 1.0)
    measured = measured_terms(graph, shares)
    assert graph.translations is not None
    if fixed is None:
        fixed = getattr(graph.source, "fixed_poses", {})
    known = known_poses(solution, fixed, priors)
    free = ~known.held
    flat = graph.translations.dimension == 2
    if flat and not known.terms:
        free[:, 2:5] = False
    start = known.start(solution, loss, loss_scale, None if loss == "l2" else shares, trust)
    descent = _Descent(*start, measured, known.terms, free, limit, tolerance)
    left, used_scale = np.ones(graph.num_edges), np.inf
    settled = True
    noise = None if loss == "l2" else ChiNoise(graph)
    if noise is not None and (scale is not None or noise.num_series > 0):
        judged = measured_terms(graph, left)

        def chi(state: _State) -> Floats:
            return chi_of(judged, state.rotations, state.positions)

        left, used_scale, settled = reweighted(
            lambda shares: chi(descent.run(shares, _ROUGHLY)),
            (np.zeros(graph.num_edges), chi(descent.state)),
            loss,
            scale,
            lambda found: noise(found, 3 if flat else 6),
            rounding=noise.rounding,
            graduate=False,
            trusted=trust,
        )
    end = descent.run(left)
    rotations = _core.nearest_rotation(end.rotations)  # of what rounding has spoilt
    rotations[known.held[:, 3]] = end.rotations[known.held[:, 3]]
    return PoseSolution(
        solution, read_only(rotations), read_only(end.positions), end.chi2,
        descent.cost_of(*start, left),
        descent.status if settled else Status.ITERATION_LIMIT, descent.tried, loss, used_scale,
        read_only(left), priors,
    )  # fmt: skip


class _State:
    """Poses, and what they cost."""

    def __init__(self, rotations: Floats, positions: Floats, terms: Sequence[Terms]) -> None:
        self.rotations, self.positions, self._terms = rotations, positions, terms
        with np.errstate(all="ignore"):
            self.chi2 = sum(cost(t, rotations, positions) for t in terms)

    def after(self, step: Floats) -> _State:
        """T_i exp(step_i) to first order, (n, 6)."""
        turned = self.rotations @ matrices_from_rotvecs(step[:, 3:])
        moved = np.einsum("nab,nb->na", self.rotations, step[:, :3])
        return _State(turned, self.positions + moved, self._terms)

    def barely_moves(self, step: Floats) -> bool:
        """Whether nothing would change but for rounding."""
        size = max(float(np.ptp(self.positions, axis=0).max()), 1e-300)
        moved, turned = np.abs(step[:, :3]).max() / size, np.abs(step[:, 3:]).max()
        return bool(max(moved, turned) <= _NEGLIGIBLE)


class _Descent:
    """Steps down from poses, with less and less of some edges.

    Attributes:
        state: where it is.
        status: why the last run ended.
        tried: steps, of all runs.
    """

    def __init__(
        self,
        rotations: Floats,
        positions: Floats,
        measured: Between,
        others: Sequence[Terms],
        free: NDArray[np.bool_],
        limit: int,
        tolerance: float,
    ) -> None:
        self._measured, self._others, self._free = measured, others, free
        self._limit, self._tolerance = limit, tolerance
        self.state = _State(rotations, positions, [measured, *others])
        self.status, self.tried = Status.ITERATION_LIMIT, 0

    def run(self, left: Floats, tolerance: float = 0.0) -> _State:
        """Go on until a step promises nothing more, with shares (m,) of the edges' information."""
        terms = self._terms(left)
        self.state, self.status, tried = _descend(
            _State(self.state.rotations, self.state.positions, terms),
            NormalEquations(terms, self._free),
            self._limit - self.tried,
            max(self._tolerance, tolerance),
        )
        self.tried += tried
        return self.state

    def cost_of(self, rotations: Floats, positions: Floats, left: Floats) -> float:
        """What other poses cost with these shares."""
        return _State(rotations, positions, self._terms(left)).chi2

    def _terms(self, left: Floats) -> list[Terms]:
        omega = self._measured.omega * left[:, None, None]
        return [replace(self._measured, omega=omega), *self._others]


def _descend(
    state: _State, normal: NormalEquations, limit: int, tolerance: float
) -> tuple[_State, Status, int]:
    """Steps until one promises nothing more: where, why it ended, and how many were tried."""
    damping, tried = 0.0, 0
    normal.linearise(state.rotations, state.positions)
    while damping <= _MOST_DAMPING:
        step, promised = normal.step(damping)
        little = promised <= tolerance * state.chi2
        if step is not None and damping < 1 and (little or state.barely_moves(step)):
            return state, Status.GRADIENT_CONVERGED, tried
        if tried == limit:
            return state, Status.ITERATION_LIMIT, tried
        tried += 1
        after = None if step is None else state.after(step)
        if after is not None and after.chi2 < state.chi2:
            damping = damping / 10 if damping > _LEAST_DAMPING else 0.0
            state = after
            normal.linearise(state.rotations, state.positions)
        else:
            damping = max(_LEAST_DAMPING, 10 * damping)
    return state, Status.GRADIENT_CONVERGED, tried  # only rounding is left to gain
