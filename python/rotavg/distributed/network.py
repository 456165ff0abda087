"""Tasks on a Dask cluster: one for each part, with what the parts around it have to tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Callable

from rotavg.base.errors import require
from rotavg.distributed.deadline import Deadline
from rotavg.distributed.interruption import check
from rotavg.distributed.part import Part, Rotations, boundary_of, with_others, without_edges


class Network:
    """The parts, as futures that stay where they were made.

    Everything is a task of Dask's, and tasks are pure: where a worker is lost, what it held is
    computed again from what others hold, or read again.

    Args:
        client: of the cluster.
        parts: futures of `Part`.
        neighbours: of every part, the parts that it asks.
    """

    def __init__(self, client: Any, parts: Sequence[Any], neighbours: Sequence[list[int]]) -> None:
        self.client, self.parts, self.neighbours = client, list(parts), neighbours

    def __len__(self) -> int:
        return len(self.parts)

    def each(
        self, function: Callable[..., Any], *states: Sequence[Any], **common: Any
    ) -> list[Any]:
        """Futures of function(part, state of the part, …) of every part."""
        return [
            self.client.submit(
                function, part, *(state[p] for state in states), pure=False, **common
            )
            for p, part in enumerate(self.parts)
        ]

    def with_neighbours(
        self,
        function: Callable[..., Any],
        own: Sequence[Any],
        *states: Sequence[Any],
        **common: Any,
    ) -> list[Any]:
        """Futures of function(part, values of all its nodes, state of the part, …)."""
        boundaries = self.each(boundary_of, own)
        return [
            self.client.submit(
                _with_others,
                function,
                part,
                own[p],
                self.neighbours[p],
                [boundaries[q] for q in self.neighbours[p]],
                *(state[p] for state in states),
                pure=False,
                **common,
            )
            for p, part in enumerate(self.parts)
        ]

    def forget_edges(self) -> None:
        """Keep of the parts only who they are and whom they tell what."""
        self.parts = self.each(without_edges)

    def done(self, futures: Sequence[Any], deadline: Deadline) -> bool:
        """Whether these are done before the deadline, where there is one; waits for either."""
        check()
        if deadline.left() is None:
            return True
        distributed = require("distributed", "distributed")
        try:
            distributed.wait(list(futures), timeout=deadline.left())
        except distributed.TimeoutError:
            return False
        return True

    def gather(self, futures: Sequence[Any]) -> list[Any]:
        """Their results, here."""
        check()
        results: list[Any] = self.client.gather(list(futures))
        return results


def _with_others(
    function: Callable[..., Any],
    part: Part,
    own: Rotations,
    neighbours: list[int],
    boundaries: list[Any],
    *states: Any,
    **common: Any,
) -> Any:
    return function(
        part, with_others(part, own, dict(zip(neighbours, boundaries))), *states, **common
    )
