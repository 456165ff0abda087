"""`rotavg colmap`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

import rotavg
from rotavg.base.errors import require
from rotavg.cli import options
from rotavg.cli.command import Command, Count
from rotavg.cli.losses import loss_options, radians_of
from rotavg.cli.options import number, taken
from rotavg.cli.output import print_json, print_table
from rotavg.cli.priors import (
    KnownNodes,
    check_prior_options,
    known_node_options,
    read_priors,
    with_doubts,
)
from rotavg.colmap.draw import save_picture
from rotavg.colmap.mapper import Reconstruction, check_new_folder, reconstruct
from rotavg.solving.kept import median_high_largest
from rotavg.solving.printed import verdict_sentence


@click.command(
    cls=Command,
    short_help="Reconstruct a scene with COLMAP's global mapper.",
    groups={
        "Output": ("output", "picture", "as_json"),
        "Method": ("loss", "loss_scale", "max_residual", "anisotropic", "seed", "threads"),
        "Prior knowledge": (
            *("fixed_path", "fixed_convention", "gravity_path", "gravity_weight"),
            *("rigs_path", "no_rigs"),
        ),
    },
)
@click.argument("database", type=options.PATH)
@click.argument("images", type=options.PATH)
@click.option("-o", "--output", type=options.PATH, required=True, help="A folder, to be made.")
@loss_options("auto")
@number("--max-residual", click.FloatRange(0, 180), 10.0, "Leave out pairs off by more, degrees.")
@number("--seed", Count(), 0, "Of the mapper's random start.")
@click.option(
    "--anisotropic",
    is_flag=True,
    help="Honour the covariances of the relative rotations, estimated from the pairs' inliers.",
)
@click.option(
    "--threads",
    type=click.IntRange(1, 4096),
    metavar="N",
    help="Number of threads.  [default: all]",
)
@known_node_options
@click.option("--picture", is_flag=True, help="Also draw points and cameras: OUTPUT/picture.png.")
@options.as_json
def colmap(
    database: Path,
    images: Path,
    output: Path,
    max_residual: float,
    threads: int | None,
    picture: bool,
    as_json: bool,
    loss_scale: str,
    **settings: Any,
) -> int:
    """Reconstruct a scene: rotations by rotavg, positions and points by COLMAP's global mapper.

    DATABASE is COLMAP's, with matches and two-view geometries (COLMAP's own, or those of
    `rotavg images --database`), and is only read. IMAGES is the folder of the images. The output
    folder gets COLMAP's models 0, 1, ..., the rotations that rotavg found, and the copy of the
    database with consistent relative rotations. Needs pycolmap: pip install "rotavg[colmap]".

    \b
    Examples:
      rotavg colmap photographs.db photographs -o scene
      rotavg colmap database.db images -o scene --picture --threads 4
      rotavg colmap database.db images -o scene --gravity database.db
    """
    known = taken(KnownNodes, settings)
    check_prior_options(known)
    settings["loss_scale"] = radians_of(loss_scale)
    if settings["loss"] == "l2" and settings["loss_scale"] != "auto":
        raise click.UsageError("--loss-scale is for --loss, which is l2")
    check_new_folder(output)
    if picture:
        require("matplotlib", "plot")
    if known != KnownNodes():
        graph = rotavg.read(database, format="colmap")
        priors = settings["priors"] = read_priors(graph, known)
        if priors is not None:
            with_doubts(graph, priors, told=True)
    with _waiting("reconstructing"):
        found = reconstruct(
            database,
            images,
            output,
            max_residual=float(np.radians(max_residual)),
            num_threads=threads,
            **settings,
        )
    rotavg.write(output / "rotations.npz", found.solution)
    if picture:
        save_picture(found.models[0].path, output / "picture.png")
    if as_json:
        print_json(_summary(found))
    else:
        print_table(_rows(found))
        click.echo(f"wrote {output}", err=True)
    return 0


def _waiting(text: str) -> Any:
    """A sign of life on stderr; nothing where that is no terminal."""
    return Console(stderr=True, quiet=not sys.stderr.isatty()).status(text)


def _summary(found: Reconstruction) -> dict[str, Any]:
    solution = found.solution
    return {
        "models": [
            {
                "path": str(model.path), "images": model.images, "points": model.points,
                "reprojection_error": model.reprojection_error,
            }
            for model in found.models
        ],
        "nodes": solution.graph.num_nodes,
        "edges": solution.graph.num_edges,
        "dropped": found.dropped,
        "objective": solution.objective,
        "verdict": None if solution.certificate is None else solution.certificate.verdict.value,
    }  # fmt: skip


def _rows(found: Reconstruction) -> list[tuple[str, str]]:
    solution = found.solution
    median, _, largest = median_high_largest(solution)
    kept = "" if solution.robust is None else " (of the edges it kept)"
    rows = [
        ("rotations", f"{solution.graph.num_nodes}, from {solution.graph.num_edges} pairs"),
        ("residuals", f"median {median:.3g} deg, largest {largest:.3g}{kept}"),
        ("left out", f"{found.dropped} pairs that contradict them"),
    ]
    if solution.certificate is not None:
        rows.insert(1, ("verdict", verdict_sentence(solution, solution.certificate)))
    for model in found.models:
        text = f"{model.images} images, {model.points} points, mean reprojection error "
        rows.append((f"model {model.path.name}", f"{text}{model.reprojection_error:.3g} pixels"))
    return rows
