"""Ctrl-C between two waits.

Raised in the middle of Dask's code it may be lost (Python drops what is raised while an object is
deleted), or leave tasks behind that complain. So it is noted, and raised where nothing is open.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_asked = threading.Event()


@contextmanager
def heeded() -> Iterator[None]:
    """In the main thread, Ctrl-C waits for `check`; pressed twice, it does not."""
    before = signal.getsignal(signal.SIGINT)
    if not (threading.current_thread() is threading.main_thread() and callable(before)):
        yield
        return

    def noted(number: int, frame: Any) -> None:
        if _asked.is_set():
            before(number, frame)
        _asked.set()

    _asked.clear()
    signal.signal(signal.SIGINT, noted)
    try:
        yield
        check()
    finally:
        signal.signal(signal.SIGINT, before)
        _asked.clear()


def check() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed."""
    if _asked.is_set() and threading.current_thread() is threading.main_thread():
        _asked.clear()
        raise KeyboardInterrupt
