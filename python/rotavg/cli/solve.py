"""`rotavg solve`."""

from __future__ import annotations

import math
import shlex
import sys
import time
from pathlib import Path
from typing import Any, Literal

import click

import rotavg
from rotavg.cli import options
from rotavg.cli.command import Command, Count
from rotavg.cli.distributed import (
    check_distributed_options,
    distributed_options,
    solve_in_parts,
)
from rotavg.cli.follow import check_follow_options, follow_input, follow_option
from rotavg.cli.headings import check_heading_options, solve_upright
from rotavg.cli.known_edges import check_known_edges, known_edge_options, read_known_edges
from rotavg.cli.options import choice, number
from rotavg.cli.output import (
    print_json,
    print_notes,
    print_solution,
    print_solution_losses,
    print_text,
)
from rotavg.cli.poses import check_refinable
from rotavg.cli.priors import check_prior_options, prior_options, read_priors, with_doubts
from rotavg.cli.progress import progress, working
from rotavg.cli.reading import NAMES as READING
from rotavg.cli.reading import read_graph, reading_options
from rotavg.cli.start import init_option, read_start
from rotavg.cli.summary import summary
from rotavg.graph.conventions import Convention
from rotavg.io import atomic, check_writable
from rotavg.report import Run, check_report, write_report


