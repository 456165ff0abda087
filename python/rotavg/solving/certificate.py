"""How far rotations can be from the global optimum."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import Any

_OPTION = "certificate_tolerance, --certificate-tolerance"


class Verdict(str, enum.Enum):
    """What is known of global optimality; compares equal to its name."""

    PROVED = "proved"
    ESTIMATED = "estimated"
    NOT_CERTIFIED = "not_certified"

    def __str__(self) -> str:
        return self.value


class Shortfall(str, enum.Enum):
    """What keeps a certificate from the tolerance; compares equal to its name."""

    NONE = "none"
    LEFTOVER = "leftover"
    NEGATIVE = "negative"
    RELAXATION = "relaxation"
    UNDECIDED = "undecided"
    STOPPED = "stopped"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class ComponentCertificate:
    """How far the objective can be from the global optimum, in one connected component.

    Source: Theorem 1 of Dong, Xie and Shi (2021), extended by a bound that holds at any rotations,
    stationary or not (docs/certificate.md).

    Attributes:
        verdict: "proved" or "estimated" where `relative_gap` is below the tolerance.
        lambda_min: smallest eigenvalue of Lambda - Rt, Lambda symmetrised; zero to rounding at the
            optimum, negative where the rotations are refuted, NaN where it is not known.
        gap: bound on f(R) - f*, where f* is the global optimum. Rounding is included.
        relative_gap: gap / max(f, 1e-20 sum of weights); in the sum no edge counts for more than
            1000 times the lightest, but for at least 1/200 of its weight.
        method: "factorization" or "connectivity" (proofs, the latter on dense graphs), "relaxation"
            (a proof: what the staircase came to bounds the optimum of the relaxation, which is
            below all rotations), "nonnegativity" (a proof: the objective itself is zero to the
            tolerance), "random_start" (a proof but for the failure probability), "eigenvalue" (an
            estimate) or "none" (stopped, or not converged).
        failure_probability: the chance, over the seed, that the proof is wrong; zero of all methods
            but "random_start".
        shortfall: what keeps the gap above the tolerance. "none"; "leftover": the certificate's
            matrix is positive, so that nothing better lies elsewhere, but the rotations are not
            near enough to the optimum (or rounding is too large); "negative": it is not, the
            rotations are a local optimum or the noise is too much for this kind of proof;
            "relaxation": the gap is the distance to the optimum of the relaxation; "undecided":
            nothing was proved nor refuted; "stopped": by a limit or Ctrl-C.
    """

    verdict: Verdict
    lambda_min: float
    gap: float
    relative_gap: float
    method: str
    failure_probability: float = 0.0
    shortfall: Shortfall = Shortfall.NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "verdict", Verdict(self.verdict))
        object.__setattr__(self, "shortfall", Shortfall(self.shortfall))


@dataclass(frozen=True)
class Certificate(ComponentCertificate):
    """The certificate of a graph: the gap over all components, and for all else the worst of them.

    (`failure_probability` is the sum over the components.)

    Attributes:
        tolerance: the largest relative gap that is called optimal.
        components: one ComponentCertificate each, numbered as in `Solution.component`.
    """

    tolerance: float = 1e-6
    components: tuple[ComponentCertificate, ...] = field(default=(), repr=False)

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if self.verdict == Verdict.PROVED:
            chance = f" but for a probability of {self.failure_probability:.2g}"
            return "proved globally optimal" + (chance if self.failure_probability > 0 else "")
        if self.verdict == Verdict.ESTIMATED:
            return "globally optimal by an eigenvalue estimate, not a proof"
        optimal = f"optimal to a relative {self.relative_gap:.2g}"
        if self.shortfall == Shortfall.STOPPED:
            return "not certified: the work was stopped before the proof"
        if self.shortfall == Shortfall.LEFTOVER:
            estimate = " by an eigenvalue estimate" if self.method == "eigenvalue" else ""
            return f"{optimal}{estimate}; the tolerance is {self.tolerance:g} ({_OPTION})"
        if self.shortfall == Shortfall.RELAXATION:
            return f"{optimal}; the relaxation is not tight, so the true gap may be smaller"
        if self.shortfall == Shortfall.NEGATIVE:
            small = math.isfinite(self.relative_gap) and self.relative_gap < 1
            by = f", by a relative {self.relative_gap:.2g} at most" if small else ""
            return f"not certified: a better answer may exist{by}"
        return "not certified: nothing was proved, and nothing refuted"


def certificate_from_core(core: dict[str, Any], tolerance: float) -> Certificate | None:
    """What the core tells; None where no certificate was asked for."""
    if core["verdict"] == "not_run":
        return None
    components = (ComponentCertificate(**part) for part in core["components"])
    return Certificate(**{**core, "tolerance": tolerance, "components": tuple(components)})
