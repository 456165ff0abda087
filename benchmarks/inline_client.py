"""A cluster that is this process: every task is done at once, where it is submitted."""

from __future__ import annotations

from typing import Any, Callable


class Done:
    """A future that has come."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def result(self) -> Any:
        """What came."""
        return self.value


def come(value: Any) -> Any:
    """The value, with that of every future in it."""
    if isinstance(value, Done):
        return value.value
    if isinstance(value, list):
        return [come(one) for one in value]
    return value


class InlineClient:
    """As much of `distributed.Client` as there is use for."""

    def submit(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        pure: bool = False,
        priority: int = 0,
        workers: Any = None,
        allow_other_workers: bool = False,
        **common: Any,
    ) -> Done:
        """Call it."""
        assert not pure
        return Done(function(*map(come, arguments), **{k: come(v) for k, v in common.items()}))

    def gather(self, futures: list[Any]) -> Any:
        """What came of all."""
        return come(futures)

    def run(self, function: Callable[[], Any]) -> dict[str, Any]:
        """Its result on every worker."""
        return {"here": function()}

    def __enter__(self) -> InlineClient:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def nthreads(self) -> dict[str, int]:
        """Of its one worker."""
        return {"here": 1}
