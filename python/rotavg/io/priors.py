"""What the file of a graph knows beforehand of its nodes, as `rotavg.solve` takes it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from rotavg.base.errors import FormatError, OptionError, expect
from rotavg.graph.ids import rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_database import COLMAP_DATABASE
from rotavg.io.colmap_priors import read_rigs_of
from rotavg.io.gravity import read_gravity
from rotavg.io.irotavg import IROTAVG, FixedRotations, read_irotavg
from rotavg.io.registry import HEAD_SIZE, ReadOptions, read_bytes
from rotavg.io.rigs import joining_frames
from rotavg.priors.priors import Priors


def read_priors(
    path: str | os.PathLike[str],
    graph: MeasurementGraph,
    *,
    gravity: bool = False,
    gravity_weight: float | None = None,
) -> Priors:
    """Read what a file of measurements knows of the nodes beside them.

    That is what the command `rotavg solve` uses by itself, and `rotavg.solve` where it is given:
    `rotavg.solve(graph, priors=rotavg.read_priors(path, graph))`.

    Args:
        path: a COLMAP database, for its rigs; or the text of iRotAvg, for the rotations that it
            holds fixed.
        graph: the measurements; what the file says of other nodes is left out.
        gravity: whether to take the gravity in a database's `pose_priors`, too.
        gravity_weight: its weight at each node; None for the median weight of the edges.

    Returns:
        Priors; with nothing in them where the file knows nothing of these nodes.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it is in a format without prior knowledge, or has no gravity of these nodes.
        OptionError: a weight of gravity, and none is asked for.
    """
    path = Path(path)
    expect(graph, MeasurementGraph)
    if gravity_weight is not None and not gravity:
        raise OptionError("gravity_weight is given; expected gravity=True with it")
    data = read_bytes((COLMAP_DATABASE,), path)
    if COLMAP_DATABASE.recognises(data):
        return Priors(
            gravity=read_gravity(path, graph, weight=gravity_weight) if gravity else {},
            rigs=joining_frames(read_rigs_of(path), graph) or {},
        )
    if not (IROTAVG.is_name(path) or IROTAVG.recognises(data[:HEAD_SIZE])):
        expected = "expected a COLMAP database or the text of iRotAvg"
        raise FormatError(f"found a format without prior knowledge, {expected}", path=path)
    if gravity:
        raise FormatError("iRotAvg's text has no gravity, expected a COLMAP database", path=path)
    source = read_irotavg(path, data, ReadOptions(True, IROTAVG.convention, True)).source
    return Priors(fixed=fixed_of(source, graph))


def fixed_of(source: Any, graph: MeasurementGraph) -> dict[Any, Any]:
    """Rotations (3, 3) of the nodes that the source of a graph holds fixed; none of others."""
    if not isinstance(source, FixedRotations):
        return {}
    here = rows_of(source.nodes, graph.nodes) >= 0
    return dict(zip(source.nodes[here].tolist(), source.rotations[here]))
