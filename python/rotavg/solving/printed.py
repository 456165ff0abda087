"""What a printed solution says, on a terminal or in a notebook: a head, and named sentences."""

from __future__ import annotations

import numpy as np

from rotavg.solving.certificate import Certificate, Verdict
from rotavg.solving.contamination import contamination_of
from rotavg.solving.gravity_weight import heavier_gravity
from rotavg.solving.kept import median_high_largest
from rotavg.solving.printed_robust import (
    doubts_of,
    proof_sentence,
    rejected,
    robust_rows,
)
from rotavg.solving.solved import Solved
from rotavg.solving.trajectory import doubted_odometry, strained_trust
from rotavg.solving.uncertainty import beyond_half_a_turn, rms_degrees

OF_COVARIANCES = {
    "": "",
    "chordal": " (full covariances, chords)",
    "log": " (full covariances, logarithms)",
}
_HALF_TURN = 180.0  # degrees

Rows = list[tuple[str, str]]


def head(solution: Solved) -> str:
    """Whether it is solved, of what size, and how long it took."""
    n, m = solution.graph.num_nodes, solution.graph.num_edges
    uncertified = solution.certificate is not None and solution.status.converged
    head = "Solved" if solution.solved else "Not certified:" if uncertified else "Not solved:"
    return f"{head} {n} rotations from {m} relative rotations, {solution.timings.total:.3g} s"


def rows(solution: Solved) -> Rows:
    """Names and sentences, in the order in which they are told."""
    return [
        ("status", _status(solution)),
        *_proof(solution),
        *_figures(solution),
        *_what_holds(solution),
        *_uncertainty(solution),
        *_outliers(solution),
    ]


def _status(solution: Solved) -> str:
    rigs = solution.rigs
    if rigs is None or rigs.converged or not solution.status.converged:
        return str(solution.status)
    return f"{solution.status}; of the frames alone: the sensors have not come to rest"


def _proof(solution: Solved) -> Rows:
    if solution.anisotropic == "log" and solution.isotropic is not None:
        start = solution.isotropic.certificate
        of_start = "" if start is None else f" (where it started: {start.sentence})"
        return [("verdict", f"locally optimal, not certified{of_start}")]
    c = solution.certificate
    if c is None:
        return [("verdict", "not asked for")]
    return [
        ("verdict", verdict_sentence(solution, c)),
        ("gap", f"at most {c.gap:.2g} above the optimum, relative {c.relative_gap:.2g}"),
        ("lambda_min", f"{c.lambda_min + 0.0:.2g}"),
    ]


def verdict_sentence(solution: Solved, c: Certificate) -> str:
    """What the certificate `c` of a solution says, of what, and what speaks against the answer."""
    if c.verdict == Verdict.NOT_CERTIFIED and not solution.status.converged:
        return "not certified: not converged yet"
    held = of_what(solution)
    if solution.robust is None:
        return f"{c.sentence}{held}"
    hanging = len(solution.hanging_groups)
    doubts = doubts_of(solution.robust, solution.num_parts_given, hanging)
    return proof_sentence(f"{c.sentence}{held}", [rejected(solution.robust), *doubts])


def of_what(solution: Solved) -> str:
    """What a proof is of, where it is not of all rotations."""
    if solution.rigs is not None and solution.rigs.estimated.any():
        return " of the frames with the estimated sensors held"
    return " of the headings, with gravity held" if solution.upright else ""


def _figures(solution: Solved) -> Rows:
    median, high, largest = median_high_largest(solution)
    kept = "" if solution.robust is None else " (of the edges it kept)"
    start = f"{solution.init}, {solution.iterations} iterations"
    return [
        ("objective", f"{solution.objective:.12g}{OF_COVARIANCES[solution.anisotropic]}"),
        (
            "residuals",
            f"median {median:.3g} deg, 95 % below {high:.3g}, largest {largest:.3g}{kept}",
        ),
        ("gradient", f"{solution.gradient_norm:.2g}, relative {solution.relative_gradient:.2g}"),
        ("method", f"{solution.reason or solution.method}; from {start}"),
    ]


def _what_holds(solution: Solved) -> Rows:
    """The gauges of components, priors, rigs."""
    rows: Rows = []
    if solution.num_components > 1:
        held = solution.grounded is not None and solution.grounded.priors.hold_world
        rows.append(("components", _gauges(solution.num_components, held)))
    if solution.grounded is not None:
        rows += solution.grounded.rows(solution.rotations, solution.certificate is not None)
        rows += _gravity(solution)
    knows = getattr(solution.graph.source, "knows", "")
    if knows and not _uses_file(solution):
        rows.append(("not used", f"{knows}, which the graph's file has (rotavg.read_priors)"))
    if solution.rigs is not None:
        rows.append(("rigs", solution.rigs.sentence))
    return rows


def _uses_file(solution: Solved) -> bool:
    """Whether rigs or fixed rotations, which are what files of measurements know, are in use."""
    if solution.grounded is None:
        return solution.rigs is not None
    priors = solution.grounded.priors
    return solution.rigs is not None or bool(priors.rigs) or bool(priors.fixed)


def _gravity(solution: Solved) -> Rows:
    """Whether it should weigh more."""
    factor = heavier_gravity(solution) if solution.status.converged else None
    if factor is None:
        return []
    told = "it fits far better than its weight says beside the edges"
    return [("gravity?", f"{told}: try {factor:.2g} times that (--gravity-weight)")]


def _gauges(num_components: int, held: bool) -> str:
    if not held:
        return f"{num_components}, each with a gauge of its own"
    others = "the other" if num_components == 2 else "each of the others"
    return f"{num_components}: the priors hold the first, {others} has a gauge of its own"


def _uncertainty(solution: Solved) -> Rows:
    known = solution.known_covariances
    if known is None:
        return []
    rms = rms_degrees(known)
    about = f"median {np.median(rms):.3g} deg, largest {rms.max():.3g}"
    rows = [("uncertainty", f"{about} (RMS angle relative to the gauge)")]
    if rms.max() > _HALF_TURN:
        rows.append(("", beyond_half_a_turn(rms)))
    return rows


def _outliers(solution: Solved) -> Rows:
    """What a robust loss found, or whether one is needed."""
    if solution.robust is None:
        if not solution.status.converged:
            return []  # residuals on the way to the answer say nothing of the measurements
        advice = contamination_of(solution.graph, solution.rotations, solution.residual_angles)
        return [("outliers?", f"of the residuals, {advice}")] if advice else []
    rows = robust_rows(solution.robust, solution.num_parts_given)
    if (unchecked := int(solution.is_unchecked.sum())) > 0:
        some = "1 edge" if unchecked == 1 else f"{unchecked} edges"
        rows.append(("unchecked", f"{some} that outliers alone check"))
    if solution.hanging_groups:
        sizes = [len(group) for group in solution.hanging_groups]
        some = "a group" if len(sizes) == 1 else f"{len(sizes)} groups"
        rows.append(("hanging", f"{some} of {sum(sizes)} nodes, on edges that nothing checks"))
    if (advice := doubted_odometry(solution)) is not None:
        rows.append(("odometry?", advice))
    if (advice := strained_trust(solution)) is not None:
        rows.append(("trusted?", advice))
    return rows
