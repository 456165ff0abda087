"""`rotavg convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import rotavg
from rotavg.cli import options
from rotavg.cli.command import Command
from rotavg.cli.output import beside_files, print_json, print_losses, print_notes
from rotavg.cli.progress import working
from rotavg.cli.reading import read_graph, reading_options
from rotavg.io import atomic, check_writable, losses
from rotavg.io.formats import num_nodes_written, warned_losses
from rotavg.io.g2o_write import with_weights_to_write


@click.command(
    cls=Command,
    short_help="Write a measurement graph in another format.",
    groups=options.groups_of(Output=("output_format", "as_json")),
)
@click.argument("input_path", metavar="IN", type=options.INPUT)
@click.argument("output_path", metavar="OUT", type=options.OUTPUT)
@reading_options
@options.output_graph
@options.as_json
def convert(
    input_path: Path,
    output_path: Path,
    output_format: str | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Write the measurement graph in IN in the format that OUT's name tells.

    \b
    Examples:
      rotavg convert graph.g2o graph.csv
      rotavg convert database.db relpose.txt
      rotavg convert pairs.txt graph.g2o --convention vision
    """
    atomic.check_distinct([output_path], [input_path, reading["nodes_path"]])
    check_writable(output_path, output_format)
    with working(f"reading {input_path}"):
        graph = read_graph(input_path, **reading)
    if reading["unit_weights"]:
        graph = with_weights_to_write(graph)
    rotavg.write(output_path, graph, format=output_format)
    written = num_nodes_written(output_path, graph, output_format)
    if as_json:
        told = [function(output_path, graph, output_format) for function in (losses, warned_losses)]
        with beside_files(output_path):
            print_json({
                "nodes": written, "edges": graph.num_edges, "output": str(output_path),
                "notes": [*graph.notes, *told[0], *told[1]],
            })  # fmt: skip
    else:
        print_notes(graph)
        click.echo(f"wrote {output_path}: {written} nodes, {graph.num_edges} edges", err=True)
        print_losses(output_path, graph, output_format)
