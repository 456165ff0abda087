"""`rotavg solve`: check the options, read, solve, write, print."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import click

import rotavg
from rotavg.cli.command import Command
from rotavg.cli.distributed import check_distributed_options, solve_in_parts
from rotavg.cli.follow import check_follow_options, follow_input
from rotavg.cli.headings import check_heading_options, solve_upright
from rotavg.cli.known_edges import KnownEdges, check_known_edges, read_known_edges
from rotavg.cli.losses import radians_of
from rotavg.cli.options import taken, typed
from rotavg.cli.output import beside_files, print_json, print_notes, print_solution, print_text
from rotavg.cli.poses import Refinement, fit_of
from rotavg.cli.priors import (
    KnownNodes,
    check_prior_options,
    priors_of_file,
    read_priors,
    with_doubts,
)
from rotavg.cli.progress import progress, working
from rotavg.cli.reading import NAMES as READING
from rotavg.cli.reading import read_graph
from rotavg.cli.solve_files import SolveFiles
from rotavg.cli.solve_options import GROUPS, solve_options
from rotavg.cli.start import read_start
from rotavg.cli.summary import summary


@click.command(
    cls=Command,
    short_help="Find the rotations that fit best, and certify them.",
    groups=GROUPS,
    epilog="Exit status: 0 solved (certified, or converged with --no-certify), 1 not solved, "
    "2 bad input or usage, 130 interrupted.",
)
@solve_options
def solve(
    input_path: Path,
    threads: int | None,
    no_certify: bool,
    as_json: bool,
    headings: bool,
    no_priors: bool,
    follow: bool,
    distributed: bool,
    scheduler: str | None,
    parts: int | None,
    **settings: Any,
) -> int:
    """Find the rotations that fit the relative rotations in INPUT best, and certify them.

    \b
    Examples:
      rotavg solve graph.g2o -o solved.g2o --report report.html
      rotavg solve graph.txt --method sum --threads 4 --json
      rotavg solve photos.txt --loss auto --edges edges.csv
      rotavg solve photos.db --gravity gravity.txt --headings
      zcat graph.g2o.gz | rotavg solve - -o - --output-format csv > solved.csv
      robot | rotavg solve --follow -
    """
    check_distributed_options(distributed)
    if follow:
        check_follow_options()
        scale = radians_of(settings["loss_scale"])
        return follow_input(input_path, settings, None if scale == "auto" else scale)
    if distributed:
        output = settings["output"]
        return solve_in_parts(input_path, output, scheduler, parts, as_json, no_certify, settings)
    _translate(settings)
    files, refinement = taken(SolveFiles, settings), taken(Refinement, settings)
    nodes, edges = taken(KnownNodes, settings), taken(KnownEdges, settings)
    _refuse_idle(settings, no_certify=no_certify, pose_loss=refinement.pose_loss)
    _check(settings, nodes, edges, refinement.pose_loss, headings)
    refinement.check()
    files.check(input_path, [*nodes.paths, *edges.paths, *_further_inputs(settings)])

    start = time.perf_counter()
    unit_weights = settings["unit_weights"]
    with working(f"reading {input_path}"):
        graph = read_graph(input_path, **{name: settings.pop(name) for name in READING})
    read_seconds = time.perf_counter() - start
    if not as_json:
        print_notes(graph)
    refinement.check_input(input_path, graph)
    aside = no_priors or headings
    of_poses = None if aside else priors_of_file(graph, unit_weights=unit_weights)
    graph = _read_what_is_known(graph, nodes, edges, of_poses, settings, told=not as_json)

    settings.update(num_threads=threads, certify=not no_certify)
    trusted = settings["trusted"]
    if settings["loss"] == "l2":  # of the poses alone
        settings["trusted"] = None
    solution, interrupted = _solve(graph, settings, headings=headings)

    poses = None
    try:
        if not interrupted:
            poses = refinement.run(solution, settings["priors"], trusted)
            files.write_covariances(solution)
    finally:  # what was solved is written, whether it has covariances or not
        files.write(solution, poses, input_path, read_seconds)

    fit = None if interrupted else fit_of(solution, poses, files.output, files.output_format)
    with beside_files(*files.paths):
        if as_json:
            seconds = time.perf_counter() - start
            print_json(summary(solution, read_seconds, seconds, poses, fit))
        else:
            print_solution(solution)
            if poses is not None:
                print_text(f"  {'poses':<11} {poses}")
            if fit is not None:
                print_text(f"  {'positions':<11} {fit}")
            files.tell(solution)
    if interrupted:
        raise KeyboardInterrupt
    return 0 if solution.solved else 1


def _translate(settings: dict[str, Any]) -> None:
    """Make the options of the command those of Python: angles are radians there."""
    settings["loss_scale"] = radians_of(settings["loss_scale"])
    threshold = settings.pop("cycle_threshold")
    if threshold is not None:
        settings["cycle_threshold"] = math.radians(threshold)
    if settings.pop("anisotropic_log"):
        settings["anisotropic"] = "log"
    if settings["anisotropic"]:
        if settings["unit_weights"]:
            found = "--anisotropic needs the covariances that --unit-weights leaves out"
            raise click.UsageError(found)
        settings["covariances"] = True  # of a database's pairs


def _check(
    settings: dict[str, Any], nodes: KnownNodes, edges: KnownEdges, pose_loss: str, headings: bool
) -> None:
    """UsageError for options that do not go together."""
    check_known_edges(settings["loss"], pose_loss, edges, settings["weight_kind"])
    check_prior_options(nodes)
    if headings:
        check_heading_options(nodes.gravity_path)


def _refuse_idle(settings: dict[str, Any], *, no_certify: bool, pose_loss: str) -> None:
    """UsageError for an option that was typed and would do nothing."""
    has_scale = settings["loss"] != "l2" or settings["loss_scale"] == "auto"
    # What each needs, and whether that is there.
    rejects = settings["loss"] != "l2" or "cycle_threshold" in settings or pose_loss != "l2"
    needs = {
        "mu": ("--method sum", settings["method"] == "sum"),
        "accelerate": ("--method bcd or sum", settings["method"] in ("bcd", "sum")),
        "seed": ("--init random", settings["init"] == "random"),
        "loss_scale": ("--loss, which is not given or l2", has_scale),
        "drop_outliers": ("a robust --loss or --pose-loss", rejects),
        "min_cycles": ("--cycle-threshold, which is not given", "cycle_threshold" in settings),
    }
    for name, option in typed().items():
        what, is_there = needs.get(name, ("", True))
        if not is_there:
            raise click.UsageError(f"{option} is for {what}")
        # (The limit of operations is that of a start's linear systems, too.)
        idle = name.startswith("certificate_") and name != "certificate_max_flops"
        if no_certify and idle:
            raise click.UsageError(f"{option} is not possible with --no-certify")


def _further_inputs(settings: dict[str, Any]) -> list[Path | None]:
    init = settings["init"]
    return [settings["nodes_path"], init if isinstance(init, Path) else None]


def _read_what_is_known(
    graph: rotavg.MeasurementGraph,
    nodes: KnownNodes,
    edges: KnownEdges,
    of_poses: rotavg.Priors | None,
    settings: dict[str, Any],
    *,
    told: bool,
) -> rotavg.MeasurementGraph:
    """Put it into the settings, the start as well; the graph, with doubts as its notes."""
    settings.update(read_known_edges(graph, edges))
    priors = settings["priors"] = read_priors(graph, nodes, of_poses)
    if priors is not None:
        graph = with_doubts(graph, priors, told=told)
    if isinstance(settings["init"], Path):
        settings["init"] = read_start(graph, settings["init"])
    return graph


def _solve(
    graph: rotavg.MeasurementGraph, settings: dict[str, Any], *, headings: bool
) -> tuple[rotavg.Solution, bool]:
    """The solution, and whether it was interrupted while it was certified."""
    shown = settings["tolerance"], settings["stop"], settings["certify"]
    with progress(*shown) as callback:
        try:
            solve = solve_upright if headings else rotavg.solve
            return solve(graph, callback=callback, **settings), False
        except rotavg.Interrupted as stop:  # what has converged is kept
            return stop.solution, True
