"""The main job: absolute rotations from relative ones, and a certificate for any rotations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeVar, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError, OptionError, SolverError
from rotavg.graph.covariances import precision_of_weight_one
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.grounded import ground
from rotavg.priors.priors import Priors
from rotavg.priors.rigs import is_rigs, sensors_of
from rotavg.solving import options
from rotavg.solving.anisotropic import (
    START_TOLERANCE,
    check,
    given_precisions,
    refined,
    with_covariances,
)
from rotavg.solving.certificate import Certificate, certificate_from_core
from rotavg.solving.edge_masks import edge_mask, edge_values
from rotavg.solving.gauge import in_mean_gauge
from rotavg.solving.online import OnlineSolution
from rotavg.solving.robust import Loss, RobustFit
from rotavg.solving.solution import Interrupted, Solution
from rotavg.solving.status import Status, Timings, Trace
from rotavg.solving.warm_start import warm_start

Method = Literal["auto", "bcd", "sum", "newton", "staircase", "bcdsr"]
Init = Literal[
    "auto",
    "shortest_path",
    "spanning_tree",
    "maximum_spanning_tree",
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

# Rows as in the nodes of a graph, or a rotation for each of their ids.
NodeRotations = Union[ArrayLike, Solution, OnlineSolution, Mapping[Any, NDArray[np.float64]]]

_Result = TypeVar("_Result")


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
    trusted: ArrayLike | None = None,
    excluded: ArrayLike | None = None,
    edge_scales: ArrayLike | None = None,
    initial_weights: ArrayLike | None = None,
    priors: Priors | None = None,
    robust_priors: bool = True,
    anisotropic: bool | Literal["log"] = False,
    gauge: Gauge = "first",
) -> Solution:
    """Find the rotations that minimise sum of w |R_i R_ij - R_j|_F^2, and certify them.

    With a robust `loss`, those that fit most of the measurements whatever the others say: then the
    certificate is that of the final weighted problem (`Solution.robust`, docs/robust.md).

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
            the one for repeated structure, where weights are matches), "chordal" (the linear
            relaxation of Martinec and Pajdla 2007),
            "quaternion" (that of Govindu 2001: nearer the optimum where the noise is small, worse
            where there are outliers), "random", rotations (n, 3, 3) world_from_node to start from,
            the Solution of another graph, one that had fewer or more nodes and edges (a warm start:
            nodes are found again by their ids, its components kept as they are, and these and the
            new nodes placed by the edges between them), or "auto": the shortest paths and, if
            "auto" chooses the method as well and the answer is refuted, a second run from the
            chordal value. With a robust `loss`, what is given replaces its first least squares.
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
            2 sin(angle / 2) of every residual angle.
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
        trusted: edges that a robust loss does not touch, as odometry: a mask (m,), or pairs of
            nodes (k, 2).
        excluded: edges to leave out, likewise (but for a weight that keeps the graph connected).
        edge_scales: (m,) factors by which the scale of the loss and the threshold of outliers
            differ from edge to edge, instead of what the weights say.
        initial_weights: (m,) robust weights, 0 to 1, with which the first least squares are solved.
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
    start, origin = None, None
    if isinstance(init, Solution):
        start = warm_start(graph, init.graph.nodes, init.rotations, init.component)
        origin = "solution"
    elif not isinstance(init, str):
        start, origin = _node_rotations(graph, init, "init"), "given"
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
        "callback": options.function(callback),
        "loss": options.word("loss", loss),
        "loss_scale": options.angle("loss_scale", loss_scale, "auto"),
        "cycle_threshold": options.angle("cycle_threshold", cycle_threshold, None),
        "min_cycles": options.whole("min_cycles", min_cycles, 1, 2**31 - 1),
        "weight_kind": options.word("weight_kind", weight_kind),
        "robust_priors": bool(robust_priors),
        **_known_edges(graph, loss, trusted, excluded, edge_scales, initial_weights),
    }

    if gauge not in ("first", "mean"):
        raise OptionError(f"gauge is {gauge!r}; expected 'first' or 'mean'")
    sensors = sensors_of(graph, priors) if priors is not None and is_rigs(priors) else None
    grounded = None if priors is None or sensors is not None else ground(graph, priors)
    first = settings
    if anisotropic is not False:
        known = grounded is not None or sensors is not None
        check(graph, anisotropic)
        rough = max(settings["tolerance"], START_TOLERANCE)
        if sensors is not None:
            rough = settings["tolerance"]  # what is found of the sensors stays
        first = {**settings, "certify": False, "stop": "gradient", "tolerance": rough}
        if loss == "l2" and not known and (start is not None or method == "staircase"):
            first["max_iterations"] = 0  # from there at once
            if method == "staircase":
                first["method"] = "bcd"
    try:
        core = _call_core(
            graph,
            _core.solve,
            **first,
            priors=None if grounded is None else grounded.core,
            start_is_solution=origin == "solution",
            rigs=None if sensors is None else sensors.core,
            rig_priors=None if sensors is None else sensors.others,
        )
    except _core.InvalidPrior as error:
        assert sensors is not None
        raise sensors.error(error) from None
    except ValueError as error:
        if not str(error).startswith(("all edges are between", "the rotations of all nodes are")):
            raise  # what a callback raises is the caller's
        raise GraphError(str(error)) from None
    rigs = None
    if sensors is not None:
        final = core["robust"]["edge_weights"] if "robust" in core else graph.weights
        rigs = sensors.fit(core["rigs"], core["rotations"], core["objective"], final)
        grounded = sensors.grounded(rigs)
    robust = None
    if "robust" in core:
        robust = RobustFit.from_core(core["robust"], graph)
        if priors is not None and grounded is not None:
            robust = robust.with_priors(graph, priors)
            grounded = grounded.with_prior_weights(robust.absolute_priors, robust.gravity_priors)
    solution = Solution(
        graph=graph,
        rotations=read_only(core["rotations"]),
        objective=core["objective"],
        gradient_norm=core["gradient_norm"],
        relative_gradient=core["relative_gradient"],
        status=Status[core["status"].upper()],
        iterations=core["iterations"],
        method=core["method"],
        reason=core["reason"],
        init=origin or core["init"],
        trace=Trace(**{name: read_only(values) for name, values in core["trace"].items()}),
        timings=Timings(**core["seconds"]),
        certificate=certificate_from_core(core["certificate"], settings["certificate_tolerance"]),
        component=read_only(core["component"]),
        robust=robust,
        grounded=grounded,
        rigs=rigs,
    )
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


