"""Where the tasks of a part run: with what is held of it."""

from __future__ import annotations

from typing import Any, Callable

import numpy as np


class Places:
    """A worker for every part, so that what is large stays where it is.

    Left to itself, a scheduler sends a task wherever a processor is free, and the part after it, so
    that some workers hold others' parts, too. Here tasks of a part run where it was made; where
    that worker has been lost, anywhere. Parts that follow in number, which METIS lets be
    neighbours, are together. (A scheduler that lets workers steal tasks may still move them: a
    cluster that `solve` starts does not.)

    Args:
        client: of the cluster.
        num_parts: shared out by the threads that workers have.
    """

    def __init__(self, client: Any, num_parts: int) -> None:
        self.client = client
        threads = dict(sorted(client.nthreads().items()))
        shares = np.cumsum([0, *threads.values()]) / max(1, sum(threads.values()))
        at = np.searchsorted(shares, (np.arange(num_parts) + 0.5) / num_parts) - 1
        self.workers = [list(threads)[k] for k in at] if threads else []

    def submit(
        self, part: int, function: Callable[..., Any], *arguments: Any, **options: Any
    ) -> Any:
        """A task of this part."""
        where: dict[str, Any] = {}
        if self.workers:
            where = {"workers": [self.workers[part]], "allow_other_workers": True}
        return self.client.submit(function, *arguments, pure=False, **where, **options)
