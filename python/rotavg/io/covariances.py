"""How well every rotation is known, as CSV for spreadsheets and scripts."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

from rotavg.base.errors import expect
from rotavg.io import atomic
from rotavg.solving.solution import Solution
from rotavg.solving.uncertainty import rms_degrees

HEADER = ("id", "rms_deg", "xx", "xy", "xz", "yy", "yz", "zz", "component")


def write_covariances(
    path: str | os.PathLike[str], solution: Solution, *, noise_variance: float | None = None
) -> None:
    """Write one line for every node, in the order of the graph, under a header.

    The columns: the id; the root mean square angle, in degrees, by which the rotation is off; the
    upper triangle of its covariance in radians^2 (`Solution.covariances`, in the world's frame),
    relative to the first node of its component; the label of that.

    Raises SolverError where there are no covariances, and FileAccessError if the file cannot be
    written; what was there before is untouched.
    """
    expect(solution, Solution)
    covariances = solution.covariances(noise_variance=noise_variance)
    rms = rms_degrees(covariances)
    upper = covariances[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADER)
    nodes, label = solution.graph.nodes.tolist(), solution.component.tolist()
    for node, angle, entries, part in zip(nodes, rms.tolist(), upper.tolist(), label):
        writer.writerow([node, angle, *entries, part])
    atomic.write_files({Path(path): stream.getvalue().encode()})
