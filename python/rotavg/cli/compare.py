"""`rotavg compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable

import click
import numpy as np

import rotavg
from rotavg.cli import options
from rotavg.cli.output import print_json, print_table
from rotavg.compare import SHARES_DEG
from rotavg.conventions import Convention
from rotavg.ids import rows_of
from rotavg.io.rotations import KINDS, read_rotations


def _format(name: str, of: str) -> Callable[[Any], Any]:
    return click.option(name, type=click.Choice(KINDS), help=f"Format of {of}, if not told by it.")


def _convention(name: str, of: str) -> Callable[[Any], Any]:
    text = f"Family of {of}: pose (world_from_node, the default) or vision (its transpose)."
    return click.option(name, type=click.Choice(["pose", "vision"]), help=text)


@click.command()
@click.argument("solution_path", metavar="SOLUTION", type=options.PATH)
@click.argument("reference_path", metavar="REFERENCE", type=options.PATH)
@_format("--format", "SOLUTION")
@_convention("--convention", "SOLUTION")
@_format("--reference-format", "REFERENCE")
@_convention("--reference-convention", "REFERENCE")
@options.as_json
def compare(
    solution_path: Path,
    reference_path: Path,
    format: str | None,
    convention: Convention | None,
    reference_format: str | None,
    reference_convention: Convention | None,
    as_json: bool,
) -> None:
    """Tell how far the rotations in SOLUTION are from those in REFERENCE.

    Both are text or CSV files of `id qx qy qz qw`, npz archives of solutions, g2o files with
    vertices, or GLOMAP's rotations (*glomap_rotations.txt). They are compared at
    the nodes that both have, after the common rotation that leaves the least sum of angles.

    \b
    Example:
      rotavg compare solved.txt truth.txt
    """
    nodes, rotations = read_rotations(solution_path, format=format, convention=convention)
    known, reference = read_rotations(
        reference_path, format=reference_format, convention=reference_convention
    )
    rows = rows_of(nodes, known)
    common = rows >= 0
    if not common.any():
        example = f"{nodes[0].item()!r} there, {known[0].item()!r} here"
        raise rotavg.FormatError(
            f"no node of {solution_path} is in it (say, {example}), expected common ids",
            path=reference_path,
        )
    result = rotavg.compare(rotations[common], reference[rows[common]])
    degrees = np.degrees([result.median, result.mean, result.rms, result.angles.max()])
    shares = [result.share_below(float(np.radians(d))) for d in SHARES_DEG]
    if as_json:
        print_json({
            "nodes": len(result.angles),
            "only_in_solution": int((~common).sum()),
            "only_in_reference": len(known) - int(common.sum()),
            **dict(zip(("median_deg", "mean_deg", "rms_deg", "max_deg"), degrees.tolist())),
            **{f"share_below_{d}_deg": share for d, share in zip(SHARES_DEG, shares)},
        })  # fmt: skip
        return
    print_table([
        (
            "nodes",
            f"{len(result.angles)} in both, {int((~common).sum())} in the solution only, "
            f"{len(known) - int(common.sum())} in the reference only",
        ),
        (
            "error",
            "median {:.4g} deg, mean {:.4g}, RMS {:.4g}, largest {:.4g}".format(*degrees),
        ),
        (
            "below",
            ", ".join(f"{d} deg: {100 * share:.4g} %" for d, share in zip(SHARES_DEG, shares)),
        ),
    ])  # fmt: skip
