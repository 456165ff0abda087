"""When a time limit is over."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Deadline:
    """A moment by the clock of day, as it is told to workers on other machines.

    Attributes:
        at: seconds since the epoch; infinite without a limit.
    """

    at: float = math.inf

    @staticmethod
    def after(seconds: float) -> Deadline:
        """So many seconds from now."""
        return Deadline(time.time() + seconds)

    def left(self) -> float | None:
        """Seconds until then, not below 0; None without a limit."""
        return None if math.isinf(self.at) else max(0.0, self.at - time.time())

    @property
    def passed(self) -> bool:
        """Whether it is over."""
        return time.time() >= self.at


NEVER = Deadline()
