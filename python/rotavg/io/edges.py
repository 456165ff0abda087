"""What a solution says of every edge, as CSV for spreadsheets and scripts."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotavg.graph.ids import IdArray
from rotavg.io import atomic

if TYPE_CHECKING:
    from rotavg.solving.solution import Solution

HEADER = ("i", "j", "residual_deg", "weight", "final_weight", "is_outlier", "verdict")


def write_edges(path: str | os.PathLike[str], solution: Solution) -> None:
    """Write one line for every edge, in the order of the graph, under a header.

    The columns: the ids; the residual angle in degrees; the weight as given and as it was in the
    end; 1 for an outlier, else 0; the verdict (`Solution.edge_verdicts`).

    Raises FileAccessError if the file cannot be written; what was there before is untouched.
    """
    rows = zip(
        *solution.graph.edges.T.tolist(),
        np.degrees(solution.residual_angles).tolist(),
        solution.graph.weights.tolist(),
        solution.edge_weights.tolist(),
        solution.is_outlier.astype(int).tolist(),
        solution.edge_verdicts.tolist(),
    )
    _write(path, HEADER, rows)


def write_edge_list(path: str | os.PathLike[str], edges: IdArray) -> None:
    """Write the ids (k, 2) of edges, a line each, under a header; errors as in `write_edges`."""
    _write(path, HEADER[:2], edges.tolist())


def _write(
    path: str | os.PathLike[str], header: tuple[str, ...], rows: Iterable[Iterable[object]]
) -> None:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    atomic.write_files({Path(path): stream.getvalue().encode()})
