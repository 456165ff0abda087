"""Where real measurements lie; a test that needs them is skipped where they are absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_DEFAULT = Path(__file__).resolve().parents[3] / "shared" / "data"


def shared_data(name: str) -> Path:
    path = Path(os.environ.get("ROTAVG_DATA", _DEFAULT)) / name
    if not path.exists():
        pytest.skip(f"{path} is not there; ROTAVG_DATA says where the real measurements are")
    return path