def _known_edges(
    graph: MeasurementGraph,
    loss: str,
    trusted: ArrayLike | None,
    excluded: ArrayLike | None,
    edge_scales: ArrayLike | None,
    initial_weights: ArrayLike | None,
) -> dict[str, Any]:
    """What is known of the edges beforehand, as the core takes it."""
    if not isinstance(graph, MeasurementGraph):
        raise GraphError(f"found a {type(graph).__name__}, expected a MeasurementGraph")
    robust = {"trusted": trusted, "edge_scales": edge_scales, "initial_weights": initial_weights}
    for name, value in robust.items():
        if value is not None and loss == "l2":
            raise OptionError(f'{name} is for a robust loss, and this is "l2"')
    trust, left_out = edge_mask(graph, "trusted", trusted), edge_mask(graph, "excluded", excluded)
    if trust is not None and left_out is not None and (trust & left_out).any():
        i, j = graph.edges[np.argmax(trust & left_out)].tolist()
        raise OptionError(f"the edge ({i!r}, {j!r}) is both trusted and excluded")
    return {
        "trusted": trust,
        "excluded": left_out,
        "edge_scales": edge_values(graph, "edge_scales", edge_scales, 1e-50, 1e50),
        "initial_weights": edge_values(graph, "initial_weights", initial_weights, 0.0, 1.0),
    }


