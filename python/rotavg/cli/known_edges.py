"""What is known of edges beforehand, for `rotavg solve`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.cli import options
from rotavg.cli.options import choice, number
from rotavg.io.edges import read_edge_list
from rotavg.io.lines import integer
from rotavg.solving.known_edges import edge_mask, odometry

_OPTIONS = (
    number("--min-cycles", click.IntRange(1), 3, "Fewest cycles that --cycle-threshold goes by."),
    choice(
        "--weight-kind",
        ["auto", "precision", "frequency"],
        "auto",
        "What weights say to --loss: inverse variances (auto), or how often an edge was measured.",
    ),
    click.option(
        "--trusted",
        "trusted_path",
        type=options.PATH,
        help="Edges that --loss does not touch: I J on every line, or CSV with columns i, j "
        "and perhaps trusted (1 or 0).",
    ),
    click.option(
        "--trust-odometry",
        is_flag=True,
        help="Trust the edges between consecutive ids.",
    ),
    click.option(
        "--excluded",
        "excluded_path",
        type=options.PATH,
        help="Edges to leave out, likewise (column excluded).",
    ),
)


@dataclass(frozen=True)
class KnownEdges:
    """The options about what is known of edges, but for weights and cycles, by their names."""

    trusted_path: Path | None
    trust_odometry: bool
    excluded_path: Path | None

    @property
    def paths(self) -> tuple[Path | None, ...]:
        """The files that are read."""
        return self.trusted_path, self.excluded_path


def known_edge_options(command: Any) -> Any:
    """The options about what is known of edges."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def check_known_edges(loss: str, known: KnownEdges, weight_kind: str) -> None:
    """UsageError for options that have no effect without a robust loss."""
    given = {
        "--trusted": known.trusted_path is not None,
        "--trust-odometry": known.trust_odometry,
        "--weight-kind": weight_kind != "auto",
    }
    for name, is_given in given.items():
        if is_given and loss == "l2":
            raise click.UsageError(f"{name} is for --loss, which is not given or l2")


def read_known_edges(
    graph: rotavg.MeasurementGraph, known: KnownEdges
) -> dict[str, NDArray[np.bool_] | None]:
    """Masks (m,) as `rotavg.solve` takes them."""
    trusted, excluded = known.paths
    trust = None if trusted is None else _mask(graph, trusted, "trusted")
    leave_out = None if excluded is None else _mask(graph, excluded, "excluded")
    if known.trust_odometry:
        between = odometry(graph)
        if leave_out is not None:
            between &= ~leave_out
        trust = between if trust is None else trust | between
    return {"trusted": trust, "excluded": leave_out}


def _is_integer(text: str) -> bool:
    """Whether a field is the id of a node that is a number."""
    try:
        integer(text)
    except ValueError:
        return False
    return True


def _mask(graph: rotavg.MeasurementGraph, path: Path, column: str) -> NDArray[np.bool_]:
    pairs: list[tuple[Any, Any]] = list(read_edge_list(path, column))
    if graph.nodes.dtype.kind != "U":
        try:
            pairs = [(integer(i), integer(j)) for i, j in pairs]
        except ValueError:
            i, j = next(pair for pair in pairs if not all(map(_is_integer, pair)))
            found = f"found an edge between {i!r} and {j!r}, but the nodes of the graph are numbers"
            raise rotavg.FormatError(found, path=path) from None
    try:
        mask = edge_mask(graph, "it", pairs)
    except rotavg.GraphError as error:
        raise rotavg.FormatError(str(error), path=path) from None
    assert mask is not None
    return mask
