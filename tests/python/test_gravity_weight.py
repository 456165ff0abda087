"""Advice where gravity is far more precise than its weight says."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs


def scene(seed: int, gravity_noise: float) -> tuple[rotavg.Simulation, dict[int, np.ndarray]]:
    """A view graph with 2 degrees of noise per axis, and down in every camera."""
    rng = np.random.default_rng(seed)
    sigma = np.radians(2.0)
    simulation = rotavg.simulate(
        "erdos_renyi", 60, density=0.3, seed=seed, noise=lambda r, m: sigma * r.normal(size=(m, 3))
    )
    tilts = matrices_from_rotvecs(np.radians(gravity_noise) * rng.normal(size=(60, 3)))
    down = np.swapaxes(simulation.ground_truth @ tilts, 1, 2) @ np.array([0.0, 1.0, 0.0])
    return simulation, dict(enumerate(down))


def solved(
    simulation: rotavg.Simulation, down: dict[int, np.ndarray], weight: float, loss: Any
) -> tuple[rotavg.Solution, float]:
    """And the mean error, radians."""
    priors = rotavg.Priors(gravity={node: (d, weight) for node, d in down.items()})
    solution = rotavg.solve(simulation.graph, priors=priors, loss=loss)
    return solution, float(rotavg.compare(solution, simulation.ground_truth).mean)


@pytest.mark.parametrize("loss", ["l2", "auto"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_weight_that_is_advised_helps_and_is_enough(loss: Any, seed: int) -> None:
    simulation, down = scene(seed, 0.05)
    solution, error = solved(simulation, down, 1.0, loss)
    advice = re.search(r"gravity\?.*try (\S+) times", str(solution))
    assert advice, solution
    factor = float(advice.group(1))
    # Inverse variances: (2 / .05)^2 times as much; rotations err, too.
    assert 10 <= factor <= 2000
    better, less = solved(simulation, down, factor, loss)
    assert less < (0.75 if loss == "l2" else 0.85) * error
    assert "gravity?" not in str(better)


@pytest.mark.parametrize("loss", ["l2", "auto"])
def test_gravity_as_good_as_the_edges_or_worse_is_left_alone(loss: Any) -> None:
    for noise in (2.0, 6.0):
        simulation, down = scene(5, noise)
        assert "gravity?" not in str(solved(simulation, down, 1.0, loss)[0])
    assert "gravity?" not in str(rotavg.solve(scene(5, 1.0)[0].graph, loss=loss))
