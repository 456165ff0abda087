"""What is known of edges beforehand, for `rotavg solve`."""

from __future__ import annotations

from collections.abc import Sequence
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
from rotavg.io.registry import blame_line
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
        type=options.INPUT,
        help="Edges that --loss and --pose-loss do not touch: I J on every line, or CSV with "
        "columns i, j and perhaps trusted (1 or 0).",
    ),
    click.option(
        "--trust-odometry",
        is_flag=True,
        help="Trust the edges between consecutive ids.",
    ),
    click.option(
        "--no-odometry",
        is_flag=True,
        help="Count edges between consecutive ids like all others; by default --loss auto gives "
        "up one of a trajectory as little as six others.",
    ),
    click.option(
        "--excluded",
        "excluded_path",
        type=options.INPUT,
        help="Edges to leave out, likewise (column excluded).",
    ),
)


@dataclass(frozen=True)
class KnownEdges:
    """The options about what is known of edges, but for weights and cycles, by their names."""

    trusted_path: Path | None
    trust_odometry: bool
    excluded_path: Path | None
    no_odometry: bool = False

    @property
    def paths(self) -> tuple[Path | None, ...]:
        """The files that are read."""
        return self.trusted_path, self.excluded_path


def known_edge_options(command: Any) -> Any:
    """The options about what is known of edges."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def check_known_edges(loss: str, pose_loss: str, known: KnownEdges, weight_kind: str) -> None:
    """UsageError for options that have no effect without a robust loss."""
    if loss == "l2" and weight_kind != "auto":
        raise click.UsageError("--weight-kind is for --loss, which is not given or l2")
    if known.trust_odometry and known.no_odometry:
        raise click.UsageError("--trust-odometry and --no-odometry contradict each other")
    if loss == "l2" and known.no_odometry:
        raise click.UsageError("--no-odometry is for --loss, which is not given or l2")
    given = {"--trusted": known.trusted_path is not None, "--trust-odometry": known.trust_odometry}
    for name, is_given in given.items():
        if is_given and loss == pose_loss == "l2":
            raise click.UsageError(
                f"{name} is for --loss or --pose-loss, which are not given or l2"
            )


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
    if known.no_odometry and trust is None:
        trust = np.zeros(graph.num_edges, dtype=np.bool_)
    return {"trusted": trust, "excluded": leave_out}


def numbered_pairs(path: Path, column: str) -> set[tuple[int, int]]:
    """Of nodes that are numbers, the smaller one first.

    Raises FormatError where the file holds anything else.
    """
    named, lines = read_edge_list(path, column)
    return {(min(i, j), max(i, j)) for i, j in _numbers(path, named, lines)}


def _numbers(
    path: Path, named: Sequence[tuple[str, str]], lines: Sequence[int]
) -> list[tuple[int, int]]:
    pairs = []
    for row, (i, j) in enumerate(named):
        try:
            pairs.append((integer(i), integer(j)))
        except ValueError:
            found = f"found an edge between {i!r} and {j!r}"
            expected = "but the nodes of the graph are numbers"
            raise rotavg.FormatError(f"{found}, {expected}", path=path, line=lines[row]) from None
    return pairs


def _mask(graph: rotavg.MeasurementGraph, path: Path, column: str) -> NDArray[np.bool_]:
    named, lines = read_edge_list(path, column)
    pairs: list[tuple[Any, Any]] = [*named]
    if graph.nodes.dtype.kind != "U":
        pairs = _numbers(path, named, lines)
    with blame_line(path, lines):
        mask = edge_mask(graph, "it", pairs)
    assert mask is not None
    return mask
