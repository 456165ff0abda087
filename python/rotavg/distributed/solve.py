"""The front door: a graph that is divided among processes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Union

import numpy as np

from rotavg.base.errors import OptionError
from rotavg.distributed.building import build, sent
from rotavg.distributed.cluster import local_cluster, told_plainly
from rotavg.distributed.deadline import Deadline
from rotavg.distributed.interruption import heeded
from rotavg.distributed.part import Part
from rotavg.distributed.proof import prove, stopped
from rotavg.distributed.robust import (
    change,
    common_loss,
    outliers,
    reweighted,
    robust_turns,
    solve_alone_robustly,
    votes,
)
from rotavg.distributed.rounds import Callback, Round, Rounds
from rotavg.distributed.solution import DistributedSolution, Interrupted, RobustFit
from rotavg.distributed.sources import Chunk, chunks_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.solving import options

_NEAR_ROUNDING = 1e-13  # radians, of the relative gradient
_OF_NOISE = 1e-5  # of the residuals' root mean square: the gradient that the proof may need
_FALLING = 0.7  # of a gradient in a round, where rounding does not keep it from falling

MOST_REWEIGHTINGS = 60
SETTLED = 1e-5  # of the weights, what the last reweighting changes

Source = Union[MeasurementGraph, str, Path, Sequence[Chunk]]


def solve(
    source: Source,
    *,
    client: Any = None,
    parts: int | None = None,
    tolerance: float = 1e-9,
    max_rounds: int = 200,
    time_limit: float | None = None,
    loss: Literal["l2", "auto"] = "l2",
    certify: bool = True,
    certificate_tolerance: float = 1e-6,
    failure_probability: float = 1e-12,
    seed: int = 0,
    callback: Callback = None,
) -> DistributedSolution:
    """Rotation averaging where the graph is divided among the workers of a Dask cluster.

    Every part of the graph solves by itself; one rotation a part joins them (a small problem of its
    own); then rounds: all parts solve against their surroundings at the same time, and are joined
    again (docs/distributed.md).

    Args:
        source: a graph with integer ids; or a folder of files that `rotavg.read` reads, each a part
            of the edges (those whose names begin with a dot are left out); or functions of no
            arguments that return such a part, called on workers.
        client: a `distributed.Client`; by default one of a process for each processor of this
            machine, which hold the solution until that is closed or forgotten.
        parts: how many parts; by default one for each thread of the workers. More parts take less
            memory at a time.
        tolerance: of the relative gradient, radians; with `certify` at most 1e-5 of the residuals'
            root mean square, if rounding allows.
        max_rounds: limit on the number of rounds.
        time_limit: limit in seconds on everything but reading and dividing the graph, without
            which there is no answer; what then is missing is told by `reason` and the certificate.
        loss: "l2", or "auto" for data with outliers: then the certificate is that of the final
            weighted problem, and `DistributedSolution.robust` tells what was found out.
        certify: whether to bound the distance from the global optimum.
        certificate_tolerance: the largest relative gap that is called optimal.
        failure_probability: of the proof, where one process cannot hold the graph.
        seed: of that proof, and of what a robust loss draws.
        callback: called with a `Round` after every round; returning False stops.

    Returns:
        A DistributedSolution; the first node of each component has R = I, as nodes without an edge.

    Raises:
        GraphError: no edges, or ids that are no integers.
        FormatError: a file cannot be read, or its content is none that `rotavg.read` takes.
        OptionError: for an option out of range.
        SolverError: a function of the source fails, or the cluster does.
        Interrupted: Ctrl-C while certifying; it has the solution.
        MissingExtraError: without the extra [distributed].
    """
    if parts is not None:
        parts = options.whole("parts", parts, 1, 2**31 - 1)
    limits = Limits(
        options.nonnegative("tolerance", tolerance),
        options.whole("max_rounds", max_rounds, 0, 2**31 - 1),
        options.seconds(time_limit),
        Deadline.after(options.seconds(time_limit)),
        options.function(callback),
        certify,
    )
    proof: dict[str, Any] = {
        "tolerance": options.nonnegative("certificate_tolerance", certificate_tolerance),
        "probability": options.probability("failure_probability", failure_probability),
        "seed": options.whole("seed", seed, 0, 2**31 - 1),
    }
    if loss not in ("l2", "auto"):
        raise OptionError(f"loss is {loss!r}, expected 'l2' or 'auto'")
    with heeded(), ExitStack() as processes, told_plainly():
        cluster = local_cluster(processes) if client is None else client
        if parts is None:
            parts = max(1, sum(cluster.nthreads().values()))
        # Nothing here holds the chunks: they are forgotten once there are parts.
        if isinstance(source, MeasurementGraph):
            built = build(cluster, *sent(cluster, source, parts))
        else:
            built = build(cluster, chunks_of(cluster, source), parts)
        rounds = Rounds(*built, limits.deadline)
        del built
        if loss == "auto":
            trace, reason, robust = _robustly(rounds, limits, seed)
        else:
            trace, robust = [rounds.begin()], None
            reason = _run(rounds, trace, limits)
        component, num_components = rounds.components()
        network = rounds.network
        sizes = network.gather(network.each(_sizes))
        solution = DistributedSolution(
            objective=trace[-1].objective,
            relative_gradient=trace[-1].relative_gradient,
            converged=trace[-1].relative_gradient <= tolerance,
            reason=reason,
            certificate=stopped(trace[-1].objective, proof["tolerance"]) if certify else None,
            robust=robust,
            rounds=tuple(trace),
            num_nodes=sum(n for n, _ in sizes),
            num_edges=sum(m for _, m in sizes),
            num_parts=len(network),
            network=rounds.network,
            rotations=rounds.in_gauge(component, num_components),
            processes=processes.pop_all(),
        )
        if not certify:
            return solution
        try:
            certificate = prove(rounds, component, num_components, **proof)
        except KeyboardInterrupt:
            raise Interrupted(solution) from None
        except BaseException:
            solution.close()
            raise
        return solution if certificate is None else solution.with_certificate(certificate)


@dataclass(frozen=True)
class Limits:
    """Of the rounds; see `solve`."""

    tolerance: float
    max_rounds: int
    time_limit: float
    deadline: Deadline
    callback: Callback
    certify: bool

    def tolerance_at(self, noise: float) -> float:
        """Of the relative gradient, where the residuals are of this size."""
        if not self.certify:
            return self.tolerance
        return min(self.tolerance, max(_NEAR_ROUNDING, _OF_NOISE * noise))

    def reason(self, trace: list[Round], wanted: float) -> str | None:
        """Why to end after the last round; None to go on.

        Args:
            trace: the rounds.
            wanted: the relative gradient.
        """
        now = trace[-1]
        if self.callback is not None and self.callback(now) is False:
            return "stopped"
        if now.relative_gradient <= max(wanted, self.tolerance):
            falls = len(trace) < 2 or now.relative_gradient < _FALLING * trace[-2].relative_gradient
            if now.relative_gradient <= wanted or not falls or now.number >= self.max_rounds:
                return "converged"
        if now.number >= self.max_rounds:
            return f"the limit of {self.max_rounds} rounds"
        if self.deadline.passed:
            return f"the time limit of {self.time_limit} s"
        return None


def _run(rounds: Rounds, trace: list[Round], limits: Limits, at_least: float = 0.0) -> str:
    """Rounds until one of the limits, or a relative gradient of `at_least`; which."""
    while True:
        now = trace[-1]
        wanted = max(at_least, limits.tolerance_at(rounds.state.level.noise))
        reason = limits.reason(trace, wanted)
        if reason is not None:
            return reason
        # A tenth of what is wrong now is near enough for the parts; rounding is in the way of more.
        near = max(0.1 * max(now.relative_gradient, wanted), _NEAR_ROUNDING)
        trace.append(rounds.next(now.number + 1, near))


def _robustly(rounds: Rounds, limits: Limits, seed: int) -> tuple[list[Round], str, RobustFit]:
    """Reweighted until the weights stay as they are; then to the tolerance."""
    base = rounds.network
    alone = base.each(solve_alone_robustly, deadline=limits.deadline)
    told = base.gather([base.at(p, _without_rotations, one) for p, one in enumerate(alone)])
    rotations = [base.at(p, _rotations, one) for p, one in enumerate(alone)]
    found = base.gather(base.with_neighbours(votes, rotations, rounds.all_pieces, seed=seed))
    Q, by_votes = robust_turns(found, rounds.num_pieces)
    loss = common_loss(told, by_votes)
    rotations = rounds.turned(rotations, Q)
    given = base.each(_weights)
    trace: list[Round] = []
    settled, reason = 1.0, "converged"
    for _ in range(MOST_REWEIGHTINGS):
        before = rounds.network
        parts = base.with_neighbours(reweighted, rotations, given, loss=loss)
        rounds.reweight(parts, rotations)
        moved = rounds.network.gather(rounds.network.each(change, before.parts))
        settled = sum(by for by, _ in moved) / sum(of for _, of in moved)
        number = trace[-1].number if trace else 0
        trace.append(rounds.told(number, "reweighted"))
        # Not nearer than is worth while: the weights change again.
        reason = _run(rounds, trace, limits, at_least=0.05 * trace[-1].relative_gradient)
        rotations = rounds.state.rotations
        if reason != "converged" or settled <= SETTLED:
            break
    if reason == "converged":
        reason = _run(rounds, trace, limits)
    far = base.gather(base.with_neighbours(outliers, rounds.state.rotations, given, loss=loss))
    return trace, reason, RobustFit(loss.scale, loss.noise, 3.0 * loss.noise, sum(far), settled)


def _sizes(part: Part) -> tuple[int, int]:
    return part.num_own, int(np.count_nonzero(part.counted))


def _without_rotations(one: tuple[Any, float, float, float]) -> tuple[float, float, float]:
    return one[1:]


def _rotations(one: tuple[Any, float, float, float]) -> Any:
    return one[0]


def _weights(part: Part) -> Any:
    return part.edges.weights
