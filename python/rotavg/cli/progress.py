"""How far a command is, on stderr: a moving line on a terminal; elsewhere, a line now and then."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Callable, Optional

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.text import Text

import rotavg

Callback = Optional[Callable[[rotavg.Progress], None]]

# Seconds: a log is told of long work alone, and not too often.
FIRST_LINE_AFTER = 5.0
LONGEST_SILENCE = 60.0


class NowAndThen:
    """Writes to stderr what is being done, after 5, 15, 35 … seconds and then once a minute.

    By a thread of its own: it speaks also where one step, as a factorisation, takes minutes.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> NowAndThen:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        start, pause = time.monotonic(), FIRST_LINE_AFTER
        while not self._ended.wait(pause):
            line = f"rotavg: {self.text}, {time.monotonic() - start:.0f} s\n"
            try:
                sys.stderr.write(line)
                sys.stderr.flush()
            except (OSError, ValueError):  # nobody listens any more
                return
            pause = min(2.0 * pause, LONGEST_SILENCE)


@contextmanager
def working(on: str) -> Iterator[None]:
    """Say for as long as it lasts what is worked on."""
    if sys.stderr is None:
        yield
    elif sys.stderr.isatty():
        with Console(stderr=True).status(Text(on)):
            yield
    else:
        with NowAndThen(on):
            yield


@contextmanager
def progress(
    tolerance: float = 1e-9, stop: str = "gradient", certify: bool = True
) -> Iterator[Callback]:
    """A callback that shows how far the solver is: by how many of the orders of magnitude that the
    gradient (or step) has to fall. None where there is no stderr.
    """
    then = "certifying" if certify else "converged"
    fall = Fall(tolerance)

    def fraction_and_text(p: rotavg.Progress) -> tuple[float, str]:
        fraction = fall.fraction(p.iteration, p.relative_gradient if stop == "gradient" else p.step)
        text = (
            f"iteration {p.iteration}, objective {p.objective:.9g}, "
            f"relative gradient {p.relative_gradient:.1e}"
        )
        return fraction, then if fraction == 1.0 else text

    if sys.stderr is None:
        yield None
    elif sys.stderr.isatty():
        columns = (SpinnerColumn(), BarColumn(20), TextColumn("{task.description}"))
        console = Console(stderr=True)
        with Bar(*columns, TimeElapsedColumn(), console=console, transient=True) as bar:
            task = bar.add_task("starting", total=1.0)
            shown = 0.0

            def show(p: rotavg.Progress) -> None:
                nonlocal shown
                fraction, text = fraction_and_text(p)
                now = time.monotonic()
                if fraction == 1.0 or now - shown >= 0.1:
                    shown = now
                    bar.update(task, description=text, completed=fraction)

            yield show
    else:
        with NowAndThen("starting") as told:

            def tell(p: rotavg.Progress) -> None:
                told.text = fraction_and_text(p)[1]

            yield tell


class Fall:
    """How far a gradient (or step) has come down to where the solver stops."""

    def __init__(self, last: float) -> None:
        self._first, self._last = 0.0, last

    def fraction(self, iteration: int, now: float) -> float:
        """Of the way, in orders of magnitude; 1 at the end. A run begins with iteration 0."""
        if iteration == 0:  # there is no step yet
            self._first = 0.0
        self._first = max(self._first, now)
        if now <= self._last and iteration > 0:
            return 1.0
        if not (self._first > now > 0 and self._last > 0):
            return 0.0
        return math.log(self._first / now) / math.log(self._first / self._last)
