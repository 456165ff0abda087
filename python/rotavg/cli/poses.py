"""Poses refined as a whole, and how well positions fit, for `rotavg solve`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Literal, TypeVar

import click
import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import require
from rotavg.cli.options import choice, typed
from rotavg.cli.progress import working
from rotavg.io.formats import has_positions
from rotavg.priors.priors import Priors
from rotavg.solving.known_poses import known_poses
from rotavg.solving.pose_losses import POSE_LOSSES

F = TypeVar("F", bound=Callable[..., Any])


def pose_options(command: F) -> F:
    """How poses are refined."""
    for option in reversed(
        (
            click.option(
                "--refine-poses",
                "refine",
                is_flag=True,
                help="Refine rotations and positions of a pose graph together, with the file's "
                "information.",
            ),
            choice(
                "--pose-loss",
                list(POSE_LOSSES),
                "l2",
                "Robust loss of --refine-poses, for wrong translations; tls leaves them out.",
            ),
            click.option(
                "--pose-loss-scale",
                default="auto",
                metavar="CHI",
                show_default=True,
                help="Where that begins, in standard deviations of the file's information; auto: "
                "several times the noise that most edges show.",
            ),
        )
    ):
        command = option(command)
    return command


@dataclass(frozen=True)
class Refinement:
    """What was asked for, by the names of the options."""

    refine: bool
    pose_loss: Literal["l2", "huber", "cauchy", "geman_mcclure", "tls"]
    pose_loss_scale: str

    def check(self) -> None:
        """UsageError for options that would do nothing, or a scale that is none."""
        for name, option in typed().items():
            if name in ("pose_loss", "pose_loss_scale") and not self.refine:
                raise click.UsageError(f"{option} is for --refine-poses, which is not given")
            if name == "pose_loss_scale" and self.pose_loss == "l2":
                raise click.UsageError(f"{option} is for --pose-loss, which is not given or l2")
        self._scale()

    def check_input(self, path: Path, graph: rotavg.MeasurementGraph) -> None:
        """Raise what `rotavg.refine_poses` would raise, as far as it is known before the work."""
        if not self.refine:
            return
        require("scipy.sparse.linalg", "scipy")
        if graph.translations is None:
            found = "the graph has no relative translations"
            raise rotavg.FormatError(f"{found}: there are no poses to refine", path=path)

    def run(
        self,
        solution: rotavg.Solution,
        priors: rotavg.Priors | None,
        trusted: NDArray[np.bool_] | None,
    ) -> rotavg.PoseSolution | None:
        """The refined poses, if they were asked for, with the priors of the solution.

        A robust loss of the poses does not touch trusted edges (m,).
        """
        if not self.refine:
            return None
        if solution.grounded is not None:
            priors = None  # it has them, and the rigs that were found
        scale = self._scale()
        with working("refining poses"):
            return rotavg.refine_poses(
                solution,
                priors=priors,
                loss=self.pose_loss,
                loss_scale=scale,
                trusted=None if self.pose_loss == "l2" else trusted,
            )

    def _scale(self) -> float | Literal["auto"]:
        if self.pose_loss_scale == "auto":
            return "auto"
        try:
            scale = float(self.pose_loss_scale)
        except ValueError:
            scale = 0.0
        if not 0 < scale < float("inf"):
            raise click.BadParameter(
                f"{self.pose_loss_scale!r} is neither 'auto' nor a positive number",
                param_hint="'--pose-loss-scale'",
            )
        return scale


def fit_of(
    solution: rotavg.Solution,
    poses: rotavg.PoseSolution | None,
    output: Path | None,
    format: str | None,
) -> rotavg.TranslationFit | None:
    """How well translations fit the positions that are refined, or written; None without such."""
    if poses is not None:
        return poses.translation_fit
    graph = solution.graph
    if output is None or graph.translations is None or not has_positions(output, format):
        return None
    try:  # as the file has them, whose fixed poses stay
        known = known_poses(solution, getattr(graph.source, "fixed_poses", {}), Priors())
        start = known.start(solution)
        return rotavg.translation_fit(graph, *start, kept=~solution.is_outlier)
    except rotavg.SolverError:  # of which `write` has warned
        return None
