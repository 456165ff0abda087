"""One measure for all answers: the objective and rotavg's certificate of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import rotavg

_CERTIFY_LIMIT_S = 300.0


@dataclass(frozen=True)
class Evaluation:
    """How good rotations are, by rotavg.

    Attributes:
        objective: f, with the graph's weights.
        relative_gradient: largest |gradient of node i| / degree of i, radians.
        verdict: rotavg's, "proved", "estimated" or "not_certified".
        relative_gap: the certificate's bound on (f - f*) / f.
    """

    objective: float
    relative_gradient: float
    verdict: str
    relative_gap: float


class Evaluator:
    """Evaluates answers for one graph; equal answers, as those of repeats, once."""

    def __init__(self, graph: rotavg.MeasurementGraph) -> None:
        self._graph = graph
        self._degree = np.bincount(
            graph.indices.ravel(), np.repeat(graph.weights, 2), minlength=graph.num_nodes
        )
        self._known: dict[bytes, Evaluation] = {}

    def __call__(self, rotations: NDArray[np.float64]) -> Evaluation:
        """Evaluate rotations (n, 3, 3); raises rotavg.GraphError if they are none."""
        key = rotations.tobytes()
        if key not in self._known:
            self._known[key] = self._evaluate(rotations)
        return self._known[key]

    def _evaluate(self, rotations: NDArray[np.float64]) -> Evaluation:
        certificate = rotavg.certify(self._graph, rotations, time_limit=_CERTIFY_LIMIT_S)
        gradient = np.linalg.norm(rotavg.gradient(self._graph, rotations), axis=1)
        return Evaluation(
            objective=rotavg.objective(self._graph, rotations),
            relative_gradient=float(np.max(gradient / self._degree)),
            verdict=certificate.verdict.value,
            relative_gap=certificate.relative_gap,
        )
