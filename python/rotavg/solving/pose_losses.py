"""Robust losses of pose graphs: what they leave of an edge, by its chi.

chi = sqrt(r^T Omega r) is how many standard deviations an edge is off, if its information is right.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import OptionError
from rotavg.solving import options

Floats = NDArray[np.float64]
PoseLoss = Literal["l2", "huber", "cauchy", "geman_mcclure", "tls"]

# The scale in units of the noise; see docs/pose_graphs.md.
_TIMES = {"huber": 3.0, "cauchy": 5.0, "geman_mcclure": 10.0, "tls": 10.0}
POSE_LOSSES = ("l2", *_TIMES)
LEAST_SHARE = 1e-12  # what is left of an outlier, so that it holds what nothing else does
_MAX_ROUNDS = 100
_SETTLED = 1e-3  # of shares
_FALLS_LITTLE = 0.8


def check_pose_loss(loss: str, scale: float | str) -> float | None:
    """The scale, None if it is to be found; OptionError for a loss or scale that is none."""
    if loss not in POSE_LOSSES:
        expected = ", ".join(map(repr, POSE_LOSSES))
        raise OptionError(f"pose loss is {loss!r}; expected one of {expected}")
    if isinstance(scale, str):
        if scale != "auto":
            raise OptionError(f"loss_scale is {scale!r}; expected 'auto' or a number")
        return None
    found = options.nonnegative("loss_scale", scale)
    if found == 0:
        raise OptionError("loss_scale is 0; expected a positive number, in units of chi")
    return found


def scale_of(loss: str, noise: float) -> float:
    """The scale of a robust loss where that is the noise, in units of chi."""
    return _TIMES[loss] * noise


def shares(loss: str, chi: Floats, scale: float) -> Floats:
    """(m,) what the loss leaves of the information of edges, from 1 to LEAST_SHARE.

    It is 1 / 2 at huber 2, cauchy 1, geman_mcclure .64 times the scale; tls has nothing between.
    """
    with np.errstate(divide="ignore", over="ignore"):
        u = chi / scale
        if loss == "huber":
            left = np.minimum(1.0, 1 / u)
        elif loss == "cauchy":
            left = 1 / (1 + u**2)
        elif loss == "geman_mcclure":
            left = 1 / (1 + u**2) ** 2
        else:
            left = (u <= 1).astype(np.float64)
    return np.asarray(np.maximum(left, LEAST_SHARE))


def reweighted(
    fit: Callable[[Floats], Floats],
    start: tuple[Floats, Floats],
    loss: str,
    scale: float | None,
    noise_of: Callable[[Floats], float],
    *,
    rounding: float,
    graduate: bool,
    trusted: NDArray[np.bool_] | None = None,
) -> tuple[Floats, float, bool]:
    """Shares (m,), the scale, and whether they have settled, by reweighted least squares.

    Args:
        fit: chi (m,) of what fits best with some shares (m,) of the information.
        start: shares, and chi of what fits best with them.
        loss: any but "l2".
        scale: None to take the noise of that time several times, until it is reached.
        noise_of: of chi.
        rounding: of chi: the least scale.
        graduate: begin with Geman and McClure's loss at the scale of the largest chi, and halve
            that each time, so that what most edges agree on comes first (graduated non-convexity).
        trusted: (m,) edges of which all is left.
    """
    now, chi = start
    stage = float(chi.max(initial=0.0)) if graduate else np.inf
    least = max(rounding, np.finfo(np.float64).tiny)
    wanted, last = np.inf, False
    for _ in range(_MAX_ROUNDS):
        if not last:
            before = wanted if graduate else 0.0
            wanted = max(least, scale_of(loss, noise_of(chi)) if scale is None else scale)
            stage = min(stage, max(wanted, stage / 2 if graduate else 0.0))
            # Once it falls little: that of fits to fewer and fewer edges would fall for ever.
            last = stage <= wanted and wanted >= _FALLS_LITTLE * before
        left = shares(loss if stage <= wanted else "geman_mcclure", chi, max(stage, least))
        if trusted is not None:
            left[trusted] = 1.0
        if last and np.abs(left - now).max(initial=0.0) < _SETTLED:
            return now, max(stage, least), True
        now = left
        chi = fit(now)
    return now, max(stage, least), False
