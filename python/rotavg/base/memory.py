"""What this machine's memory does not hold, told before it is asked for."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

_GROUPS = ("memory.max", "memory/memory.limit_in_bytes")  # of Linux's control groups


def physical_memory() -> float:
    """Bytes that this process may have: the machine's, or what ulimit or a container allow.

    Infinity where that is not known. (The same as in rotavg/linalg/memory.hpp.)
    """
    limits = [float("inf")]
    with suppress(AttributeError, OSError, ValueError):
        limits.append(float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    with suppress(ImportError):  # Windows has none
        import resource

        soft = [
            resource.getrlimit(which)[0] for which in (resource.RLIMIT_AS, resource.RLIMIT_DATA)
        ]
        limits += [float(limit) for limit in soft if limit != resource.RLIM_INFINITY]
    for group in _GROUPS:
        with suppress(OSError, ValueError):  # there is none, or "max"
            limits.append(float((Path("/sys/fs/cgroup") / group).read_text(encoding="ascii")))
    return min(limits)


def check_memory(what: str, num_bytes: float, error: Callable[[str], Exception]) -> None:
    """Raise `error` if `what` would take more than all memory: systems end such programs."""
    memory = physical_memory()
    if num_bytes > memory:
        raise error(
            f"{what} would take about {num_bytes / 1e9:.3g} GB, "
            f"and this process may have {memory / 1e9:.3g} GB"
        )
