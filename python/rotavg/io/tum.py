"""TUM trajectories, for evo and other evaluations: written only; pose family, quaternions xyzw.

    timestamp x y z qx qy qz qw

The time stamp is the node's id; a name will do if it is a number. Positions are solved for where
the graph has translations (see `rotavg.positions`) and zero where it has none.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotavg.errors import FormatError
from rotavg.graph import MeasurementGraph
from rotavg.io.lines import exactly, is_number
from rotavg.io.registry import Format, Writable
from rotavg.positions import positions


def write_tum(path: Path, item: Writable) -> bytes:
    """The content of a trajectory, in the order of its time stamps."""
    assert not isinstance(item, MeasurementGraph)
    solution = item
    graph = solution.graph
    stamps = [str(node) for node in graph.nodes.tolist()]
    for stamp in stamps:
        if not is_number(stamp.encode()) or not np.isfinite(float(stamp)):
            found = f"found the node {stamp!r}"
            raise FormatError(f"{found}, expected a number: it is the time stamp", path=path)
    where = np.zeros((graph.num_nodes, 3))
    if graph.translations is not None:
        where = positions(graph, solution.rotations)
    rows = np.hstack([where, solution.quaternions])
    lines = ["# timestamp x y z qx qy qz qw"]
    for k in sorted(range(len(stamps)), key=lambda k: float(stamps[k])):
        lines.append(" ".join([stamps[k], *exactly(rows[k])]))
    return "\n".join([*lines, ""]).encode()


TUM = Format(
    name="tum",
    suffixes=(".tum",),
    recognises=lambda head: head.startswith(b"# timestamp "),
    read=None,
    has_graphs=False,
    write=write_tum,
)