def certify(
    graph: MeasurementGraph,
    rotations: NodeRotations,
    *,
    priors: Priors | None = None,
    anisotropic: bool = False,
    tolerance: float = 1e-6,
    failure_probability: float = 1e-12,
    seed: int = 0,
    max_flops: float = 1e12,
    time_limit: float | None = None,
    num_threads: int | None = None,
) -> Certificate:
    """Bound how far any rotations are from the global optimum, whoever found them.

    Args:
        graph: the measurements.
        rotations: (n, 3, 3) world_from_node, rows as in `graph.nodes`; or a solution or a dict,
            which have them by id. They need not be stationary.
        priors: what is known beforehand: then the rotations are in the world of the priors, and the
            bound is that of the problem with them.
        anisotropic: whether for the objective with the full covariances of the graph (see `solve`).
        tolerance: the largest relative gap that is called optimal.
        failure_probability: how large a chance of being wrong a proof may have where one without
            would cost much more; 0 for none: then there may only be an estimate.
        seed: of the random start of such a proof.
        max_flops: no factorisation takes more operations than this.
        time_limit: limit in seconds; the verdict is "not_certified" where it is hit.
        num_threads: None for all processors.

    Raises:
        GraphError: if these are not n rotations, or not where `priors` hold them.
        OptionError: for an option out of range.
    """
    grounded = None if priors is None else ground(graph, priors)
    limits: dict[str, Any] = {
        "tolerance": options.nonnegative("tolerance", tolerance),
        "max_flops": options.nonnegative("max_flops", max_flops),
        "time_limit": options.seconds(time_limit),
        "num_threads": options.threads(num_threads),
    }
    R = _node_rotations(graph, rotations, "rotations")
    precisions, unit = None, 1.0
    if anisotropic:
        precisions = given_precisions(graph)
        assert graph.covariances is not None
        unit = precision_of_weight_one(graph.covariances, graph.weights)
    core = _call_core(
        graph,
        _core.certify,
        R,
        failure_probability=options.probability("failure_probability", failure_probability),
        seed=options.whole("seed", seed, 0, 2**64 - 1),
        priors=None if grounded is None else grounded.core,
        precisions=precisions,
        prior_precision=unit,
        **limits,
    )
    certificate = certificate_from_core(core, tolerance)
    assert certificate is not None
    return certificate


def objective(graph: MeasurementGraph, rotations: NodeRotations) -> float:
    """Objective (3), sum of w |R_i R_ij - R_j|_F^2, at rotations as `certify` takes them."""
    return _call_core(graph, _core.objective, _node_rotations(graph, rotations, "rotations"))


def gradient(graph: MeasurementGraph, rotations: NodeRotations) -> NDArray[np.float64]:
    """Riemannian gradient (n, 3) of the objective (3) at rotations as `certify` takes them.

    Row i is the derivative along R_i <- exp([w]) R_i with respect to w (radians) at w = 0.
    """
    return _call_core(graph, _core.gradient, _node_rotations(graph, rotations, "rotations"))


def _call_core(
    graph: MeasurementGraph, function: Callable[..., _Result], *args: Any, **settings: Any
) -> _Result:
    """Call the core for a graph; it refuses matrices that are no rotations, and unknown options."""
    if not isinstance(graph, MeasurementGraph):
        raise GraphError(f"found a {type(graph).__name__}, expected a MeasurementGraph")
    try:
        return function(graph._core, *args, **settings)
    except _core.InvalidRotation as error:
        node, reason = error.args
        raise GraphError(f"the matrix of node {graph.nodes[node].item()!r} {reason}") from None
    except _core.InvalidOption as error:
        raise OptionError(str(error)) from None
    except _core.TooLarge as error:
        raise SolverError(str(error)) from None


def _node_rotations(
    graph: MeasurementGraph, rotations: NodeRotations, name: str
) -> NDArray[np.float64]:
    """(n, 3, 3) in the order of the graph's nodes."""
    if not isinstance(graph, MeasurementGraph):
        raise GraphError(f"found a {type(graph).__name__}, expected a MeasurementGraph")
    if isinstance(rotations, (Solution, OnlineSolution)):
        ids, given = rotations.nodes, rotations.rotations
    elif isinstance(rotations, Mapping):
        ids = as_ids(list(rotations), f"the ids of {name}")
        given = as_floats(list(rotations.values()), (len(ids), 3, 3), name)
    else:
        return as_floats(rotations, (graph.num_nodes, 3, 3), name)
    rows = rows_of(graph.nodes, ids)
    if (rows < 0).any():
        missing = graph.nodes[np.argmin(rows)].item()
        raise GraphError(f"{name}: there is none of node {missing!r}, expected one of every node")
    return given[rows]
