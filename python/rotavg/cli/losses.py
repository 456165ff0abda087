"""Options of robust losses, for the commands that solve."""

from __future__ import annotations

import math
from typing import Any, Callable, Literal

import click

from rotavg.cli.options import choice


def loss_options(default: str) -> Callable[[Any], Any]:
    """`--loss` and `--loss-scale`, with the default of the first."""
    loss = choice(
        "--loss",
        ["l2", "auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls"],
        default,
        "Robust loss of the residual angles; 'auto' for data with outliers.",
    )
    scale = click.option(
        "--loss-scale",
        default="auto",
        metavar="DEG",
        show_default=True,
        help="Residual beyond which the loss gives an edge less weight, degrees; auto: from the "
        "estimated noise.",
    )
    return lambda command: loss(scale(command))


def radians_of(scale: str) -> float | Literal["auto"]:
    """What `--loss-scale` says, in radians; usage error for neither a word nor degrees."""
    if scale == "auto":
        return "auto"
    try:
        degrees = float(scale)
    except ValueError:
        degrees = math.nan
    if not 1e-4 <= degrees <= 180:
        raise click.BadParameter(
            f"{scale!r} is neither 'auto' nor a number of degrees from 0.0001 to 180",
            param_hint="'--loss-scale'",
        )
    return math.radians(degrees)
