"""Options as users give them, checked and as the core takes them; all raise OptionError."""

from __future__ import annotations

import math
import os
from typing import TypeVar

import numpy as np

from rotavg.base.errors import OptionError

_LEAST_ANGLE = 1e-6  # radians; smaller ones drown in rounding

_Value = TypeVar("_Value")


def nonnegative(name: str, value: float) -> float:
    """A number >= 0."""
    if not (isinstance(value, (int, float, np.number)) and value >= 0):
        raise OptionError(f"{name} is {value!r}; expected a number that is not negative")
    return float(value)


def probability(name: str, value: float) -> float:
    """A number in [0, 1)."""
    if not (isinstance(value, (int, float, np.number)) and 0 <= value < 1):
        raise OptionError(f"{name} is {value!r}; expected a number from 0 to below 1")
    return float(value)


def share(name: str, value: float) -> float:
    """A number in (0, 1)."""
    if not (isinstance(value, (int, float, np.number)) and 0 < value < 1):
        raise OptionError(f"{name} is {value!r}; expected a number between 0 and 1")
    return float(value)


def angle(name: str, value: float | str | None, otherwise: str | None) -> float:
    """Radians; 0 for `otherwise`, which the core chooses for."""
    if value is None or isinstance(value, str):
        if value == otherwise:
            return 0.0
    elif isinstance(value, (int, float, np.number)) and _LEAST_ANGLE <= value <= np.pi:
        return float(value)
    expected = f"expected an angle in radians, {_LEAST_ANGLE} to pi, or {otherwise!r}"
    raise OptionError(f"{name} is {value!r}; {expected}")


def seconds(value: float | None) -> float:
    """The time limit; infinite for None."""
    return math.inf if value is None else nonnegative("time_limit", value)


def function(value: _Value) -> _Value:
    """The callback, or None."""
    if not (value is None or callable(value)):
        raise OptionError(f"callback is {value!r}; expected a function or None")
    return value


def word(name: str, value: str) -> str:
    """Any: the core knows which there are."""
    if not isinstance(value, str):
        raise OptionError(f"{name} is {value!r}; expected a word (str)")
    return value


def loss(value: str) -> str:
    """Any name of a loss, as above; of a function it is told where to go with it."""
    if callable(value):
        hint = "one of your own is reweighted least squares, a dozen lines: docs/own_methods.md"
        raise OptionError(f"loss is a function; expected the name of a loss ({hint})")
    return word("loss", value)


def of_loss(loss: str, name: str, value: _Value, otherwise: _Value) -> _Value:
    """What a robust loss alone has a use for."""
    if loss == "l2" and value != otherwise:
        raise OptionError(f'{name} is for a robust loss, and this is "l2"')
    return value


def whole(name: str, value: int, low: int, high: int) -> int:
    """A whole number in [low, high]."""
    if not (isinstance(value, (int, np.integer)) and low <= value <= high):
        raise OptionError(f"{name} is {value!r}; expected a whole number from {low} to {high}")
    return int(value)


def threads(value: int | None) -> int:
    """The number of threads; for None that of the processors this process may use."""
    if value is not None:
        return whole("num_threads", value, 1, 4096)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else (os.cpu_count() or 1)
