"""Every part of a graph has a worker, and its tasks are for that one."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

import rotavg
from benchmarks.inline_client import InlineClient

pytest.importorskip("distributed", reason="needs the extra [distributed]")
pytest.importorskip("pymetis", reason="needs the extra [distributed]")

from rotavg.distributed import solve
from rotavg.distributed.places import Places

pytestmark = pytest.mark.filterwarnings("default")  # Dask's and Tornado's own


class Recording(InlineClient):
    """Two workers, one with three threads; which of them every task was for."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, tuple[str, ...]]] = []

    def nthreads(self) -> dict[str, int]:
        return {"tcp://b": 3, "tcp://a": 1}

    def submit(self, function: Any, *arguments: Any, **options: Any) -> Any:
        name = function.args[0] if isinstance(function, partial) else function
        self.asked.append((name.__name__, tuple(options.get("workers") or ())))
        assert options.get("workers") is None or options["allow_other_workers"]
        return super().submit(function, *arguments, **options)


def test_tasks_of_a_part_are_for_one_worker_and_parts_shared_out_by_threads() -> None:
    client = Recording()
    places = Places(client, 8)
    assert places.workers == ["tcp://a"] * 2 + ["tcp://b"] * 6
    assert Places(client, 1).workers == ["tcp://b"]
    graph = rotavg.simulate("sphere", 300, noise=0.1, seed=3).graph
    found = solve(graph, client=client, parts=4, tolerance=1e-6)
    assert found.solved
    large = {"_part", "solve_alone", "_with_others", "without_null", "boundary_of"}
    assert large <= {name for name, _ in client.asked}
    for name, workers in client.asked:
        if name in large:
            assert workers in (("tcp://a",), ("tcp://b",)), name
