"""What this machine's memory does not hold, told before it is asked for."""

from __future__ import annotations

import os
from collections.abc import Callable


def physical_memory() -> float:
    """Bytes of memory that this machine has; infinity where that is not known."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float("inf")


def check_memory(what: str, num_bytes: float, error: Callable[[str], Exception]) -> None:
    """Raise `error` if `what` would take more than all memory: systems end such programs."""
    memory = physical_memory()
    if num_bytes > memory:
        raise error(
            f"{what} would take about {num_bytes / 1e9:.3g} GB, "
            f"and this machine has {memory / 1e9:.3g} GB"
        )
