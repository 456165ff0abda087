"""`rotavg convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click
import numpy as np

import rotavg
from rotavg.cli import options
from rotavg.cli.output import print_json, print_losses, print_notes, working
from rotavg.io import check_writable, losses


@click.command(short_help="Write a measurement graph in another format.")
@click.argument("input_path", metavar="IN", type=options.PATH)
@click.argument("output_path", metavar="OUT", type=options.PATH)
@options.input_format
@options.output_graph
@options.convention
@options.unit_weights
@options.as_json
def convert(
    input_path: Path,
    output_path: Path,
    format: str | None,
    output_format: str | None,
    convention: Literal["pose", "vision"] | None,
    unit_weights: bool,
    as_json: bool,
) -> None:
    """Write the measurement graph in IN in the format that OUT's name tells.

    \b
    Examples:
      rotavg convert graph.g2o graph.csv
      rotavg convert database.db relpose.txt
      rotavg convert pairs.txt graph.g2o --convention vision
    """
    check_writable(output_path, output_format)
    with working(f"reading {input_path}"):
        graph = rotavg.read(input_path, format=format, convention=convention)
    if unit_weights:
        graph = graph.with_weights(np.ones(graph.num_edges))
    rotavg.write(output_path, graph, format=output_format)
    if as_json:
        print_json({
            "nodes": graph.num_nodes, "edges": graph.num_edges, "output": str(output_path),
            "notes": [*graph.notes, *losses(output_path, graph, output_format)],
        })  # fmt: skip
    else:
        print_notes(graph)
        click.echo(
            f"wrote {output_path}: {graph.num_nodes} nodes, {graph.num_edges} edges", err=True
        )
        print_losses(output_path, graph, output_format)
