"""Tasks on a Dask cluster: one for each part, with what the parts around it have to tell it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Callable

from rotavg.base.errors import require
from rotavg.distributed.deadline import NEVER, Deadline
from rotavg.distributed.interruption import check
from rotavg.distributed.part import Part, Rotations, boundary_of, with_others, without_edges
from rotavg.distributed.places import Places

LONGEST = 0.5  # seconds, until Ctrl-C is heeded


class Network:
    """The parts, as futures that stay where they were made.

    Everything is a task of Dask's, and tasks are pure: where a worker is lost, what it held is
    computed again from what others hold, or read again.

    Args:
        places: of the parts.
        parts: futures of `Part`.
        neighbours: of every part, the parts that it asks.
    """

    def __init__(
        self, places: Places, parts: Sequence[Any], neighbours: Sequence[list[int]]
    ) -> None:
        self.places, self.parts, self.neighbours = places, list(parts), neighbours

    @property
    def client(self) -> Any:
        """Of the cluster."""
        return self.places.client

    def __len__(self) -> int:
        return len(self.parts)

    def each(
        self,
        function: Callable[..., Any],
        *states: Sequence[Any],
        priority: int = 0,
        **common: Any,
    ) -> list[Any]:
        """Futures of function(part, state of the part, …) of every part."""
        return [
            self.at(p, function, part, *(state[p] for state in states), priority=priority, **common)
            for p, part in enumerate(self.parts)
        ]

    def at(
        self,
        part: int,
        function: Callable[..., Any],
        *arguments: Any,
        priority: int = 0,
        **common: Any,
    ) -> Any:
        """A future of function(arguments, …), called where the part is; the highest come first."""
        return self.places.submit(part, function, *arguments, priority=priority, **common)

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
            self.at(
                p,
                _with_others,
                function,
                part,
                own[p],
                self.neighbours[p],
                [boundaries[q] for q in self.neighbours[p]],
                *(state[p] for state in states),
                **common,
            )
            for p, part in enumerate(self.parts)
        ]

    def forget_edges(self) -> None:
        """Keep of the parts only who they are and whom they tell what.

        The edges of a part are gone as soon as the tasks are done that were asked for before: these
        come first, and not after all that waits for other parts.
        """
        self.parts = self.each(without_edges, priority=1)

    def done(self, futures: Sequence[Any], deadline: Deadline) -> bool:
        """Whether these are done before the deadline; waits for either."""
        return waited(futures, deadline)

    def gather(self, futures: Sequence[Any]) -> list[Any]:
        """Their results, here."""
        return gathered(self.client, futures)


def gathered(client: Any, futures: Sequence[Any]) -> list[Any]:
    """The results of futures, here."""
    waited(futures, NEVER)
    results: list[Any] = client.gather(list(futures))
    return results


def waited(futures: Sequence[Any], deadline: Deadline) -> bool:
    """Whether futures are done before the deadline; waits for either, or for Ctrl-C."""
    distributed = require("distributed", "distributed")
    check()
    if not all(isinstance(future, distributed.Future) for future in futures):
        return True
    while True:
        left = deadline.left()
        try:
            distributed.wait(list(futures), timeout=LONGEST if left is None else min(LONGEST, left))
        except distributed.TimeoutError:
            check()
            if deadline.passed:
                return False
        else:
            check()
            return True


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
