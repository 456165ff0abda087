"""How far rotations can be from the global optimum."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field


class Verdict(str, enum.Enum):
    """What is known of global optimality; compares equal to its name."""

    PROVED = "proved"
    ESTIMATED = "estimated"
    NOT_CERTIFIED = "not_certified"

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return {
            Verdict.PROVED: "proved globally optimal",
            Verdict.ESTIMATED: "globally optimal by an eigenvalue estimate, not a proof",
            Verdict.NOT_CERTIFIED: "not certified: a better answer may exist",
        }[self]

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class ComponentCertificate:
    """How far the objective can be from the global optimum, in one connected component.

    Source: Theorem 1 of Dong, Xie and Shi (2021), extended by a bound that holds at any rotations,
    stationary or not.

    Attributes:
        verdict: "proved" or "estimated" where `relative_gap` is below the tolerance.
        lambda_min: smallest eigenvalue of Lambda - Rt, Lambda symmetrised; zero to rounding at the
            optimum, negative where the rotations are refuted, NaN where it is not known.
        gap: bound on f(R) - f*, where f* is the global optimum. Rounding is included.
        relative_gap: gap / max(f, 1e-6 sum of weights); in the sum no edge counts for more than
            1000 times the lightest.
        method: "factorization" or "connectivity" (proofs, the latter on dense graphs), "relaxation"
            (a proof: the staircase met the optimum of the relaxation, which is below all
            rotations), "nonnegativity" (a proof: the objective itself is zero to the tolerance),
            "eigenvalue" (an estimate) or "none" (stopped, or not converged).
    """

    verdict: Verdict
    lambda_min: float
    gap: float
    relative_gap: float
    method: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "verdict", Verdict(self.verdict))


@dataclass(frozen=True)
class Certificate(ComponentCertificate):
    """The certificate of a graph: the gap over all components, and for all else the worst of them.

    Attributes:
        components: one ComponentCertificate each, numbered as in `Solution.component`.
    """

    components: tuple[ComponentCertificate, ...] = field(default=(), repr=False)
