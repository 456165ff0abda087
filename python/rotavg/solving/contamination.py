"""Signs in the residuals of least squares that a robust loss is needed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.graph.measurement_graph import MeasurementGraph

# Above this share of cycles, what least squares leave of an edge's noise is nearly all of it; with
# more edges, finding how much would take too long.
_MUCH_CHECKED, _MANY_EDGES = 0.8, 20_000
_LEAST_REDUNDANCY = 1e-6  # below, rounding is seen
# Wrong edges leave residuals of any size. Where hardly any is so many times the noise, or so many
# radians, noise is not the same for all edges, and none is wrong.
_FAR_NOISES, _FAR, _LEAST_FAR = 5, 0.5, 0.002


def contamination(
    angles: NDArray[np.float64], weights: NDArray[np.float64] | None = None
) -> str | None:
    """Advice to use a robust loss, if these residual angles (m,) in radians look contaminated.

    That is where more than 3 % of them lie beyond 3 standard deviations, or 2 % and some of these
    far beyond, where two kinds of noise have nothing. The deviation is estimated from the median
    as if they were half of a normal distribution (which has 0.3 % there, and rotation noise in all
    three directions none). Or more than 1 % lie beyond 90 degrees. Angles are compared in units of
    their 1 / sqrt(weight).
    """
    if len(angles) == 0:
        return None
    scaled = angles if weights is None else angles * np.sqrt(weights / np.median(weights))
    return _advice(scaled, float(np.mean(angles > np.pi / 2)))


def contamination_of(
    graph: MeasurementGraph, rotations: NDArray[np.float64], angles: NDArray[np.float64]
) -> str | None:
    """The same for the residual angles (m,) that least squares leave, as cycles check them.

    Bridges say nothing. Edges in series, which lie on the same cycles, say together one thing: the
    sum of their angles, of the variance of all of them. And of a graph that has few cycles every
    series is judged in units of what least squares leave of its noise: heavy edges are met nearly
    exactly where light ones can bend.
    """
    label, cycles = _core.series(graph._core)
    checked = label >= 0
    if not checked.any():
        return None
    variances = np.median(graph.weights) / graph.weights
    total = np.bincount(label[checked], angles[checked])
    variance = np.bincount(label[checked], variances[checked])
    if cycles < _MUCH_CHECKED * len(total) and graph.num_edges <= _MANY_EDGES:
        left = _core.covariances(
            graph._core, rotations, graph.indices, noise_variance=1.0, information=None,
            num_threads=1,
        )  # fmt: skip
        if left is not None:
            fitted = graph.weights * np.trace(left, axis1=1, axis2=2) / 3
            redundancy = np.bincount(label[checked], 1 - fitted[checked])
            variance *= np.clip(redundancy, _LEAST_REDUNDANCY, 1)
    return _advice(total / np.sqrt(variance), float(np.mean(angles[checked] > np.pi / 2)))


def _advice(scaled: NDArray[np.float64], wild: float) -> str | None:
    """The advice for angles in units of their noise, a share `wild` of which is beyond 90 deg."""
    if len(scaled) < 20:
        return None
    noise = max(float(np.median(scaled)) / 0.6745, 1e-6)
    beyond = float(np.mean(scaled > 3 * noise))
    far = float(np.mean(scaled > max(3 * noise, min(_FAR_NOISES * noise, _FAR))))
    contaminated = beyond > 0.03 or (beyond > 0.02 and far > _LEAST_FAR)
    if not contaminated and wild <= 0.01 and 3 * noise <= np.pi:
        return None
    if 3 * noise > np.pi:  # no angle of noise; the median is
        found = f"half of them lie beyond {np.degrees(min(np.median(scaled), np.pi)):.2g} deg"
    elif contaminated:
        degrees = np.degrees(noise)
        found = f"{100 * beyond:.2g} % lie beyond 3 times their noise of {degrees:.2g} deg"
    else:
        found = f"{100 * wild:.2g} % lie beyond 90 deg"
    return f'{found}: a robust loss (loss="auto", --loss auto) resists them'
