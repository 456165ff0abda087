"""Prior knowledge from files, for `rotavg solve`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

import rotavg
from rotavg.cli import options
from rotavg.graph.conventions import Convention
from rotavg.io import read_gravity, read_rigs, read_rotations
from rotavg.io.of_graph import ids_like, of_graph
from rotavg.io.pose_priors import priors_in
from rotavg.io.priors import fixed_of, priors_of_poses
from rotavg.io.rigs import rigs_of

_NODES = (
    click.option(
        "--fixed",
        "fixed_path",
        type=options.INPUT,
        help="Hold the rotations in this file or model, any that `rotavg compare` reads.",
    ),
    click.option(
        "--fixed-convention",
        type=click.Choice(["pose", "vision"]),
        help="Family of the rotations of --fixed, where text, csv or npz leave it open: pose "
        "(world_from_node) or vision (its transpose).  [default: pose]",
    ),
    click.option(
        "--gravity",
        "gravity_path",
        type=options.INPUT,
        help="Use gravity: NAME gx gy gz, down in the node's frame, in the world (0, 1, 0).",
    ),
    click.option(
        "--gravity-weight",
        type=click.FloatRange(1e-100, 1e100),
        metavar="X",
        help="Weight of gravity at each node, in units of edge weights.  "
        "[default: the edges' median]",
    ),
    click.option(
        "--rigs",
        "rigs_path",
        type=options.INPUT,
        help="Rigs: COLMAP's rig_config.json or database, or CSV of node,frame,sensor[,qw,qx,qy,qz]"
        " (rig_from_sensor); sensors without a rotation are estimated.  [default: the database's]",
    ),
    click.option("--no-rigs", is_flag=True, help="Leave the rigs of a COLMAP database aside."),
)
_HEADINGS = click.option(
    "--headings",
    is_flag=True,
    help="Hold gravity exactly and solve for headings only; --gravity must cover every node "
    "(with calibrated rigs, every frame).",
)
_NO_PRIORS = click.option(
    "--no-priors",
    is_flag=True,
    help="Leave the priors of poses in a JRL, PyFG or g2o file aside.",
)


@dataclass(frozen=True)
class KnownNodes:
    """The options about what is known of nodes, by their names."""

    fixed_path: Path | None = None
    fixed_convention: Convention | None = None
    gravity_path: Path | None = None
    gravity_weight: float | None = None
    rigs_path: Path | None = None
    no_rigs: bool = False

    @property
    def paths(self) -> tuple[Path | None, ...]:
        """The files that are read."""
        return self.fixed_path, self.gravity_path, self.rigs_path


def prior_options(command: Any) -> Any:
    """The options about what is known of nodes."""
    return known_node_options(_NO_PRIORS(_HEADINGS(command)))


def known_node_options(command: Any) -> Any:
    """Those of `KnownNodes`, which name the files."""
    for option in reversed(_NODES):
        command = option(command)
    return command


def check_prior_options(known: KnownNodes) -> None:
    """UsageError for what belongs to an option that is not given, or rigs that are not wanted."""
    if known.fixed_convention is not None and known.fixed_path is None:
        raise click.UsageError("--fixed-convention is for --fixed, which is not given")
    if known.rigs_path is not None and known.no_rigs:
        raise click.UsageError("--rigs and --no-rigs exclude each other")
    if known.gravity_weight is not None and known.gravity_path is None:
        raise click.UsageError("--gravity-weight is for --gravity, which is not given")


def read_priors(
    graph: rotavg.MeasurementGraph, known: KnownNodes, of_poses: rotavg.Priors | None = None
) -> rotavg.Priors | None:
    """The priors in these files, of the nodes that the graph has; None where nothing is known.

    Also those rotations that the graph's own file holds fixed, its rigs, and its priors of poses.
    What the files say of other nodes is skipped, counted and told on stderr.
    """
    of_poses = of_poses or rotavg.Priors()
    rotations = fixed_of(graph.source, graph)
    rigs = None if known.no_rigs else _rigs(graph, known.rigs_path)
    fixed, gravity, weight = known.fixed_path, known.gravity_path, known.gravity_weight
    here = bool(rotations or of_poses.absolute or of_poses.positions)
    if fixed is None and gravity is None and not here and rigs is None:
        return None
    if weight is None:
        weight = float(np.median(graph.weights))
    downs: dict[Any, Any] = {}
    if rotations:
        count = f"{len(rotations)} rotation{'s' * (len(rotations) != 1)}"
        click.echo(f"note: {count} held fixed, as the graph's file says", err=True)
    if fixed is not None:
        ids, matrices = read_rotations(fixed, convention=known.fixed_convention)
        rotations = {**rotations, **_told(of_graph(fixed, ids, matrices, graph))}
    if gravity is not None:
        names, vectors = read_gravity(gravity)
        downs = _told(of_graph(gravity, ids_like(graph, names), vectors, graph))
    return rotavg.Priors(
        fixed=rotations,
        absolute={k: known for k, known in of_poses.absolute.items() if k not in rotations},
        positions=of_poses.positions,
        gravity={node: (down, weight) for node, down in downs.items()},
        rigs={} if rigs is None else rigs,
    )


def priors_of_file(graph: rotavg.MeasurementGraph, *, unit_weights: bool) -> rotavg.Priors | None:
    """The priors of poses in the graph's own file, told on stderr; None without such."""
    found = priors_in(graph.source)
    if found is None:
        return None
    priors = priors_of_poses(found, graph, unit_weights=unit_weights)
    what = [
        f"{len(known)} {name}{'s' * (len(known) != 1)}{use}"
        for name, known, use in (
            ("rotation", priors.absolute, ""),
            ("position", priors.positions, " (which count with --refine-poses)"),
        )
        if known
    ]
    if what:
        told = f"priors of {' and '.join(what)}, as the graph's file says (--no-priors)"
        click.echo(f"note: {told}", err=True)
    return priors


def with_doubts(
    graph: rotavg.MeasurementGraph, priors: rotavg.Priors, *, told: bool
) -> rotavg.MeasurementGraph:
    """The graph with notes of what contradicts it as if it was read wrongly; `told` on stderr."""
    found = [doubt for doubt in rotavg.doubts(graph, priors) if doubt not in graph.notes]
    for doubt in found if told else ():
        click.echo(f"note: {doubt}", err=True)
    return graph.with_notes(*found)


def _rigs(graph: rotavg.MeasurementGraph, path: Path | None) -> rotavg.Rigs | None:
    if path is not None:
        return read_rigs(path, graph)
    found = rigs_of(graph)
    if found is not None:
        frames = len({frame for frame, _ in found.images.values()})
        click.echo(f"note: rigs of {frames} frames, as the database says (--no-rigs)", err=True)
    return found


def _told(found: tuple[dict[Any, Any], str]) -> dict[Any, Any]:
    """What a file says of the nodes, its note told on stderr."""
    if found[1]:
        click.echo(f"note: {found[1]}", err=True)
    return found[0]
