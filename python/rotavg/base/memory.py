"""What this machine's memory does not hold, told before it is asked for."""

from __future__ import annotations

import os
from collections.abc import Callable


_GROUPS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def physical_memory() -> float:
    """Bytes that this process may have: the machine's, or what ulimit or a container allow.

    Infinity where that is not known. (The same as in rotavg/linalg/memory.hpp.)
    """
    limits = [float("inf")]
    try:
        limits.append(float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        pass
    try:
        import resource
    except ImportError:  # Windows
        pass
    else:
        for which in (resource.RLIMIT_AS, resource.RLIMIT_DATA):
            soft = resource.getrlimit(which)[0]
            if soft != resource.RLIM_INFINITY:
                limits.append(float(soft))
    for path in _GROUPS:
        try:
            with open(path, encoding="ascii") as file:
                limits.append(float(file.read()))
        except (OSError, ValueError):  # no such group, or "max"
            pass
    return min(limits)


def check_memory(what: str, num_bytes: float, error: Callable[[str], Exception]) -> None:
    """Raise `error` if `what` would take more than all memory: systems end such programs."""
    memory = physical_memory()
    if num_bytes > memory:
        raise error(
            f"{what} would take about {num_bytes / 1e9:.3g} GB, "
            f"and this process may have {memory / 1e9:.3g} GB"
        )
