"""JSON files of poses: what is in them, checked; errors name the place in the file."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.io.lines import BYTE_ORDER_MARK

_LARGEST = sys.float_info.max  # Python compares integers of any size with it


def loaded(path: Path, data: bytes) -> Any:
    """What a file holds; FormatError, which names the line, if it is no JSON."""
    try:
        return json.loads(data.removeprefix(BYTE_ORDER_MARK))
    except json.JSONDecodeError as error:
        found = f"found no JSON: {error.msg} at column {error.colno}"
        raise FormatError(found, path=path, line=error.lineno) from None
    except (UnicodeDecodeError, RecursionError, ValueError) as error:
        raise FormatError(f"found no JSON: {error}", path=path) from None


def parsed(path: Path, data: bytes) -> dict[str, Any]:
    """The object that a file is; FormatError, which names the line, if it is none."""
    value = loaded(path, data)
    if not isinstance(value, dict):
        raise FormatError(f"found {_shown(value)}, expected an object {{...}}", path=path)
    return value


def member(path: Path, value: Any, name: str, where: str) -> Any:
    """The member of this name of an object; FormatError without one."""
    if not isinstance(value, dict) or name not in value:
        found = f"{where}: found {_shown(value)}"
        raise FormatError(f'{found}, expected an object with "{name}"', path=path)
    return value[name]


def entries(path: Path, value: Any, where: str) -> list[Any]:
    """A list; FormatError for anything else."""
    if not isinstance(value, list):
        raise FormatError(f"{where}: found {_shown(value)}, expected a list", path=path)
    return value


def numbers(path: Path, value: Any, count: int, where: str) -> NDArray[np.float64]:
    """So many finite numbers; FormatError for anything else."""
    flat = value if isinstance(value, list) else [value]
    if len(flat) != count:
        expected = f"expected {count} number{'s' * (count > 1)}"
        raise FormatError(f"{where}: found {_shown(value)}, {expected}", path=path)
    for number in flat:
        plain = isinstance(number, (int, float)) and not isinstance(number, bool)
        if not (plain and abs(number) <= _LARGEST):
            found = f"{where}: found {_shown(number)}"
            raise FormatError(f"{found}, expected a finite number", path=path)
    return np.array(flat, dtype=np.float64)


def whole(path: Path, value: Any, where: str) -> int:
    """An integer of 64 bits; FormatError for anything else."""
    if not isinstance(value, int) or isinstance(value, bool) or not -(2**63) <= value < 2**63:
        raise FormatError(f"{where}: found {_shown(value)}, expected an integer", path=path)
    return value


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
