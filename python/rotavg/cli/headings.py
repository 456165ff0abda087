"""`rotavg solve --headings`: gravity is held, and headings alone are free."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import rotavg
from rotavg.cli.options import typed

# The options of `rotavg solve` that have no meaning there.
_EXCLUDED = {
    *("fixed_path", "gravity_weight", "trusted_path", "trust_odometry", "excluded_path"),
    *("covariances_path", "anisotropic", "anisotropic_log", "refine", "gauge"),
}
# And what of its settings is then as if it was not there.
_WITHOUT = ("trusted", "excluded", "anisotropic", "gauge")


def check_heading_options(gravity: Path | None) -> None:
    """UsageError without gravity, and for options that have no meaning."""
    if gravity is None:
        raise click.UsageError("--headings is for --gravity, which is not given")
    for name, option in typed().items():
        if name in _EXCLUDED:
            raise click.UsageError(f"{option} is not possible with --headings")


def solve_upright(
    graph: rotavg.MeasurementGraph, *, priors: rotavg.Priors, **settings: Any
) -> rotavg.Solution:
    """Headings alone, with the settings of the command."""
    rest = {name: value for name, value in settings.items() if name not in _WITHOUT}
    return rotavg.solve_headings(graph, priors, **rest)
