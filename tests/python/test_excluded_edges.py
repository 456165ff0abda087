"""Edges that are left out of everything but what nothing else joins."""

from __future__ import annotations

import numpy as np
import pytest

import rotavg
from test_robust_edges import LOSSES, turn


def test_excluded_edges_have_no_say_however_heavy() -> None:
    turns = np.array([turn(0.1), turn(0.1), turn(1.5)])
    for weight in (1.0, 1e6, 1e12):
        graph = rotavg.MeasurementGraph.from_rotvecs(
            [(0, 1), (1, 2), (0, 2)], turns, weights=[1, 1, weight]
        )
        for loss in ("l2", *LOSSES):
            solution = rotavg.solve(graph, loss=loss, excluded=[(0, 2)])  # type: ignore[arg-type]
            residuals = np.degrees(solution.residual_angles)
            assert residuals[:2].max() < 1e-3
            assert residuals[2] == pytest.approx(np.degrees(1.3), abs=1e-2)
            assert solution.edge_verdicts.tolist() == ["bridge", "bridge", "excluded"]
            assert solution.robust is not None
            assert solution.robust.objective < 1e-9


def test_the_weights_of_excluded_edges_are_no_unit() -> None:
    rng = np.random.default_rng(0)
    pairs = [(i, j) for i in range(6) for j in range(i + 1, 6)]
    turns = rng.normal(size=(15, 3)) * 0.002
    turns[0] = turn(np.radians(15))
    thresholds = []
    for weight in (1.0, 1e4, 1e6):
        graph = rotavg.MeasurementGraph.from_rotvecs(
            pairs * 2, np.r_[turns, 0 * turns], weights=np.repeat([1.0, weight], 15)
        )
        solution = rotavg.solve(graph, loss="auto", excluded=np.arange(30) >= 15)
        assert solution.edge_verdicts[0] == "robust_weight"
        assert solution.robust is not None
        thresholds.append(solution.robust.threshold)
    assert thresholds == pytest.approx([thresholds[0]] * 3, rel=1e-6)