@click.command(
    cls=Command,
    short_help="Find the rotations that fit best, and certify them.",
    groups={
        "Input and output": (
            *(
                "output",
                "report",
                "edges_path",
                "diagnostics_path",
                "format",
                "output_format",
                "columns",
            ),
            *("convention", "unit_weights", "skip_self_edges", "as_json"),
        ),
        "Which part": ("nodes_path", "largest_component", "min_nodes"),
        "Method": ("method", "init", "seed", "mu", "accelerate", "max_rank", "threads"),
        "The answer": ("gauge", "refine"),
        "Prior knowledge": (
            *("fixed_path", "fixed_convention", "gravity_path", "gravity_weight"),
            *("headings", "rigs_path", "no_rigs"),
        ),
        "Uncertainty": ("covariances_path", "noise_variance"),
        "Anisotropic noise": ("anisotropic", "anisotropic_log", "covariances"),
        "Outliers": (
            *("loss", "loss_scale", "weight_kind", "cycle_threshold", "min_cycles"),
            *("trusted_path", "trust_odometry", "excluded_path"),
        ),
        "Many machines": ("distributed", "scheduler", "parts"),
        "As data come in": ("follow",),
        "When to stop": ("tolerance", "stop", "max_iterations", "time_limit"),
        "Certificate": (
            *("certificate_tolerance", "certificate_failure_probability"),
            *("certificate_seed", "certificate_max_flops", "no_certify"),
        ),
    },
    epilog="Exit status: 0 solved (certified, or converged with --no-certify), 1 not solved, "
    "2 bad input or usage, 130 interrupted.",
)
@click.argument("input_path", metavar="INPUT", type=options.PATH)
@click.option(
    "-o",
    "--output",
    type=options.PATH,
    help="Write the poses; the name tells the format: .g2o, .csv, .tum, images.txt, ...",
)
@click.option(
    "--report", type=options.PATH, help="Write an interactive report to look at, an .html file."
)
@choice("--method", ["auto", "bcd", "sum", "newton", "staircase", "bcdsr"], "auto", "Solver.")
@init_option
@number("--seed", click.IntRange(0), 0, "Seed of --init random.")
@number("--tolerance", click.FloatRange(0), 1e-9, "Stop when the gradient (or step) is below this.")
@choice("--stop", ["gradient", "step"], "gradient", "What to stop on; 'step' is the paper's rule.")
@number("--max-iterations", Count(), 20000, "Limit on the number of iterations.")
@click.option(
    "--time-limit", type=click.FloatRange(0), metavar="SECONDS", help="Limit on all the work."
)
@click.option(
    "--threads",
    type=click.IntRange(1, 4096),
    metavar="N",
    help="Number of threads; the result is the same for any.  [default: all]",
)
@choice("--mu", ["adaptive", "min_eigenvalue"], "adaptive", "How --method sum chooses mu.")
@click.option(
    "--accelerate", is_flag=True, help="Extrapolate, with --method bcd and sum: fewer iterations."
)
@number(
    "--max-rank", click.IntRange(0, 100), 10, "How high the staircase climbs; below 5: not at all."
)
@choice(
    "--loss",
    ["l2", "auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls"],
    "l2",
    "Robust loss of the residual angles; 'auto' for data with outliers.",
)
@click.option(
    "--loss-scale",
    default="auto",
    metavar="DEG",
    show_default=True,
    help="The residual where the loss begins to distrust, degrees; auto: from the noise.",
)
@click.option(
    "--cycle-threshold",
    type=click.FloatRange(0, 180, min_open=True),
    metavar="DEG",
    help="Leave out edges that no short cycle agrees with: all of them, three (--min-cycles) at "
    "least, miss by more than this.",
)
@known_edge_options
@click.option(
    "--edges",
    "edges_path",
    type=options.PATH,
    help="Write a CSV file: residual, weights and verdict of every edge.",
)
@click.option(
    "--diagnostics",
    "diagnostics_path",
    type=options.PATH,
    help="Write a CSV file: what every node, frame and sensor adds to the objective.",
)
@prior_options
@choice(
    "--gauge", ["first", "mean"], "first", "What is the identity: the first rotation or the mean."
)
@click.option(
    "--refine-poses",
    "refine",
    is_flag=True,
    help="Refine rotations and positions of a pose graph together, with the file's information.",
)
@click.option(
    "--covariances",
    "covariances_path",
    type=options.PATH,
    help="Write a CSV file: how well the rotation of every node is known.",
)
@click.option(
    "--noise-variance",
    type=click.FloatRange(0, min_open=True),
    metavar="X",
    help="For --covariances: that of an edge of weight 1, per axis, radians^2.  "
    "[default: from the residuals]",
)
@click.option(
    "--anisotropic",
    is_flag=True,
    help="Honour the full covariances that the file has (g2o, TORO, text, CSV, npz) or that the "
    "inliers tell (COLMAP's databases), certified.",
)
@click.option(
    "--anisotropic-log",
    is_flag=True,
    help="The same, and on to a local minimum in the logarithms, which has no certificate.",
)
@number(
    "--certificate-tolerance",
    click.FloatRange(0),
    1e-6,
    "Largest relative gap that is called optimal.",
)
@number(
    "--certificate-failure-probability",
    click.FloatRange(0, 1, max_open=True),
    1e-12,
    "Chance of error that a proof may have where one without would cost much more; 0: none.",
)
@number("--certificate-seed", click.IntRange(0), 0, "Seed of such a proof.")
@number(
    "--certificate-max-flops",
    click.FloatRange(0),
    1e12,
    "Largest number of operations of a factorisation for the proof.",
)
@click.option("--no-certify", is_flag=True, help="Leave the certificate out.")
@follow_option
@distributed_options
@reading_options
@options.output_solution
@options.as_json
def solve(
    input_path: Path,
    output: Path | None,
    report: Path | None,
    threads: int | None,
    no_certify: bool,
    output_format: str | None,
    as_json: bool,
    loss_scale: str,
    cycle_threshold: float | None,
    trusted_path: Path | None,
    trust_odometry: bool,
    excluded_path: Path | None,
    edges_path: Path | None,
    diagnostics_path: Path | None,
    covariances_path: Path | None,
    noise_variance: float | None,
    fixed_path: Path | None,
    fixed_convention: Convention | None,
    gravity_path: Path | None,
    gravity_weight: float | None,
    headings: bool,
    rigs_path: Path | None,
    no_rigs: bool,
    refine: bool,
    distributed: bool,
    scheduler: str | None,
    parts: int | None,
    follow: bool,
    **settings: Any,
) -> int:
    """Find the rotations that fit the relative rotations in INPUT best, and certify them.

    \b
    Examples:
      rotavg solve graph.g2o -o solved.g2o --report report.html
      rotavg solve graph.txt --method sum --threads 4 --json
      rotavg solve photos.txt --loss auto --edges edges.csv
      rotavg solve photos.db --gravity gravity.txt --headings
      robot | rotavg solve --follow -
    """
    check_distributed_options(distributed)
    if follow:
        check_follow_options()
        scale = _radians(loss_scale)
        return follow_input(input_path, settings, None if scale == "auto" else scale)
    if distributed:
        return solve_in_parts(input_path, output, scheduler, parts, as_json, no_certify, settings)
    settings["loss_scale"] = _radians(loss_scale)
    if settings.pop("anisotropic_log"):
        settings["anisotropic"] = "log"
    if settings["anisotropic"]:
        settings["covariances"] = True  # of a database's pairs
    if cycle_threshold is not None:
        settings["cycle_threshold"] = math.radians(cycle_threshold)
    if output is not None:
        # Before the work, not after it.
        check_writable(output, output_format, solution=True, source=input_path)
    if noise_variance is not None and covariances_path is None:
        raise click.UsageError("--noise-variance is for --covariances, which is not given")
    if settings["loss"] == "l2" and loss_scale != "auto":
        raise click.UsageError("--loss-scale is for --loss, which is not given or l2")
    check_known_edges(settings["loss"], trusted_path, trust_odometry, settings["weight_kind"])
    if output_format is not None and output is None:
        raise click.UsageError("--output-format is for --output, which is not given")
    check_prior_options(
        fixed_path, fixed_convention, gravity_path, gravity_weight, rigs_path, no_rigs
    )
    if headings:
        check_heading_options(gravity_path)
    if report is not None:
        check_report(report)
    init = settings["init"]
    known = [
        fixed_path,
        gravity_path,
        rigs_path,
        trusted_path,
        excluded_path,
        settings["nodes_path"],
        init if isinstance(init, Path) else None,
    ]
    atomic.check_distinct([output], known)
    atomic.check_distinct(
        [edges_path, diagnostics_path, covariances_path, report], [input_path, output, *known]
    )
    for path in (edges_path, diagnostics_path, covariances_path):
        if path is not None:
            atomic.check_writable(path)
    start = time.perf_counter()
    with working(f"reading {input_path}"):
        graph = read_graph(input_path, **{name: settings.pop(name) for name in READING})
    read_seconds = time.perf_counter() - start
    if not as_json:
        print_notes(graph)
    if refine:
        check_refinable(input_path, graph)
    settings.update(read_known_edges(graph, trusted_path, trust_odometry, excluded_path))
    priors = read_priors(
        graph, fixed_path, fixed_convention, gravity_path, gravity_weight, rigs_path, no_rigs
    )
    if priors is not None:
        graph = with_doubts(graph, priors, told=not as_json)
    settings["priors"] = priors
    if isinstance(settings["init"], Path):
        settings["init"] = read_start(graph, settings["init"])
    interrupted = False
    with progress(settings["tolerance"], settings["stop"], not no_certify) as callback:
        try:
            solution = (solve_upright if headings else rotavg.solve)(
                graph, num_threads=threads, certify=not no_certify, callback=callback, **settings
            )
        except rotavg.Interrupted as stop:  # while certifying: what has converged is kept
            solution, interrupted = stop.solution, True
    poses = None
    try:
        if refine and not interrupted:
            with working("refining poses"):
                poses = rotavg.refine_poses(solution)
        if covariances_path is not None and not interrupted:
            with working("computing covariances"):
                rotavg.write_covariances(covariances_path, solution, noise_variance=noise_variance)
    finally:  # what was solved is written, whether it has covariances or not
        if output is not None:
            rotavg.write(output, solution if poses is None else poses, format=output_format)
        if edges_path is not None:
            rotavg.write_edges(edges_path, solution)
        if diagnostics_path is not None:
            rotavg.write_diagnostics(diagnostics_path, solution)
        if report is not None:
            with working(f"writing {report}"):
                write_report(report, solution, _run(input_path, read_seconds))
    if as_json:
        print_json(summary(solution, read_seconds, time.perf_counter() - start, poses))
    else:
        print_solution(solution)
        if poses is not None:
            print_text(f"  {'poses':<11} {poses}")
        for path in (output, edges_path, diagnostics_path, covariances_path, report):
            if path is not None:
                click.echo(f"wrote {path}", err=True)
        if output is not None:
            print_solution_losses(output, solution, output_format)
    if interrupted:
        raise KeyboardInterrupt
    return 0 if solution.solved else 1


def _run(input_path: Path, read_seconds: float) -> Run:
    """What the report says of how to repeat this."""
    settings = {
        name: value
        for name, value in click.get_current_context().params.items()
        if name
        not in (
            *("input_path", "output", "report", "edges_path", "diagnostics_path"),
            *("covariances_path", "as_json"),
        )
    }
    command = shlex.join(["rotavg", *sys.argv[1:]])
    return Run(command, input_path, settings, {"read": read_seconds})


def _radians(scale: str) -> float | Literal["auto"]:
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
