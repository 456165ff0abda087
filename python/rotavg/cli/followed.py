"""What `rotavg solve --follow` has read so far, as the solution that is written at its end."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.io.dialects import DIALECTS
from rotavg.io.g2o import read_g2o
from rotavg.io.g2o_stream import EdgeLine
from rotavg.io.registry import ReadOptions

_EDGES = {dialect.edge for dialect in DIALECTS}


@dataclass(frozen=True, eq=False)
class FollowedSolution(rotavg.KnownRotations):
    """Rotations of the file's nodes, and what a robust loss has left of its edges, (m,)."""

    edge_shares: NDArray[np.float64]


class Followed:
    """Lines as they come, and the edges in them.

    Args:
        path: for errors.
        unit_weights: as `rotavg.read` has it.
    """

    def __init__(self, path: Path, unit_weights: bool) -> None:
        self._path, self._unit_weights = path, unit_weights
        self._lines: list[bytes] = []
        self._weights: list[float] = []
        self._last = 0  # line of the last edge that was added
        self._kind: tuple[bytes, int] | None = None

    def remembered(self, lines: Iterable[bytes]) -> Iterator[bytes]:
        """The same lines, which are kept."""
        for line in lines:
            self._lines.append(line)
            yield line

    def check(self, edge: EdgeLine) -> None:
        """FormatError for an edge of another kind than those before: no file holds both."""
        words = self._lines[edge.line - 1].split(b"#")[0].split()
        kind = words[0], len(words)
        if self._kind not in (None, kind):
            assert self._kind is not None
            expected = f"expected {self._kind[0].decode()} and {self._kind[1] - 1} as before"
            found = f"found {kind[0].decode()} and {kind[1] - 1} numbers, {expected}"
            raise rotavg.FormatError(f"{found}, to write them", path=self._path, line=edge.line)
        self._kind = kind

    def add(self, edge: EdgeLine) -> None:
        """Count an edge that is in the solution."""
        self._last = edge.line
        self._weights.append(float(edge.weights[0]))

    def solution(self, online: rotavg.Online) -> FollowedSolution:
        """All that is known, for `rotavg.write`; the first node of a component has the identity.

        Raises FormatError where the edges alone make no graph.
        """
        graph = self._graph()
        found = online.solution
        R = np.array([found.get(node, np.eye(3)) for node in graph.nodes.tolist()])
        label = graph.components()
        first = np.unique(label, return_index=True)[1]
        given = np.array(self._weights)
        left = online.edge_weights[: len(given)][given > 0] / given[given > 0]
        root_from_world = np.swapaxes(R[first[label]], 1, 2)
        return FollowedSolution(graph, root_from_world @ R, np.minimum(left, 1.0))

    def _graph(self) -> rotavg.MeasurementGraph:
        """Of the lines up to the last edge, and of what stands behind it but edges."""
        behind = self._lines[self._last :]
        kept = self._lines[: self._last] + [line for line in behind if not _is_edge(line)]
        bare = self._kind is not None and self._kind[1] < _with_information(self._kind[0])
        options = ReadOptions(self._unit_weights or bare, "pose")
        try:
            return read_g2o(self._path, b"".join(kept), options)
        except rotavg.FormatError as error:  # of what nobody looked at, as vertices
            warnings.warn(
                f"only the edges are kept of the other lines: {error}",
                rotavg.IncompleteWarning,
                stacklevel=2,
            )
        edges = [line for line in self._lines[: self._last] if _is_edge(line)]
        return read_g2o(self._path, b"".join(edges), options)


def _is_edge(line: bytes) -> bool:
    return line.split(None, 1)[:1] != [] and line.split(None, 1)[0] in _EDGES


def _with_information(tag: bytes) -> int:
    """How many words a line with information has."""
    dialect = next(dialect for dialect in DIALECTS if dialect.edge == tag)
    return 3 + dialect.num_pose + len(dialect.order)
