"""Solvers that go wrong, for the tests of the benchmarks' runner."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.rotavg_methods import Rotavg
from benchmarks.problem import Problem


class GoesWrong(Rotavg):
    """Solves the small problem before, then does what `variant` says."""

    def __init__(self, problem: Problem, variant: str) -> None:
        super().__init__(problem, "auto")
        self.variant = variant if problem.num_nodes > 20 else ""

    def solve(self) -> None:
        if self.variant == "raise":
            raise ValueError("no such luck\nand more about it")
        if self.variant == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.variant == "sleep":
            time.sleep(60)
        super().solve()


class WrongWayOut(Rotavg):
    """Forgets to convert the answer."""

    def __init__(self, problem: Problem, variant: str) -> None:
        super().__init__(problem, "auto")

    def rotations(self) -> NDArray[np.float64]:
        return np.swapaxes(super().rotations(), 1, 2)


class WrongWayIn(Rotavg):
    """Forgets to convert the measurements."""

    def __init__(self, problem: Problem, variant: str) -> None:
        transposed = np.swapaxes(problem.rotations, 1, 2)
        problem = Problem(problem.indices, transposed, problem.weights, problem.start)
        super().__init__(problem, "auto")
