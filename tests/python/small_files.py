"""Small files written by hand, and what the command says of them."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_rotvecs

I3 = np.eye(3)
SOME = matrices_from_rotvecs(np.random.default_rng(5).standard_normal((6, 3)))
UNIT = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"


def cases(name: str) -> Path:
    """A file of those on which the product fell short once; a test skips where it is absent."""
    default = Path(__file__).resolve().parents[3] / "shared" / "cases"
    path = Path(os.environ.get("ROTAVG_CASES", default)) / name
    if not path.exists():
        pytest.skip(f"{path} is not there; ROTAVG_CASES says where such files are")
    return path


def run(*arguments: Any, status: int = 0) -> str:
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        result = CliRunner().invoke(commands, [str(a) for a in arguments])
    if isinstance(result.exception, rotavg.Error):
        assert status == 2, result.exception
        return str(result.exception)
    assert result.exit_code == status, result.output
    return "\n".join([result.output, *(str(w.message) for w in warned)])


def put(folder: Path, name: str, *lines: str) -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def row(*values: Any) -> str:
    return " ".join(str(value) for value in np.hstack(values).tolist())
