"""The options of `rotavg solve`, in the order in which help lists them."""

from __future__ import annotations

from typing import Any, Callable, TypeVar

import click

from rotavg.cli import options
from rotavg.cli.command import Count
from rotavg.cli.distributed import distributed_options
from rotavg.cli.follow import follow_option
from rotavg.cli.known_edges import known_edge_options
from rotavg.cli.losses import loss_options
from rotavg.cli.options import choice, number
from rotavg.cli.poses import pose_options
from rotavg.cli.priors import prior_options
from rotavg.cli.reading import reading_options
from rotavg.cli.start import init_option

F = TypeVar("F", bound=Callable[..., Any])

# The names of the parameters under each title.
GROUPS = {
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
    "The answer": ("gauge", "refine", "pose_loss", "pose_loss_scale"),
    "Prior knowledge": (
        *("fixed_path", "fixed_convention", "gravity_path", "gravity_weight"),
        *("headings", "rigs_path", "no_rigs", "no_priors"),
    ),
    "Uncertainty": ("covariances_path", "noise_variance"),
    "Anisotropic noise": ("anisotropic", "anisotropic_log", "covariances"),
    "Outliers": (
        *("loss", "loss_scale", "weight_kind", "cycle_threshold", "min_cycles"),
        *("trusted_path", "trust_odometry", "excluded_path"),
        "drop_outliers",
    ),
    "Many machines": ("distributed", "scheduler", "parts"),
    "As data come in": ("follow",),
    "When to stop": ("tolerance", "stop", "max_iterations", "time_limit"),
    "Certificate": (
        *("certificate_tolerance", "certificate_failure_probability"),
        *("certificate_seed", "certificate_max_flops", "no_certify"),
    ),
}

_OPTIONS: tuple[Callable[[Any], Any], ...] = (
    click.argument("input_path", metavar="INPUT", type=options.INPUT),
    click.option(
        "-o",
        "--output",
        type=options.OUTPUT,
        help="Write the poses; the name tells the format: .g2o, .csv, .tum, images.txt, ...; of a "
        "COLMAP database also a new folder, for a model.",
    ),
    click.option(
        "--report",
        type=options.OUTPUT,
        help="Write an interactive report to look at, an .html file.",
    ),
    choice("--method", ["auto", "bcd", "sum", "newton", "staircase", "bcdsr"], "auto", "Solver."),
    init_option,
    number("--seed", click.IntRange(0), 0, "Seed of --init random."),
    number(
        "--tolerance", click.FloatRange(0), 1e-9, "Stop when the gradient (or step) is below this."
    ),
    choice(
        "--stop", ["gradient", "step"], "gradient", "What to stop on; 'step' is the paper's rule."
    ),
    number("--max-iterations", Count(), 20000, "Limit on the number of iterations."),
    click.option(
        "--time-limit", type=click.FloatRange(0), metavar="SECONDS", help="Limit on all the work."
    ),
    click.option(
        "--threads",
        type=click.IntRange(1, 4096),
        metavar="N",
        help="Number of threads; the result is the same for any.  [default: all]",
    ),
    choice("--mu", ["adaptive", "min_eigenvalue"], "adaptive", "How --method sum chooses mu."),
    click.option(
        "--accelerate",
        is_flag=True,
        help="Extrapolate, with --method bcd and sum: fewer iterations.",
    ),
    number(
        "--max-rank",
        click.IntRange(0, 100),
        10,
        "How high the staircase climbs; below 5: not at all.",
    ),
    loss_options("l2"),
    click.option(
        "--cycle-threshold",
        type=click.FloatRange(0, 180, min_open=True),
        metavar="DEG",
        help="Leave out an edge that lies on three (--min-cycles) or more short cycles, all of "
        "which miss the identity by more than this.",
    ),
    known_edge_options,
    click.option(
        "--drop-outliers",
        is_flag=True,
        help="Leave rejected edges, also those of --pose-loss, out of the pose graph that -o "
        "writes.",
    ),
    click.option(
        "--edges",
        "edges_path",
        type=options.OUTPUT,
        help="Write a CSV file: residual, weights and verdict of every edge.",
    ),
    click.option(
        "--diagnostics",
        "diagnostics_path",
        type=options.OUTPUT,
        help="Write a CSV file: what every node, frame and sensor adds to the objective.",
    ),
    prior_options,
    choice(
        "--gauge",
        ["first", "mean"],
        "first",
        "What is the identity: the first rotation or the mean.",
    ),
    pose_options,
    click.option(
        "--covariances",
        "covariances_path",
        type=options.OUTPUT,
        help="Write a CSV file: how well the rotation of every node is known.",
    ),
    click.option(
        "--noise-variance",
        type=click.FloatRange(0, min_open=True),
        metavar="X",
        help="For --covariances: that of an edge of weight 1, per axis, radians^2.  "
        "[default: from the residuals]",
    ),
    click.option(
        "--anisotropic",
        is_flag=True,
        help="Honour the full covariances that the file has (pose graphs, text, CSV, npz) or that "
        "the inliers tell (COLMAP's databases), certified.",
    ),
    click.option(
        "--anisotropic-log",
        is_flag=True,
        help="The same, and on to a local minimum in the logarithms, which has no certificate.",
    ),
    number(
        "--certificate-tolerance",
        click.FloatRange(0),
        1e-6,
        "Largest relative gap that is called optimal.",
    ),
    number(
        "--certificate-failure-probability",
        click.FloatRange(0, 1, max_open=True),
        1e-12,
        "Largest chance of error of a randomised proof, tried where a deterministic one would "
        "cost much more; 0: never.",
    ),
    number("--certificate-seed", click.IntRange(0), 0, "Seed of such a proof."),
    number(
        "--certificate-max-flops",
        click.FloatRange(0),
        1e12,
        "Largest number of operations of a factorisation for the proof.",
    ),
    click.option("--no-certify", is_flag=True, help="Leave the certificate out."),
    follow_option,
    distributed_options,
    reading_options,
    options.output_solution,
    options.as_json,
)


def solve_options(command: F) -> F:
    """All of them, and the input."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command
