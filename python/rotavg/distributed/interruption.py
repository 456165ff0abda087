"""Ctrl-C that is never lost.

Python drops what is raised while an object is deleted, and Dask's futures do some work when they
are: a KeyboardInterrupt that falls there would have no effect. So it is raised once more.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_asked = threading.Event()


@contextmanager
def heeded() -> Iterator[None]:
    """For as long as this lasts, `check` tells whether Ctrl-C was pressed (in the main thread)."""
    before = signal.getsignal(signal.SIGINT)
    if not (threading.current_thread() is threading.main_thread() and callable(before)):
        yield
        return

    hook = sys.unraisablehook

    def dropped(what: Any) -> None:
        if not issubclass(what.exc_type, KeyboardInterrupt):
            hook(what)

    def noted(number: int, frame: Any) -> None:
        _asked.set()
        before(number, frame)

    _asked.clear()
    signal.signal(signal.SIGINT, noted)
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGINT, before)
        _asked.clear()


def check() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed and came to nothing."""
    if _asked.is_set() and threading.current_thread() is threading.main_thread():
        _asked.clear()
        raise KeyboardInterrupt
