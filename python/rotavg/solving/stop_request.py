"""What a callback that has returned False means to the stages of a solution that are to come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rotavg.solving.status import Status


class HeededCallback:
    """A callback that is not called again once it has returned False.

    The stage that was told may have converged at that very iteration, and the next would not know.
    """

    def __init__(self, given: Callable[[Any], bool | None]) -> None:
        self.given = given
        self.has_stopped = False

    def __call__(self, progress: Any) -> bool:
        """Whether to go on."""
        if not self.has_stopped:
            answer = self.given(progress)
            self.has_stopped = answer is not None and not answer
        return not self.has_stopped


def heeded(callback: Callable[[Any], bool | None] | None) -> HeededCallback | None:
    """The callback with a memory; None stays."""
    return None if callback is None else HeededCallback(callback)


def asks_to_stop(status: Status, callback: HeededCallback | None) -> bool:
    """Whether no further stage is to begin."""
    return status is Status.STOPPED or (callback is not None and callback.has_stopped)
