"""What the file of a graph knows beforehand of its nodes, as `rotavg.solve` takes it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from rotavg.base.errors import FormatError, OptionError, expect
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_database import COLMAP_DATABASE
from rotavg.io.colmap_priors import read_rigs_of
from rotavg.io.g2o import G2O
from rotavg.io.gravity import read_gravity
from rotavg.io.irotavg import IROTAVG, FixedRotations
from rotavg.io.jrl import JRL
from rotavg.io.pose_priors import PosePrior, PriorsOfFile, priors_in, priors_of
from rotavg.io.pyfg import PYFG
from rotavg.io.registry import ReadOptions, of_content, read_bytes
from rotavg.io.rigs import joining_frames
from rotavg.priors.priors import Priors

_FORMATS = (COLMAP_DATABASE, JRL, PYFG, G2O, IROTAVG)


def read_priors(
    path: str | os.PathLike[str],
    graph: MeasurementGraph,
    *,
    gravity: bool = False,
    gravity_weight: float | None = None,
    unit_weights: bool = False,
) -> Priors:
    """Read what a file of measurements knows of the nodes beside them.

    That is what the command `rotavg solve` uses by itself, and `rotavg.solve` where it is given:
    `rotavg.solve(graph, priors=rotavg.read_priors(path, graph))`.

    Args:
        path: a COLMAP database, for its rigs; the text of iRotAvg, for the rotations that it
            holds fixed; or a pose graph in JRL, PyFG or g2o, for its priors of poses, rotations and
            positions. Their information becomes weights as that of edges does.
        graph: the measurements; what the file says of other nodes is left out.
        gravity: whether to take the gravity in a database's `pose_priors`, too.
        gravity_weight: its weight at each node; None for the median weight of the edges.
        unit_weights: weigh every prior of a rotation 1, as `read` does the edges.

    Returns:
        Priors; with nothing in them where the file knows nothing of these nodes.

    Raises:
        FileAccessError: the file cannot be read.
        FormatError: it is in a format without prior knowledge, or has no gravity of these nodes; or
            it names the line of a prior that is malformed, or is a second one of a node with
            another rotation.
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
    try:
        form = of_content(_FORMATS, path, data)
    except FormatError:
        expected = "expected a COLMAP database, the text of iRotAvg, JRL, PyFG or g2o"
        raise FormatError(
            f"found a format without prior knowledge, {expected}", path=path
        ) from None
    if gravity:
        raise FormatError(f"{form.name} has no gravity, expected a COLMAP database", path=path)
    assert form.read is not None
    source = form.read(path, data, ReadOptions(True, form.convention, True)).source
    of_poses = priors_in(source)
    if of_poses is not None:
        return priors_of_poses(of_poses, graph, unit_weights=unit_weights)
    return Priors(fixed=fixed_of(source, graph))


def priors_of_poses(
    found: PriorsOfFile, graph: MeasurementGraph, *, unit_weights: bool = False
) -> Priors:
    """What the priors in a pose graph's file say of the nodes of a graph; see `read_priors`."""
    told = found.parse(found.path, found.entries)
    here = rows_of(as_ids([prior.node for prior in told], "prior"), graph.nodes) >= 0

    def error(prior: PosePrior, reason: str) -> FormatError:
        what = prior.place if prior.line is None else "the prior"
        return FormatError(f"{what} {reason}", path=found.path, line=prior.line)

    return priors_of(
        (prior for prior, used in zip(told, here) if used), error, unit_weights=unit_weights
    )


def fixed_of(source: Any, graph: MeasurementGraph) -> dict[Any, Any]:
    """Rotations (3, 3) of the nodes that the source of a graph holds fixed; none of others."""
    if not isinstance(source, FixedRotations):
        return {}
    here = rows_of(source.nodes, graph.nodes) >= 0
    return dict(zip(source.nodes[here].tolist(), source.rotations[here]))
