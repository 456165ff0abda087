"""`rotavg compare`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Callable

import click
import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.cli import options
from rotavg.cli.command import Command
from rotavg.cli.output import print_json, print_table
from rotavg.evaluation.compare import SHARES_DEG
from rotavg.evaluation.paired import is_clearly_better
from rotavg.graph.conventions import Convention
from rotavg.graph.ids import IdArray, rows_of
from rotavg.io.absolute import AbsoluteRotations
from rotavg.io.rotations import FORMATS_OF_ROTATIONS, read_absolute


def _format(name: str, of: str) -> Callable[[Any], Any]:
    formats = [form.name for form in FORMATS_OF_ROTATIONS]
    return click.option(
        name, type=click.Choice(formats), help=f"Format of {of}, if it does not tell."
    )


def _convention(name: str, of: str) -> Callable[[Any], Any]:
    text = f"Family of {of}: pose (world_from_node, the default) or vision (its transpose)."
    return click.option(name, type=click.Choice(["pose", "vision"]), help=text)


def _columns(name: str, of: str) -> Callable[[Any], Any]:
    text = f"What the columns of {of} are, if it is text or CSV without a header: id,qw,qx,qy,qz."
    return click.option(name, metavar="WORDS", help=text)


@click.command(
    cls=Command,
    short_help="Tell how far rotations are from a reference.",
    groups={
        "SOLUTION": ("format", "convention", "columns"),
        "REFERENCE": ("reference_format", "reference_convention", "reference_columns"),
        "Nodes": ("graph_path", "image_ids"),
        "Output": ("as_json",),
    },
)
@click.argument("solution_path", metavar="SOLUTION", type=options.INPUT)
@click.argument("reference_path", metavar="REFERENCE", type=options.INPUT)
@_format("--format", "SOLUTION")
@_convention("--convention", "SOLUTION")
@_format("--reference-format", "REFERENCE")
@_convention("--reference-convention", "REFERENCE")
@_columns("--columns", "SOLUTION")
@_columns("--reference-columns", "REFERENCE")
@click.option(
    "--graph",
    "graph_path",
    type=options.INPUT,
    metavar="FILE",
    help="The graph that was solved: each of its components is aligned by itself. "
    "(A solution in npz tells them.)",
)
@click.option(
    "--image-ids",
    is_flag=True,
    help="Of COLMAP's models take IMAGE_ID for ids of nodes, not NAME.",
)
@options.as_json
def compare(
    solution_path: Path,
    reference_path: Path,
    format: str | None,
    convention: Convention | None,
    reference_format: str | None,
    reference_convention: Convention | None,
    columns: str | None,
    reference_columns: str | None,
    graph_path: Path | None,
    image_ids: bool,
    as_json: bool,
) -> None:
    """Tell how far the rotations in SOLUTION are from those in REFERENCE.

    Both are solutions in any format that holds rotations: text, csv, npz (or ground truth in one),
    vertices of g2o and TORO, TUM, COLMAP's models (the folder, images.txt or images.bin), GLOMAP's
    and iRotAvg's rotations. They are
    compared at the nodes that both have, after the common rotation that leaves the least sum of
    angles. A node alone in its component could be turned to meet any reference and is left out.

    \b
    Examples:
      rotavg compare solved.txt truth.txt
      rotavg compare solved.txt sparse/0 --graph graph.txt
    """
    solution = read_absolute(solution_path, format=format, convention=convention, columns=columns)
    reference = read_absolute(
        reference_path,
        format=reference_format,
        convention=reference_convention,
        columns=reference_columns,
    )
    for path, found in ((solution_path, solution), (reference_path, reference)):
        for note in found.notes:
            click.echo(f"note: {path}: {note}", err=True)
    if image_ids:
        if solution.image_ids is None and reference.image_ids is None:
            raise rotavg.FormatError("--image-ids: neither is a model of COLMAP's")
        solution, reference = _by_image_ids(solution), _by_image_ids(reference)
    if not (rows_of(solution.nodes, reference.nodes) >= 0).any():
        example = f"{solution.nodes[0].item()!r} there, {reference.nodes[0].item()!r} here"
        raise rotavg.FormatError(
            f"no node of {solution_path} is in it (say, {example}), expected common ids",
            path=reference_path,
        )
    if graph_path is not None:
        label = _components(graph_path, solution.nodes, solution_path)
        solution = dataclasses.replace(solution, component=label)
    result = rotavg.compare(solution, reference)
    notes = _other_family(result, solution, reference)
    degrees = np.degrees([result.median, result.mean, result.rms, result.angles.max()])
    shares = [result.share_below(float(np.radians(d))) for d in SHARES_DEG]
    only = result.only_in_rotations, result.only_in_reference
    if as_json:
        print_json({
            "nodes": len(result.angles),
            "components": result.num_components,
            "left_out": result.left_out,
            "only_in_solution": only[0],
            "only_in_reference": only[1],
            **dict(zip(("median_deg", "mean_deg", "rms_deg", "max_deg"), degrees.tolist())),
            **{f"share_below_{d}_deg": share for d, share in zip(SHARES_DEG, shares)},
            "notes": notes,
        })  # fmt: skip
        return
    for note in notes:
        click.echo(f"note: {note}", err=True)
    aligned = "1 component"
    if result.num_components > 1:
        aligned = f"{result.num_components} components, each by itself"
    if result.left_out:
        aligned += f"; left out {result.left_out} alone in a component"
    print_table([
        (
            "nodes",
            f"{len(result.angles)} compared, {only[0]} in the solution only, "
            f"{only[1]} in the reference only",
        ),
        ("aligned", aligned),
        (
            "error",
            "median {:.4g} deg, mean {:.4g}, RMS {:.4g}, largest {:.4g}".format(*degrees),
        ),
        (
            "below",
            ", ".join(f"{d} deg: {100 * share:.4g} %" for d, share in zip(SHARES_DEG, shares)),
        ),
    ])  # fmt: skip


def _other_family(
    result: rotavg.Comparison, solution: AbsoluteRotations, reference: AbsoluteRotations
) -> list[str]:
    """Whether one of the two is in the other family: then its inverses are much nearer."""
    inverse = np.swapaxes(reference.rotations, 1, 2)
    other = rotavg.compare(solution, dataclasses.replace(reference, rotations=inverse))
    if not is_clearly_better(result.angles, other.angles):
        return []
    after, before = np.degrees([other.median, result.median]).round(4)
    return [
        f"with the inverses of the reference's rotations the median is {after:.3g} deg, not "
        f"{before:.3g}: is one of the two in the other family (--convention, "
        "--reference-convention)?"
    ]


def _components(path: Path, nodes: IdArray, solution_path: Path) -> NDArray[Any]:
    """Labels (n,) of these nodes in the graph of this file."""
    graph = rotavg.read(path)
    rows = rows_of(nodes, graph.nodes)
    if (rows < 0).any():
        node = nodes[int(np.argmin(rows))].item()
        found = f"node {node!r} of {solution_path} is not in it"
        raise rotavg.FormatError(f"{found}, expected the graph that was solved", path=path)
    return graph.components()[rows]


def _by_image_ids(found: AbsoluteRotations) -> AbsoluteRotations:
    ids = found.nodes if found.image_ids is None else found.image_ids
    return dataclasses.replace(found, nodes=ids)
