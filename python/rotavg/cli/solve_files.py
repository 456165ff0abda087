"""The files that `rotavg solve` writes."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import click

import rotavg
from rotavg.cli.output import print_solution_losses
from rotavg.cli.progress import working
from rotavg.io import atomic, check_writable
from rotavg.report import Run, check_report, write_report


@dataclass(frozen=True)
class SolveFiles:
    """Their paths, None for those that are not wanted, by the names of the options."""

    output: Path | None
    output_format: str | None
    drop_outliers: bool
    edges_path: Path | None
    diagnostics_path: Path | None
    covariances_path: Path | None
    noise_variance: float | None
    report: Path | None

    @property
    def paths(self) -> tuple[Path | None, ...]:
        """All that are written."""
        tables = self.edges_path, self.diagnostics_path, self.covariances_path
        return (self.output, *tables, self.report)

    def check(self, input_path: Path, known: list[Path | None]) -> None:
        """Refuse before the work what cannot be written after it.

        Args:
            input_path: the graph, which the output alone may replace.
            known: all other files that are read.
        """
        if self.output is not None:
            check_writable(
                self.output,
                self.output_format,
                solution=True,
                source=input_path,
                drop_outliers=self.drop_outliers,
            )
        if self.noise_variance is not None and self.covariances_path is None:
            raise click.UsageError("--noise-variance is for --covariances, which is not given")
        if self.output_format is not None and self.output is None:
            raise click.UsageError("--output-format is for --output, which is not given")
        if self.drop_outliers and self.output is None:
            raise click.UsageError("--drop-outliers is for --output, which is not given")
        if self.report is not None:
            check_report(self.report)
        tables = [self.edges_path, self.diagnostics_path, self.covariances_path]
        atomic.check_distinct([self.output], known)
        atomic.check_distinct([*tables, self.report], [input_path, self.output, *known])
        for path in tables:
            if path is not None:
                atomic.check_writable(path)

    def write_covariances(self, solution: rotavg.Solution) -> None:
        """How well every rotation is known, which takes a while; SolverError if nobody can say."""
        if self.covariances_path is not None:
            with working("computing covariances"):
                rotavg.write_covariances(
                    self.covariances_path, solution, noise_variance=self.noise_variance
                )

    def write(
        self,
        solution: rotavg.Solution,
        poses: rotavg.PoseSolution | None,
        input_path: Path,
        read_seconds: float,
    ) -> None:
        """All others; `poses`, if there are any, instead of the rotations alone."""
        if self.output is not None:
            rotavg.write(
                self.output,
                solution if poses is None else poses,
                format=self.output_format,
                drop_outliers=self.drop_outliers,
            )
        if self.edges_path is not None:
            rotavg.write_edges(self.edges_path, solution)
        if self.diagnostics_path is not None:
            rotavg.write_diagnostics(self.diagnostics_path, solution)
        if self.report is not None:
            with working(f"writing {self.report}"):
                write_report(self.report, solution, _run(input_path, read_seconds))

    def tell(self, solution: rotavg.Solution) -> None:
        """Say on stderr what was written, and what of the solution is not in it."""
        for path in self.paths:
            if path is not None:
                click.echo(f"wrote {path}", err=True)
        if self.output is not None:
            print_solution_losses(self.output, solution, self.output_format)


def _run(input_path: Path, read_seconds: float) -> Run:
    """What the report says of how to repeat this."""
    context = click.get_current_context()
    beside = (
        *("input_path", "output", "report", "edges_path", "diagnostics_path"),
        *("covariances_path", "as_json"),
    )
    settings = {
        max(option.opts, key=len): context.params[option.name]
        for option in context.command.params
        if option.name in context.params and option.name not in beside
    }
    command = shlex.join(["rotavg", *sys.argv[1:]])
    return Run(command, input_path, settings, {"read": read_seconds})
