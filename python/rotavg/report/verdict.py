"""What is proved and what is not, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotavg.solving.certificate import Certificate, Shortfall, Verdict
from rotavg.solving.printed import of_what
from rotavg.solving.printed_robust import doubts_of, rejected
from rotavg.solving.solution import Solution


@dataclass(frozen=True)
class Statement:
    """The sentence at the top of the page.

    Attributes:
        level: "proved", "estimated", "open" (nothing was refuted, or an answer that is proved is
            in doubt for other reasons) or "failed".
        headline: one sentence.
        details: what it means, and what it does not.
    """

    level: str
    headline: str
    details: tuple[str, ...]


_PROOFS = {
    "factorization": "a factorisation of the certificate's matrix",
    "connectivity": "the graph's connectivity, which outweighs the residuals",
    "relaxation": "a bound on the optimum of the relaxation, which no rotations can beat",
    "nonnegativity": "the objective itself, which is zero to the tolerance and cannot be negative",
    "random_start": "an iteration from a random start, which no negative eigenvalue would pass",
}


def statement(solution: Solution) -> Statement:
    """The verdict on a solution, worded so that it claims no more than is known."""
    certificate = solution.certificate
    if certificate is None:
        return _without_certificate(solution)
    held = of_what(solution)
    priors = "" if solution.grounded is None else " and priors"
    fitted = f"these measurements{priors}"
    doubts = _doubts(solution)
    but = f"; but {', '.join(doubts)}" if doubts else ""
    if solution.robust is not None:
        held += f", for the least squares on the edges it kept{priors}"
        fitted, but = "these", f"; {rejected(solution.robust)}{but}"
    if certificate.verdict == Verdict.PROVED:
        how = _PROOFS.get(certificate.method, certificate.method)
        if certificate.method == "factorization":
            how += " for full covariances" if solution.anisotropic else " (Theorem 1)"
        chance = (
            f", but for a probability of {certificate.failure_probability:.2g}"
            if certificate.failure_probability > 0
            else ""
        )
        return Statement(
            "open" if doubts else "proved",
            f"Proved{held}{chance}: no other rotations fit {fitted} better{but}.",
            (
                f"{_gap(certificate)}, by {how}, with rounding accounted for.",
                *_reservations(solution),
            ),
        )
    if certificate.verdict == Verdict.ESTIMATED:
        return Statement(
            "estimated",
            f"Very probably optimal{held}: an eigenvalue estimate found no better answer{but}. "
            "This is not a proof.",
            (
                f"{_gap(certificate)}, if the estimate is right.",
                *_reservations(solution),
            ),
        )
    return _not_certified(solution, certificate)


def _doubts(solution: Solution) -> list[str]:
    """What speaks against a robust answer, beside the edges that were rejected."""
    fit = solution.robust
    if fit is None:
        return []
    return doubts_of(fit, solution.num_parts_given, len(solution.hanging_groups))


def _rejected(solution: Solution, *more: str) -> tuple[str, ...]:
    """How many edges a robust loss has rejected, and more, as a sentence; none without one."""
    return () if solution.robust is None else (", ".join([rejected(solution.robust), *more]) + ".",)


def _without_certificate(solution: Solution) -> Statement:
    if solution.anisotropic == "log" and solution.isotropic is not None:
        return _refined(solution, solution.isotropic.certificate)
    details = (
        "No certificate was asked for: how far this is from the optimum is not known.",
        *_rejected(solution, *_doubts(solution)),
    )
    if solution.status.converged:
        return Statement("open", "Converged to a stationary point; optimality unknown.", details)
    return Statement("failed", f"Not solved: {solution.status}.", details)


def _refined(solution: Solution, start: Certificate | None) -> Statement:
    details = [
        "For the squares of the residual angles, weighted by full covariances, there is no "
        "certificate: how far this is from the optimum is not known."
    ]
    if start is not None:
        held = ", for the final weights of the edges" if is_reweighted(solution) else ""
        sentence = f"{start.sentence}{held}"
        details.append(f"It started from the optimum for the squared chords: {sentence}.")
    if solution.status.converged:
        headline = "Converged to a local minimum; global optimality unknown."
        return Statement("open", headline, tuple(details))
    return Statement("failed", f"Not solved: {solution.status}.", tuple(details))


def _not_certified(solution: Solution, certificate: Certificate) -> Statement:
    bound = (f"{_gap(certificate)}.",) if np.isfinite(certificate.gap) else ()
    bound = (*_rejected(solution, *_doubts(solution)), *bound)
    if not solution.status.converged:
        headline = f"Not solved: {solution.status}."
        return Statement("failed", headline, (*bound, "Let it run longer, or try another method."))
    if certificate.shortfall == Shortfall.STOPPED:
        headline = "Converged, but stopped before the certificate."
        return Statement("open", headline, bound)
    if certificate.shortfall == Shortfall.UNDECIDED:
        return Statement(
            "open",
            "Converged; nothing was established of its optimality.",
            (
                *bound,
                "The graph is too large, or its bottlenecks too narrow, for the ways to prove.",
            ),
        )
    if certificate.shortfall == Shortfall.LEFTOVER:
        return Statement(
            "open",
            f"Optimal to a relative {certificate.relative_gap:.2g}; the tolerance is "
            f"{certificate.tolerance:g}.",
            (
                *bound,
                "Nothing better lies elsewhere: the certificate's matrix is positive. What is "
                "left is the distance to the optimum of which these rotations are near: a smaller "
                "tolerance of the iteration makes it smaller, and a larger one of the certificate "
                "(--certificate-tolerance) accepts it.",
            ),
        )
    if certificate.shortfall == Shortfall.RELAXATION:
        return Statement(
            "failed",
            "Not certified: the measurements are too noisy for a proof of this kind.",
            (
                *bound,
                "The staircase met the optimum of the relaxation, which lies below these "
                "rotations: no better ones were found, and none can be better than by this gap.",
            ),
        )
    return Statement(
        "failed",
        "Not certified: other rotations may fit these measurements better.",
        (
            *bound,
            "Either this is a local optimum (another initial value may lead to a better one), or "
            "the measurements are so noisy that the bound is not tight.",
        ),
    )


def _gap(certificate: Certificate) -> str:
    return (
        f"The objective is at most {certificate.gap:.2g} above the global optimum "
        f"(relative {certificate.relative_gap:.2g})"
    )


def _reservations(solution: Solution) -> tuple[str, ...]:
    said = ["This says nothing about whether the measurements are right: look at the residuals."]
    if is_reweighted(solution):
        said.insert(
            0,
            "It holds for the problem with the final weights. That these weights are the best ones "
            "for the robust loss is not proved.",
        )
    return tuple(said)


def is_reweighted(solution: Solution) -> bool:
    """Whether a robust loss has changed the weights of the edges."""
    return not np.array_equal(solution.edge_weights, solution.graph.weights)
