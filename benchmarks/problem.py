"""What a solver is given, and what an adapter must offer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Problem:
    """A connected measurement graph as plain arrays, in the pose family: R_i R_ij = R_j.

    Attributes:
        indices: (m, 2) the edges as rows of the nodes.
        rotations: (m, 3, 3) R_ij = i_from_j.
        weights: (m,).
        start: (n, 3, 3) world_from_node, products along shortest paths: for solvers that do not
            make an initial value of their own. It costs them nothing.
        threads: how many the solver may use.
        time_limit: seconds after which a solver that can stop by itself should; a little later
            its process is ended.
    """

    indices: NDArray[np.int32]
    rotations: NDArray[np.float64]
    weights: NDArray[np.float64]
    start: NDArray[np.float64]
    threads: int = 1
    time_limit: float = np.inf

    @property
    def num_nodes(self) -> int:
        """Number of nodes, n."""
        return len(self.start)

    def save(self, path: Path) -> None:
        """Write the arrays as .npz."""
        np.savez(
            path,
            indices=self.indices,
            rotations=self.rotations,
            weights=self.weights,
            start=self.start,
        )

    @classmethod
    def load(cls, path: Path, *, threads: int, time_limit: float) -> Problem:
        """Read what `save` wrote."""
        with np.load(path) as arrays:
            return cls(**arrays, threads=threads, time_limit=time_limit)


class Adapter(Protocol):
    """One solver behind the interface that is measured. Only `solve` is timed.

    The constructor takes the problem into the solver's own types, `rotations` takes the answer out
    again; conventions are converted in these two places.
    """

    def __init__(self, problem: Problem, variant: str) -> None: ...

    def solve(self) -> None:
        """The work that is measured."""
        ...

    def rotations(self) -> NDArray[np.float64]:
        """The answer (n, 3, 3), world_from_node."""
        ...

    def claim(self) -> str:
        """What the solver itself says of its answer, in a few words."""
        ...


def kept_edges(problem: Problem) -> NDArray[np.int64]:
    """Rows of the edges that a solver can take that knows one edge for a pair of nodes: the first
    of each pair, whichever way round.
    """
    pairs = np.sort(problem.indices, axis=1)
    return np.sort(np.unique(pairs, axis=0, return_index=True)[1])
