"""Answers that another solver's certificate accepts wrongly: ours refuses them."""

from __future__ import annotations

import numpy as np
import pytest

import rotavg
from benchmarks.problem import Problem
from shared_data import shared_data


# How far GTSAM ends above depends on the last digits of the start: on sphere2500 by .98 to 1.1 %.
@pytest.mark.parametrize(
    ("name", "excess"), [("sphere2500", 0.005), ("torus3D", 0.001), ("parking-garage", 0.03)]
)
def test_what_gtsam_accepts_from_a_tree_start_is_refused(name: str, excess: float) -> None:
    pytest.importorskip("gtsam", reason="GTSAM is not installed")
    from benchmarks.peers.gtsam_shonan import Shonan

    graph = rotavg.read(shared_data(f"g2o/{name}.g2o"), unit_weights=True)
    start = rotavg._core.shortest_path_init(graph._core)
    problem = Problem(graph.indices, graph.rotations, graph.weights, start)
    shonan = Shonan(problem, "tree")
    shonan.solve()
    assert shonan.lambda_min > shonan.threshold  # accepted
    rotations = shonan.rotations()
    optimum = rotavg.solve(graph)
    assert optimum.solved
    above = rotavg.objective(graph, rotations) - optimum.objective
    assert above > excess * optimum.objective  # wrongly

    certificate = rotavg.certify(graph, rotations)
    assert certificate.verdict == "not_certified"
    assert certificate.gap >= above * (1 - 1e-6)
    # From there, the staircase or plain descent leads to the optimum.
    mended = rotavg.solve(graph, init=rotations)
    assert mended.solved
    assert mended.objective == pytest.approx(optimum.objective, rel=1e-9)
    assert np.isfinite(mended.rotations).all()
