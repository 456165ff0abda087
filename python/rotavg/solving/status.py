"""How the solver ended, by what course, and in what time."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotavg.base.arrays import ReadOnly


class Status(enum.Enum):
    """How the solver ended; the value is the sentence that `print` shows."""

    GRADIENT_CONVERGED = "converged: the gradient is below the tolerance"
    STEP_CONVERGED = "converged by the paper's rule: the step is below the tolerance"
    ITERATION_LIMIT = "stopped early, at the iteration limit"
    TIME_LIMIT = "stopped early, at the time limit"
    STOPPED = "stopped early, by the callback"

    @property
    def converged(self) -> bool:
        """Whether the stopping rule was met."""
        return self in (Status.GRADIENT_CONVERGED, Status.STEP_CONVERGED)

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class Trace(ReadOnly):
    """The course of the iteration, (k + 1,) arrays: the initial value, then k iterations.

    Attributes:
        objective: f, equation (3); of "bcdsr" the objective of the relaxation, 6 sum w - tr(Rt Y),
            of its Y, which may lie on either side of f at its rotations.
        gradient_norm: Euclidean norm of the gradient over all nodes, per radian.
        relative_gradient: largest |gradient of node i| / degree of i, in radians.
        step: the paper's relative step.
        seconds: since the solver started.
    """

    objective: NDArray[np.float64]
    gradient_norm: NDArray[np.float64]
    relative_gradient: NDArray[np.float64]
    step: NDArray[np.float64]
    seconds: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.objective)


@dataclass(frozen=True)
class Timings:
    """Wall-clock seconds."""

    init: float
    solve: float
    certify: float

    @property
    def total(self) -> float:
        """All three together."""
        return self.init + self.solve + self.certify
