"""How the commands read a measurement graph: from a file, all of it or a part."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

import rotavg
from rotavg.cli import options
from rotavg.graph.ids import rows_of
from rotavg.io.node_list import read_node_list
from rotavg.io.streams import STDIN

_OPTIONS = (
    options.input_format,
    options.columns,
    options.convention,
    options.unit_weights,
    click.option(
        "--skip-self-edges",
        is_flag=True,
        help="Leave out edges from a node to itself, instead of refusing them.",
    ),
    click.option(
        "--pair-covariances",
        "covariances",
        is_flag=True,
        help="Estimate covariances from the inliers of a COLMAP database's pairs (pycolmap).",
    ),
    click.option(
        "--nodes",
        "nodes_path",
        type=options.INPUT,
        metavar="FILE",
        help="Use only the nodes in this file, an id or a name on each line.",
    ),
    click.option(
        "--largest-component", is_flag=True, help="Use only the component with the most nodes."
    ),
    click.option(
        "--min-nodes",
        type=click.IntRange(1),
        metavar="N",
        help="Leave out components with fewer nodes.",
    ),
)
NAMES = (
    *("format", "columns", "convention", "unit_weights", "skip_self_edges", "covariances"),
    *("nodes_path", "largest_component", "min_nodes"),
)


def reading_options(command: Any) -> Any:
    """The options of `read_graph`, of the names in `NAMES`."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def read_graph(
    path: Path,
    *,
    nodes_path: Path | None,
    largest_component: bool,
    min_nodes: int | None,
    **reading: Any,
) -> rotavg.MeasurementGraph:
    """The graph in a file, or the part of it that is asked for.

    Its notes tell also what was left out, what other reading the cycles suggest, and where
    covariances contradict them.
    """
    graph = rotavg.read(path, **reading)
    hint = _hint(path, graph, reading)
    whole = graph
    if nodes_path is not None:
        graph = _of_nodes(graph, nodes_path)
    if largest_component:
        graph = graph.largest_component()
    if min_nodes is not None:
        graph = graph.without_small_components(min_nodes)
    if graph.num_nodes < whole.num_nodes:
        count = whole.num_nodes - graph.num_nodes
        edges = whole.num_edges - graph.num_edges
        some = "1 edge" if edges == 1 else f"{edges} edges"
        graph = graph.with_notes(
            f"{count} of {whole.num_nodes} nodes and {some} left out, as was asked for"
        )
    return graph.with_notes(*hint, *rotavg.doubts(graph))


def _of_nodes(graph: rotavg.MeasurementGraph, path: Path) -> rotavg.MeasurementGraph:
    """The graph of the nodes in this file; of others in it the number is told."""
    ids = read_node_list(path)
    if graph.nodes.dtype.kind == "U":
        ids = ids.astype(np.str_)
    elif ids.dtype.kind == "U":
        found = next((n for n in ids.tolist() if not n.lstrip("-").isdecimal()), ids[0].item())
        message = f"found the node {found!r}, but the nodes of the graph are numbers"
        raise rotavg.FormatError(message, path=path)
    rows = rows_of(ids, graph.nodes)
    here = np.sort(rows[rows >= 0])
    if not len(here):
        node = graph.nodes[0].item()
        message = f"none of its nodes is in the graph, expected ids as in the graph (say, {node!r})"
        raise rotavg.FormatError(message, path=path)
    part = graph.subgraph(graph.nodes[here])
    missing = len(ids) - len(here)
    if missing:
        part = part.with_notes(f"{path}: {missing} of {len(ids)} nodes are not in the graph")
    return part


def _hint(path: Path, graph: rotavg.MeasurementGraph, reading: dict[str, Any]) -> tuple[str, ...]:
    """In what other way the file should be read, where its cycles say so and the format is open."""
    if path == STDIN or not (path.is_file() or path.is_dir()):  # a pipe can be read but once
        return ()
    told = {name: reading[name] for name in ("format", "convention", "columns")}
    found = rotavg.suggest_reading(path, graph=graph, **told)
    if found is None:
        return ()
    ways = [f"--{k} {value}" for k, value in found.options.items() if value != reading[k]]
    return (f"{found.finding} with {' '.join(ways)}",)
