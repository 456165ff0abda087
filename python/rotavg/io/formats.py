"""The list of known formats, and the front door to them: `read` and `write`."""

from __future__ import annotations

import os
from pathlib import Path

from rotavg.errors import FormatError
from rotavg.graph import MeasurementGraph
from rotavg.io import atomic, g2o, npz, registry, text
from rotavg.io.registry import Format, SolutionLike, Writable

# In the order in which they are asked whether they recognise a content: the vaguest come last.
FORMATS: tuple[Format, ...] = (npz.NPZ, g2o.G2O, text.CSV, text.TEXT)


def read(
    path: str | os.PathLike[str], *, format: str | None = None, unit_weights: bool = False
) -> MeasurementGraph:
    """Read a measurement graph.

    Args:
        path: the file; its format is told by its content or, failing that, by its name.
        format: "g2o", "text", "csv" or "npz", to leave nothing to be told.
        unit_weights: weigh every edge 1 and ignore what the file says about weights.

    Returns:
        The graph (pose family). Its `notes` tell what was skipped or mended on the way, its
        `source` lets `write` put back what a graph has no place for.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it holds no measurement graph; the message names the line and the reason.
    """
    path = Path(path)
    chosen = None if format is None else registry.named(FORMATS, format)
    data = registry.read_bytes(path)
    if chosen is None:
        chosen = registry.of_content(FORMATS, path, data)
    return chosen.read(path, data, unit_weights)


def write(
    path: str | os.PathLike[str], graph_or_solution: Writable, *, format: str | None = None
) -> None:
    """Write a measurement graph, or a solution, to a file, replacing one that is there.

    The new content appears all at once or not at all. Where a graph was read from a g2o file and
    is written as g2o, everything but the new rotations stays as it was.

    Args:
        path: the file; its name tells the format ("out.g2o", "out.txt", "out.csv", "out.npz").
        graph_or_solution: a MeasurementGraph or a Solution.
        format: "g2o", "text", "csv" or "npz", whatever the name.

    Raises:
        FileAccessError: the file cannot be written; what was there before is untouched.
        FormatError: unknown format, or one that cannot hold this (say, names as ids in g2o).
    """
    if not isinstance(graph_or_solution, (MeasurementGraph, SolutionLike)):
        found = type(graph_or_solution).__name__
        raise FormatError(f"found a {found} to write, expected a MeasurementGraph or a Solution")
    path = Path(path)
    if format is None:
        chosen = registry.by_suffix(FORMATS, path)
    else:
        chosen = registry.named(FORMATS, format)
    atomic.write_bytes(path, chosen.write(path, graph_or_solution))


def check_writable(path: str | os.PathLike[str], sample: Writable | None = None) -> None:
    """Raise what `write` would raise for this path, as far as it can be told before the work.

    With a `sample` of what will be written also whether the format can hold it.
    """
    chosen = registry.by_suffix(FORMATS, Path(path))
    atomic.check_writable(Path(path))
    if sample is not None:
        chosen.write(Path(path), sample)
