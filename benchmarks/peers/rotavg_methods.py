"""rotavg itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import rotavg
from benchmarks.problem import Problem


class Rotavg:
    """`variant` is a method, run without the certificate, or "certified": all by default."""

    def __init__(self, problem: Problem, variant: str) -> None:
        self.graph = rotavg.MeasurementGraph(
            problem.indices,
            problem.rotations,
            problem.weights,
            nodes=np.arange(problem.num_nodes),
        )
        self.options: dict[str, Any] = {
            "num_threads": problem.threads,
            "time_limit": problem.time_limit if np.isfinite(problem.time_limit) else None,
        }
        if variant != "certified":
            self.options |= {"method": variant, "certify": False}

    def solve(self) -> None:
        self.solution = rotavg.solve(self.graph, **self.options)

    def rotations(self) -> NDArray[np.float64]:
        return self.solution.rotations

    def claim(self) -> str:
        s = self.solution
        end = "converged" if s.status.converged else s.status.name.lower().replace("_", " ")
        verdict = "" if s.certificate is None else f", {s.certificate.verdict}"
        return f"{end}{verdict} ({s.method}, {s.iterations} its)"
