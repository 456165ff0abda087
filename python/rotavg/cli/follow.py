"""`rotavg solve --follow`: edges as they come, and how things stand after each."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Callable, TypeVar

import click
import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.cli.followed import Followed
from rotavg.cli.known_edges import numbered_pairs
from rotavg.cli.options import typed
from rotavg.cli.output import beside_files, print_text
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.io import check_writable
from rotavg.io.g2o_stream import EdgeLine, edge_lines
from rotavg.io.streams import open_input

F = TypeVar("F", bound=Callable[..., Any])

# The options of `rotavg solve` that it has a use for.
KNOWN = {"input_path", "follow", "as_json", "unit_weights", "certificate_tolerance"}
KNOWN |= {"tolerance", "loss", "loss_scale", "output", "output_format"}
KNOWN |= {"trusted_path", "trust_odometry"}  # odometry is trusted, unless others are named


def follow_option(command: F) -> F:
    """The option that says so."""
    option = click.option(
        "--follow",
        is_flag=True,
        help="Read the lines of a g2o file as they come (INPUT - is standard input), and print one "
        "line of JSON after every edge: the optimum so far, and whether it is proved. With it "
        "--tolerance is a part of the objective (1e-10 if none is given): what is proved to gain "
        "less waits. Edges between consecutive ids are trusted, or with --trusted those that it "
        "names (with --trust-odometry both). -o writes the last solution at the end, also after "
        "Ctrl-C.",
    )
    return option(command)


def check_follow_options() -> None:
    """Refuse, by name, what has no use here."""
    for name, option in typed().items():
        if name not in KNOWN:
            raise click.UsageError(f"{option} is not possible with --follow")


def follow_input(input_path: Path, settings: dict[str, Any], loss_scale: float | None) -> int:
    """Read, solve and print, edge by edge; the exit status.

    The output has the last solution, also where a line is wrong or the user interrupts.

    Raises FormatError for the first line that is wrong; what was printed before it stands.
    """
    output, form = settings["output"], settings["output_format"]
    if form is not None and output is None:
        raise click.UsageError("--output-format is for --output, which is not given")
    if output is not None:
        check_writable(output, form, solution=True, source=input_path)
    loss = settings["loss"]
    if loss == "auto":
        raise click.UsageError("--loss auto is not possible with --follow: name a loss")
    if loss != "l2" and loss_scale is None:
        raise click.UsageError("--follow needs a --loss-scale with --loss, in degrees")
    if loss == "l2" and settings["trusted_path"] is not None:
        raise click.UsageError("--trusted is for --loss, which is not given or l2")
    if loss == "l2" and settings["trust_odometry"]:
        raise click.UsageError("--trust-odometry is for --loss, which is not given or l2")
    trust = _Trust(settings["trusted_path"], settings["trust_odometry"])
    tolerance = {"tolerance": settings["tolerance"]} if "tolerance" in typed() else {}
    online = rotavg.Online(
        **tolerance,
        certificate_tolerance=settings["certificate_tolerance"],
        loss=loss,
        loss_scale=loss_scale,
    )
    followed = None if output is None else Followed(input_path, settings["unit_weights"])
    try:
        with open_input(input_path) as file, beside_files(output):
            _follow(online, input_path, file, settings["unit_weights"], trust, followed)
    except OSError as error:
        if isinstance(error, rotavg.Error):
            raise
        reason = error.strerror or str(error)
        raise rotavg.FileAccessError(f"cannot be read: {reason}", path=input_path) from error
    finally:
        if followed is not None and online.num_nodes > 0:
            rotavg.write(output, followed.solution(online), format=form)
            click.echo(f"wrote {output}", err=True)
        trust.tell_unseen()
    if online.num_nodes == 0:
        raise rotavg.FormatError("there are no edges", path=input_path)
    return 0 if online.verdict == rotavg.Verdict.PROVED else 1


class _Trust:
    """Which edges a robust loss leaves alone: those of a file, or between consecutive ids."""

    def __init__(self, path: Path | None, odometry: bool) -> None:
        self._odometry = odometry
        self._pairs = None if path is None else numbered_pairs(path, "trusted")
        self._unseen = set(self._pairs or ())

    def __call__(self, edge: EdgeLine) -> NDArray[np.bool_] | None:
        """(1,), or None: as `Online.add` has it."""
        if self._pairs is None:
            return None
        i, j = edge.ids[0].tolist()
        named = (min(i, j), max(i, j)) in self._pairs
        self._unseen.discard((min(i, j), max(i, j)))
        return np.array([named or (self._odometry and abs(i - j) == 1)])

    def tell_unseen(self) -> None:
        """Say which of the named edges have not come."""
        if self._unseen:
            i, j = min(self._unseen)
            some = f"{len(self._unseen)} of the trusted edges did not come, as {i} -> {j}"
            click.echo(some, err=True)


def _follow(
    online: rotavg.Online,
    path: Path,
    file: BinaryIO,
    unit_weights: bool,
    trust: _Trust,
    followed: Followed | None,
) -> None:
    lines: Iterator[bytes] = iter(file.readline, b"")
    if followed is not None:
        lines = followed.remembered(lines)
    for step, edge in enumerate(edge_lines(path, lines, unit_weights), start=1):
        began = time.perf_counter()
        try:
            if followed is not None:
                followed.check(edge)
            online.add(edge.ids, edge.rotations, edge.weights, trusted=trust(edge))
        except rotavg.GraphError as error:
            raise rotavg.FormatError(str(error), path=path, line=edge.line) from None
        if followed is not None:
            followed.add(edge)
        seconds = time.perf_counter() - began
        print_text(json.dumps(_state(online, step, edge, seconds)))


def _state(online: rotavg.Online, step: int, edge: EdgeLine, seconds: float) -> dict[str, Any]:
    state = online.state
    newest = int(edge.ids.max())
    return {
        "step": step,
        "line": edge.line,
        "rotation": {
            "node": newest,
            "xyzw": quaternions_from_matrices(online[newest]).tolist(),
        },
        "nodes": state.num_nodes,
        "edges": state.num_edges,
        "components": state.num_components,
        "outliers": state.num_outliers,
        "objective": state.objective,
        "certificate": {
            "verdict": state.verdict,
            "gap": state.gap,
            "relative_gap": state.relative_gap,
        },
        "iterations": state.iterations,
        "second_opinions": state.num_second_opinions,
        "seconds": seconds,
    }
