"""What was measured, on what: JSON for the record."""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import rotavg
from benchmarks.compare import GraphResult, Settings

_PACKAGES = ("numpy", "scipy", "gtsam", "pytheia", "pycolmap", "pymanopt")


def machine() -> dict[str, Any]:
    """Processor, memory, system, and how busy it was just now."""
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "processor": _processor(),
        "processors": len(os.sched_getaffinity(0)),
        "memory_gib": round(pages / 2**30, 1),
        "system": platform.platform(),
        "python": platform.python_version(),
        "load_average": os.getloadavg(),
        "time": datetime.now(timezone.utc).isoformat(timespec="seconds"),
    }


def versions() -> dict[str, str]:
    """Versions of rotavg, with its commit where there is a repository, and of the others."""
    found = {"rotavg": rotavg.__version__ + _commit()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def write_json(
    path: Path,
    *,
    machine: Mapping[str, Any],
    settings: Settings,
    refused: Mapping[str, str],
    results: Sequence[GraphResult],
) -> None:
    """Write everything that is known; `machine` is as it was at the start."""
    everything = {
        "machine": machine,
        "load_average_at_the_end": os.getloadavg(),
        "versions": versions(),
        "settings": asdict(settings),
        "not_measured": refused,
        "graphs": [asdict(result) for result in results],
    }
    path.write_text(json.dumps(_finite(everything), indent=1, allow_nan=False), encoding="utf-8")


def _finite(value: Any) -> Any:
    """The same with null for numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor()


def _commit() -> str:
    git = ["git", "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(
            git, cwd=Path(__file__).parent, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return f" ({done.stdout.strip()})"
