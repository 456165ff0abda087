"""`rotavg simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import rotavg
from rotavg.cli import options
from rotavg.cli.command import Command
from rotavg.cli.options import number
from rotavg.cli.output import beside_files, print_json, print_losses
from rotavg.cli.progress import working
from rotavg.io import atomic, check_writable
from rotavg.io.edges import write_edge_list
from rotavg.simulation.simulate import KINDS


@click.command(
    cls=Command,
    short_help="Write a measurement graph with known noise.",
    groups={
        "Output": ("output", "truth_path", "outliers_path", "as_json"),
        "Graph": ("n", "density", "drop", "loop_closures", "seed"),
        "Measurements": ("noise", "outliers", "outlier_clusters"),
    },
)
@click.argument("kind", type=click.Choice(KINDS))
@click.option(
    "-n",
    "--nodes",
    "n",
    type=click.IntRange(2),
    required=True,
    metavar="N",
    help="Number of nodes.",
)
@click.option(
    "-o",
    "--output",
    type=options.OUTPUT,
    required=True,
    help="A .g2o, .graph, .txt, .csv or .npz file.",
)
@click.option(
    "--truth",
    "truth_path",
    type=options.OUTPUT,
    help="Write the true rotations, for `rotavg compare`: a .csv, .txt, .npz, .g2o or .tum file.",
)
@click.option(
    "--outlier-edges",
    "outliers_path",
    type=options.OUTPUT,
    help="Write a CSV file: the ids of the edges that are outliers.",
)
@number("--noise", click.FloatRange(0), 0.0, "Standard deviation of the noise angle, radians.")
@number("--drop", click.FloatRange(0, 1), 0.0, "Fraction of edges to leave out.")
@number("--density", click.FloatRange(0, 1), 0.1, "Of erdos_renyi: probability of an edge.")
@number("--loop-closures", click.FloatRange(0, 1), 0.01, "Of band: fraction of random edges.")
@number("--outliers", click.FloatRange(0, 1), 0.0, "Fraction of edges with a random rotation.")
@number(
    "--outlier-clusters",
    click.IntRange(0),
    0,
    "Clusters of nodes that are mistaken for one another: coherent outliers; 0 for random ones.",
)
@number("--seed", click.IntRange(0), 0, "The same seed gives the same graph.")
@options.output_graph
@options.as_json
def simulate(
    kind: str,
    n: int,
    output: Path,
    truth_path: Path | None,
    outliers_path: Path | None,
    output_format: str | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Simulate a measurement graph with known noise and write it to a file.

    \b
    Examples:
      rotavg simulate sphere -n 2500 --noise 0.1 -o sphere.g2o
      rotavg simulate complete -n 200 --noise 0.5 --drop 0.3 --seed 7 -o graph.txt
      rotavg simulate band -n 500 --outliers 0.2 -o graph.txt --truth truth.csv
    """
    check_writable(output, output_format)
    if truth_path is not None:
        check_writable(truth_path, solution=True)
    if outliers_path is not None:
        atomic.check_writable(outliers_path)
    atomic.check_distinct([output, truth_path, outliers_path])
    with working(f"simulating {n} nodes"):
        simulation = rotavg.simulate(kind, n, **settings)
        rotavg.write(output, simulation.graph, format=output_format)
        if truth_path is not None:
            rotavg.write(truth_path, simulation.truth)
        if outliers_path is not None:
            write_edge_list(outliers_path, simulation.graph.edges[simulation.is_outlier])
    graph = simulation.graph
    if as_json:
        with beside_files(output, truth_path, outliers_path):
            print_json({
                "kind": kind, "nodes": graph.num_nodes, "edges": graph.num_edges,
                "outliers": int(simulation.is_outlier.sum()), "seed": settings["seed"],
                "output": str(output),
            })  # fmt: skip
    else:
        click.echo(f"wrote {output}: {graph.num_nodes} nodes, {graph.num_edges} edges", err=True)
        print_losses(output, graph, output_format)
        for path in (truth_path, outliers_path):
            if path is not None:
                click.echo(f"wrote {path}", err=True)
