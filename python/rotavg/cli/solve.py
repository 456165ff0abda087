"""`rotavg solve`."""

from __future__ import annotations

import math
import time
from collections import Counter
from pathlib import Path
from typing import Any, Literal

import click

import rotavg
from rotavg.cli import options
from rotavg.cli.options import choice, number
from rotavg.cli.output import print_json, print_notes, print_text, progress
from rotavg.io import atomic, check_writable


@click.command(
    epilog="Exit status: 0 solved (certified, or converged with --no-certify), 1 not solved, "
    "2 bad input or usage."
)
@click.argument("input_path", metavar="INPUT", type=options.PATH)
@click.option("-o", "--output", type=options.PATH, help="Write a .g2o, .txt, .csv or .npz file.")
@choice("--method", ["auto", "bcd", "sum", "newton"], "auto", "Solver.")
@choice(
    "--init",
    ["auto", "shortest_path", "spanning_tree", "chordal", "quaternion", "random"],
    "auto",
    "Initial value.",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of --init random.")
@number("--tolerance", click.FloatRange(0), 1e-9, "Stop when the gradient (or step) is below this.")
@choice("--stop", ["gradient", "step"], "gradient", "What to stop on; 'step' is the paper's rule.")
@number(
    "--max-iterations", click.IntRange(0, 2**31 - 1), 20000, "Limit on the number of iterations."
)
@click.option(
    "--time-limit", type=click.FloatRange(0), metavar="SECONDS", help="Limit on the work."
)
@click.option("--threads", type=click.IntRange(1, 4096), help="Number of threads.  [default: all]")
@choice("--mu", ["adaptive", "min_eigenvalue"], "adaptive", "How --method sum chooses mu.")
@click.option(
    "--accelerate", is_flag=True, help="Extrapolate, with --method bcd and sum: fewer iterations."
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
    help="Where the loss begins to distrust, degrees.",
)
@click.option(
    "--cycle-threshold",
    type=click.FloatRange(0, 180, min_open=True),
    metavar="DEG",
    help="Leave out edges each of whose three or more short cycles misses by more degrees.",
)
@click.option(
    "--edges",
    "edges_path",
    type=options.PATH,
    help="Write a CSV file: residual, weights and verdict of every edge.",
)
@click.option("--no-certify", is_flag=True, help="Leave the certificate out.")
@options.unit_weights
@options.as_json
def solve(
    input_path: Path,
    output: Path | None,
    threads: int | None,
    no_certify: bool,
    unit_weights: bool,
    as_json: bool,
    loss_scale: str,
    cycle_threshold: float | None,
    edges_path: Path | None,
    **settings: Any,
) -> int:
    """Find the rotations that fit the relative rotations in INPUT best, and certify them.

    \b
    Examples:
      rotavg solve graph.g2o -o solved.g2o
      rotavg solve graph.txt --method sum --threads 4 --json
      rotavg solve photos.txt --loss auto --edges edges.csv
    """
    settings["loss_scale"] = _radians(loss_scale)
    if cycle_threshold is not None:
        settings["cycle_threshold"] = math.radians(cycle_threshold)
    if output is not None:
        check_writable(output)  # before the work, not after it
    if edges_path is not None:
        atomic.check_writable(edges_path)
    start = time.perf_counter()
    graph = rotavg.read(input_path, unit_weights=unit_weights)
    read_seconds = time.perf_counter() - start
    if not as_json:
        print_notes(graph)
    with progress() as callback:
        solution = rotavg.solve(
            graph, num_threads=threads, certify=not no_certify, callback=callback, **settings
        )
    if output is not None:
        rotavg.write(output, solution)
    if edges_path is not None:
        rotavg.write_edges(edges_path, solution)
    if as_json:
        print_json(_summary(solution, read_seconds, time.perf_counter() - start))
    else:
        print_text(str(solution))
        if output is not None:
            click.echo(f"wrote {output}", err=True)
        if edges_path is not None:
            click.echo(f"wrote {edges_path}", err=True)
    return 0 if solution.solved else 1


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


def _robust(solution: rotavg.Solution) -> dict[str, Any] | None:
    r = solution.robust
    if r is None:
        return None
    return {
        "loss": r.loss,
        "scale_deg": math.degrees(r.scale),
        "noise_deg": math.degrees(r.noise),
        "threshold_deg": math.degrees(r.threshold),
        "objective": r.objective,
        "outliers": int(solution.is_outlier.sum()),
        "verdicts": dict(Counter(r.edge_verdicts.tolist())),
        "parts": r.num_parts,
    }


def _summary(solution: rotavg.Solution, read: float, total: float) -> dict[str, Any]:
    c = solution.certificate
    return {
        "nodes": solution.graph.num_nodes,
        "edges": solution.graph.num_edges,
        "components": solution.num_components,
        "method": solution.method,
        "reason": solution.reason,
        "init": solution.init,
        "status": solution.status.name.lower(),
        "solved": solution.solved,
        "objective": solution.objective,
        "gradient_norm": solution.gradient_norm,
        "relative_gradient": solution.relative_gradient,
        "iterations": solution.iterations,
        "certificate": None
        if c is None
        else {
            "verdict": c.verdict.value,
            "lambda_min": c.lambda_min,
            "gap": c.gap,
            "relative_gap": c.relative_gap,
            "method": c.method,
        },
        "robust": _robust(solution),
        "notes": list(solution.graph.notes),
        "seconds": {
            "read": read,
            "init": solution.timings.init,
            "solve": solution.timings.solve,
            "certify": solution.timings.certify,
            "total": total,
        },
    }
