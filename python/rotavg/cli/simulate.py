"""`rotavg simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import rotavg
from rotavg.cli import options
from rotavg.cli.options import number
from rotavg.cli.output import print_json, working
from rotavg.io import check_writable
from rotavg.simulate import KINDS


@click.command(short_help="Write a measurement graph with known noise.")
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
    type=options.PATH,
    required=True,
    help="A .g2o, .graph, .txt, .csv or .npz file.",
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
@options.as_json
def simulate(kind: str, n: int, output: Path, as_json: bool, **settings: Any) -> None:
    """Simulate a measurement graph with known noise and write it to a file.

    \b
    Examples:
      rotavg simulate sphere -n 2500 --noise 0.1 -o sphere.g2o
      rotavg simulate complete -n 200 --noise 0.5 --drop 0.3 --seed 7 -o graph.txt
    """
    check_writable(output)
    with working(f"simulating {n} nodes"):
        simulation = rotavg.simulate(kind, n, **settings)
        rotavg.write(output, simulation.graph)
    graph = simulation.graph
    if as_json:
        print_json({
            "kind": kind, "nodes": graph.num_nodes, "edges": graph.num_edges,
            "outliers": int(simulation.is_outlier.sum()), "seed": settings["seed"],
            "output": str(output),
        })  # fmt: skip
    else:
        click.echo(f"wrote {output}: {graph.num_nodes} nodes, {graph.num_edges} edges", err=True)
