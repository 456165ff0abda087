"""`rotavg solve --distributed`: on the workers of a Dask cluster."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any, Callable, TypeVar

import click

import rotavg
from rotavg.base.errors import require
from rotavg.cli.options import typed
from rotavg.cli.output import print_json, print_text
from rotavg.cli.progress import NowAndThen
from rotavg.distributed import DistributedSolution, Interrupted, Round, solve
from rotavg.io.atomic import make_folder

F = TypeVar("F", bound=Callable[..., Any])

# The options of `rotavg solve` that a distributed solve has a use for.
KNOWN = {
    *("input_path", "output", "as_json", "distributed", "scheduler", "parts"),
    *("tolerance", "time_limit", "loss", "seed", "no_certify"),
    *("certificate_tolerance", "certificate_failure_probability"),
}


def distributed_options(command: F) -> F:
    """Those that `rotavg solve --distributed` adds."""
    for option in (
        click.option(
            "--parts",
            type=click.IntRange(1),
            metavar="N",
            help="Parts of the graph.  [default: one for each thread of the workers]",
        ),
        click.option(
            "--scheduler",
            metavar="ADDRESS",
            help="Of a running Dask cluster.  [default: processes on this machine]",
        ),
        click.option(
            "--distributed",
            is_flag=True,
            help="Divide the graph among processes; INPUT may be a folder of files with its edges.",
        ),
    ):
        command = option(command)
    return command


def check_distributed_options(distributed: bool) -> None:
    """Refuse, by name, what only one of the two has a use for."""
    for name, option in typed().items():
        if distributed and name not in KNOWN:
            raise click.UsageError(f"{option} is not possible with --distributed")
        if not distributed and name in ("scheduler", "parts"):
            raise click.UsageError(f"{option} is for --distributed, which is not given")


def solve_in_parts(
    input_path: Path,
    output: Path | None,
    scheduler: str | None,
    parts: int | None,
    as_json: bool,
    no_certify: bool,
    settings: dict[str, Any],
) -> int:
    """Solve, write and print; the exit status.

    Args:
        input_path: a folder of files, or one file.
        output: the folder for the parts of the solution.
        scheduler: its address; None for processes on this machine.
        parts: how many; None for one a thread.
        as_json: whether to print one JSON object.
        no_certify: whether to leave the certificate out.
        settings: the other options of the command, by their Python names.
    """
    known = {
        "failure_probability": settings["certificate_failure_probability"],
        **{name: settings[name] for name in ("tolerance", "time_limit", "loss", "seed")},
        "certificate_tolerance": settings["certificate_tolerance"],
    }
    require("distributed", "distributed")
    if output is not None:
        make_folder(output)  # before the work
    source: Any = input_path if input_path.is_dir() else rotavg.read(input_path)
    with NowAndThen("reading and dividing the graph") as told:

        def tell(r: Round) -> None:
            told.text = (
                f"round {r.number}, objective {r.objective:.9g}, "
                f"relative gradient {r.relative_gradient:.1e}"
            )
            if r.relative_gradient <= known["tolerance"] and not no_certify:
                told.text += ", certifying"

        interrupted = False
        with _client(scheduler) as client, ExitStack() as processes:
            try:
                solution = solve(
                    source,
                    client=client,
                    parts=parts,
                    certify=not no_certify,
                    callback=tell,
                    **known,
                )
            except Interrupted as stop:  # while certifying: what has converged is kept
                solution, interrupted = stop.solution, True
            processes.enter_context(solution)
            if output is not None:
                solution.write(output)
            if as_json:
                print_json(_summary(solution))
            else:
                print_text(str(solution))
                if output is not None:
                    click.echo(f"wrote {output}", err=True)
    if interrupted:
        raise KeyboardInterrupt
    return 0 if solution.solved else 1


def _client(scheduler: str | None) -> Any:
    """That of a running cluster; or None, for processes that end with the solution."""
    if scheduler is None:
        return nullcontext()
    distributed = require("distributed", "distributed")
    try:
        return distributed.Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise click.BadParameter(
            f"no scheduler answers at {scheduler!r}: {error}", param_hint="'--scheduler'"
        ) from None


def _summary(solution: DistributedSolution) -> dict[str, Any]:
    certificate = solution.certificate
    return {
        "objective": solution.objective,
        "relative_gradient": solution.relative_gradient,
        "converged": solution.converged,
        "reason": solution.reason,
        "nodes": solution.num_nodes,
        "edges": solution.num_edges,
        "parts": solution.num_parts,
        "rounds": [asdict(round) for round in solution.rounds],
        "robust": None if solution.robust is None else asdict(solution.robust),
        "certificate": None
        if certificate is None
        else {
            "verdict": str(certificate.verdict),
            "sentence": solution.verdict_sentence,
            "gap": certificate.gap,
            "relative_gap": certificate.relative_gap,
            "method": certificate.method,
            "failure_probability": certificate.failure_probability,
        },
    }
