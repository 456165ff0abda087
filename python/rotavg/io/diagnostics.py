"""What every image, frame and sensor adds to the objective, as a CSV file."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path

import numpy as np

from rotavg.io import atomic
from rotavg.solving.diagnosis import diagnose
from rotavg.solving.solution import Solution

_HEADER = (
    "kind", "id", "edges", "outliers", "cost", "share", "median_residual_deg",
    "largest_residual_deg",
)  # fmt: skip


def write_diagnostics(path: str | os.PathLike[str], solution: Solution) -> None:
    """Write a line for every node, frame and sensor, the largest cost of each kind first.

    The columns are kind (node, frame or sensor), id, edges, outliers, cost, share (of the
    objective), median_residual_deg and largest_residual_deg (`rotavg.Share`).

    Raises FileAccessError if the file `path` cannot be written; what was there before is untouched.
    """
    diagnosis = diagnose(solution)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEADER)
    for kind in ("node", "frame", "sensor"):
        shares = getattr(diagnosis, f"{kind}s")
        for name, s in sorted(shares.items(), key=lambda item: -item[1].cost):
            degrees = np.degrees([s.median_residual, s.largest_residual]).tolist()
            writer.writerow([kind, name, s.edges, s.outliers, s.cost, s.share, *degrees])
    atomic.write_files({Path(path): text.getvalue().encode()})
