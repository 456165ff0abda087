"""The main job: absolute rotations from relative ones, with a certificate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.errors import OptionError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.priors import Priors
from rotavg.solving import options
from rotavg.solving.anisotropic import check, refined, settings_of_start, with_covariances
from rotavg.solving.core_call import node_rotations
from rotavg.solving.gauge import in_mean_gauge
from rotavg.solving.known_edges import known_edges
from rotavg.solving.problem import Problem
from rotavg.solving.robust import Loss
from rotavg.solving.solution import Interrupted, Solution
from rotavg.solving.stop_request import heeded
from rotavg.solving.warm_start import warm_start

Method = Literal["auto", "bcd", "sum", "newton", "staircase", "bcdsr"]
Init = Literal[
    "auto",
    "shortest_path",
    "spanning_tree",
    "maximum_spanning_tree",
    "multilevel",
    "chordal",
    "quaternion",
    "random",
]
Stop = Literal["gradient", "step"]
Mu = Literal["adaptive", "min_eigenvalue"]
Gauge = Literal["first", "mean"]
WeightKind = Literal["auto", "precision", "frequency"]
Progress = _core.Progress
Callback = Callable[[Progress], Union[bool, None]]


def solve(
    graph: MeasurementGraph,
    *,
    method: Method = "auto",
    init: Init | ArrayLike | Solution = "auto",
    certify: bool = True,
    tolerance: float = 1e-9,
    stop: Stop = "gradient",
    max_iterations: int = 20000,
    time_limit: float | None = None,
    num_threads: int | None = None,
    callback: Callback | None = None,
    mu: Mu = "adaptive",
    accelerate: bool = False,
    max_rank: int = 10,
    seed: int = 0,
    certificate_tolerance: float = 1e-6,
    certificate_failure_probability: float = 1e-12,
    certificate_seed: int = 0,
    certificate_max_flops: float = 1e12,
    loss: Loss = "l2",
    loss_scale: float | Literal["auto"] = "auto",
    cycle_threshold: float | None = None,
    min_cycles: int = 3,
    weight_kind: WeightKind = "auto",
    trusted: ArrayLike | str | None = None,
    excluded: ArrayLike | None = None,
    edge_scales: ArrayLike | None = None,
    initial_weights: ArrayLike | None = None,
    priors: Priors | None = None,
    robust_priors: bool = True,
    anisotropic: bool | Literal["log"] = False,
    gauge: Gauge = "first",
) -> Solution:
    """Find the rotations that minimise sum of w |R_i R_ij - R_j|_F^2, and certify them.

    With a robust `loss`, find those that fit most of the measurements, and give little weight to
    the rest; the certificate is then that of the final weighted problem (`Solution.robust`,
    docs/robust.md).

    Args:
        graph: the measurements.
        method: "bcd" (block coordinate descent, Algorithm 2 of Dong, Xie and Shi 2021), "sum"
            (successive upper-bound minimisation, Algorithm 3, parallel), "newton" (Newton's method
            in the metric of the graph Laplacian), "staircase" (the Riemannian staircase of Boumal
            2015: the problem in 5 and more dimensions, where starts hardly matter, and down from
            there), "bcdsr" (block coordinate descent on the dense semidefinite relaxation, Eriksson
            et al. 2018: the paper's baseline, for comparison; 72 n^2 bytes), or "auto", which
            watches and chooses, and climbs the staircase where an answer is refuted.
        init: the initial value: "shortest_path" (Lemma 3), "spanning_tree" (along the edges that
            agree best with the triangles around them, after Enqvist, Kahl and Olsson 2011: the one
            for random outliers), "maximum_spanning_tree" (along the edges with the largest weights:
            the one for repeated structure, where weights are matches), "multilevel" (the graph is
            made coarser along its heaviest edges, and on the way back every level gets two sweeps:
            near the optimum where paths are long and trees drift; random graphs get the shortest
            paths), "chordal" (the linear relaxation of Martinec and Pajdla 2007),
            "quaternion" (that of Govindu 2001: nearer the optimum where the noise is small, worse
            where there are outliers), "random", rotations (n, 3, 3) world_from_node to start from,
            the Solution of another graph, one that had fewer or more nodes and edges (a warm start:
            nodes are found again by their ids, its components kept as they are, and these and the
            new nodes placed by the edges between them), or "auto": the shortest paths, or
            "multilevel" where these are long, but for the methods of the paper and with gravity;
            and, if "auto" chooses the method as well and the answer is refuted, a second run from
            the chordal value. With a robust `loss`, what is given replaces its first least squares.
        certify: whether to bound the distance from the global optimum.
        tolerance: when to stop, see `stop`.
        stop: "gradient" stops when the relative gradient (radians) is below the tolerance;
            "step" when the paper's relative step is. Of badly conditioned graphs the step says
            little.
        max_iterations: limit on the number of iterations.
        time_limit: limit in seconds on everything together; None for no limit.
        num_threads: None for all processors. The result has the same bits for any number.
        callback: called with a `Progress` for the initial value (iteration 0) and after every
            iteration; returning False stops.
        mu: how "sum" chooses mu: "adaptive", or "min_eigenvalue" as the paper prints it.
        accelerate: whether "bcd" and "sum" extrapolate from their last few iterates (Anderson's
            mixing, safeguarded): on trajectories it saves most of the iterations. One of "bcd" is
            then two sweeps, to and fro. The other methods have no use for it.
        max_rank: how many dimensions the staircase may climb to; below 5 it is not used.
        seed: of the "random" initial value.
        certificate_tolerance: the largest relative gap that is called optimal.
        certificate_failure_probability: how large a chance of being wrong a proof may have where
            one without would cost much more (`Certificate.failure_probability`,
            docs/certificate.md); 0 for none: then there may only be an estimate.
        certificate_seed: of the random start of such a proof; another one draws anew.
        certificate_max_flops: no factorisation of the proof takes more operations (of some 1e10 a
            second) than this.
        loss: "l2", or for data with outliers "auto" (the choice for most), "huber", "l1",
            "l_half", "cauchy", "geman_mcclure" or "tls" (truncated least squares), of the chord
            2 sin(angle / 2) of every residual angle. One of your own: docs/own_methods.md.
        loss_scale: where the loss begins to distrust, radians; "auto" for a multiple of the noise,
            which is estimated from the residuals. Priors have a scale of their own, always.
        cycle_threshold: with it, an edge is left out from the start if it has `min_cycles` or more
            short cycles, and each of them misses the identity by more than this angle, radians.
        min_cycles: how many short cycles are enough for that.
        weight_kind: what the weights say to a robust loss. "precision": the inverse variance of the
            noise, up to a common factor; residuals are judged in units of 1 / sqrt(weight), and a
            heavy edge does not outvote others by its weight. "frequency": how often an edge was
            measured; all residuals are judged alike, and a heavy edge has as many votes. "auto" is
            "precision" (docs/robust.md has the measurements).
        trusted: edges that a robust loss does not touch: "odometry", those between consecutive
            integers; or a mask (m,), or pairs of nodes (k, 2). By default none; but where ids say
            that the graph is a trajectory, "auto" takes edges to the next id for odometry, which is
            hardly ever wrong (docs/robust.md, Trajectories); [] switches that off.
        excluded: edges to leave out, likewise (but for a weight that keeps the graph connected).
        edge_scales: (m,) factors by which the scale of the loss and the threshold of outliers
            differ from edge to edge, instead of what the weights say.
        initial_weights: (m,) robust weights, 0 to 1, with which the first least squares are solved,
            in place of `l1`. From a Solution of a robust loss it goes on likewise.
        priors: what is known of the rotations beforehand (docs/priors.md): then they are those in
            the world of the priors, and the certificate is that of the problem with the priors.
        robust_priors: whether a robust loss is that of absolute priors and gravity, too, each kind
            with a noise of its own (`Solution.robust.gravity_priors`); fixed rotations stay fixed.
        anisotropic: whether to honour the covariances C of the graph (docs/covariances.md): the
            objective is then sum of 4 v^T C^-1 v with v = sin(|r| / 2) r / |r|, r = log(R_ij^T
            R_i^T R_j), which is r^T C^-1 r for small r, and it is certified. "auto" and "bcdsr"
            solve the problem with one weight for each edge first, which is `Solution.isotropic`,
            and go on from there; where the answer is refuted, "auto" climbs the staircase of a
            problem with blocks that bounds this one from below, and "staircase" does so at once.
            A prior of weight w counts as an edge of
            weight w (docs/priors.md). "log" goes on to a local minimum of sum of r^T C^-1 r itself
            by the method of Gauss and Newton; that one has no certificate.
        gauge: how components are turned that no prior holds. "first": their first node has the
            identity. "mean": the Karcher mean of their rotations (`karcher_mean`) is that of the
            rotations given as `init`, which is so preserved; without them, the identity.

    Returns:
        A Solution. That an iteration or time limit was hit is told by its `status`, not raised.

    Raises:
        OptionError: an option that does not exist or is out of range.
        GraphError: initial rotations that are not rotations, a Solution that has no node of the
            graph, priors or known edges that do not fit the graph.
        SolverError: the dense matrix of "bcdsr" does not fit in memory.
        KeyboardInterrupt: on Ctrl-C, within a fraction of a second. Where the iteration had
            converged, and only the certificate was to come, it is an Interrupted, which holds the
            solution.
    """
    start, origin = _start(graph, init)
    settings: dict[str, Any] = {
        "method": options.word("method", method),
        "init": init if isinstance(init, str) else "auto",
        "start": start,
        "seed": options.whole("seed", seed, 0, 2**64 - 1),
        "mu": options.word("mu", mu),
        "accelerate": bool(accelerate),
        "max_rank": options.whole("max_rank", max_rank, 0, 100),
        "stop": options.word("stop", stop),
        "tolerance": options.nonnegative("tolerance", tolerance),
        "max_iterations": options.whole("max_iterations", max_iterations, 0, 2**31 - 1),
        "time_limit": options.seconds(time_limit),
        "num_threads": options.threads(num_threads),
        "certify": bool(certify),
        "certificate_tolerance": options.nonnegative(
            "certificate_tolerance", certificate_tolerance
        ),
        "certificate_failure_probability": options.probability(
            "certificate_failure_probability", certificate_failure_probability
        ),
        "certificate_seed": options.whole("certificate_seed", certificate_seed, 0, 2**64 - 1),
        "certificate_max_flops": options.nonnegative(
            "certificate_max_flops", certificate_max_flops
        ),
        "callback": heeded(options.function(callback)),
        "loss": options.loss(loss),
        "loss_scale": options.of_loss(
            loss, "loss_scale", options.angle("loss_scale", loss_scale, "auto"), 0.0
        ),
        "cycle_threshold": options.angle("cycle_threshold", cycle_threshold, None),
        "min_cycles": options.whole("min_cycles", min_cycles, 1, 2**31 - 1),
        "weight_kind": options.of_loss(
            loss, "weight_kind", options.word("weight_kind", weight_kind), "auto"
        ),
        "robust_priors": bool(robust_priors),
        **known_edges(graph, loss, trusted, excluded, edge_scales, initial_weights),
    }
    if loss != "l2" and initial_weights is None and _is_robust(init):
        settings["initial_weights"] = np.ones(graph.num_edges)  # it goes on from where it was
    if gauge not in ("first", "mean"):
        raise OptionError(f"gauge is {gauge!r}; expected 'first' or 'mean'")
    if isinstance(anisotropic, np.bool_):
        anisotropic = bool(anisotropic)
    problem = Problem.of(graph, priors)
    if priors is not None and priors.rigs:
        settings["odometry"] = None  # images of rigs are no poses of a robot
    first = settings
    if anisotropic is not False:
        check(graph, anisotropic)
        first = settings_of_start(settings, problem)
    core = problem.solve(first, start_is_solution=origin == "solution")
    solution = problem.solution(core, origin, settings["certificate_tolerance"])
    interrupted = core["interrupted"]
    if anisotropic is not False and not interrupted:
        solution, interrupted = with_covariances(solution, settings)
    if anisotropic == "log" and not interrupted:
        solution = refined(solution, settings)
    if gauge == "mean":
        solution = in_mean_gauge(solution, start)
    if interrupted:
        raise Interrupted(solution)
    return solution


def _is_robust(init: object) -> bool:
    return isinstance(init, Solution) and init.robust is not None


def _start(
    graph: MeasurementGraph, init: Init | ArrayLike | Solution
) -> tuple[NDArray[np.float64] | None, str | None]:
    """Rotations (n, 3, 3) to start from and what they are; None for both where `init` is a name."""
    if isinstance(init, Solution):
        start = warm_start(graph, init.graph.nodes, init.rotations, init.component)
        return start, "solution"
    return (None, None) if isinstance(init, str) else (node_rotations(graph, init, "init"), "given")
