"""Checks of array arguments, in one place so that their errors read alike."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import GraphError

Array = TypeVar("Array", bound="NDArray[Any]")


def _brief(value: Any) -> str:
    """An array or a tuple of more than a few, or a mapping, by what it is; else its repr."""
    few = 4
    if isinstance(value, np.ndarray):
        kind = "str" if value.dtype.kind == "U" else value.dtype
        return f"<{kind} {value.shape}>" if value.size > few else repr(value.tolist())
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, tuple):
        plain = len(value) <= few and all(isinstance(v, (int, float, str, tuple)) for v in value)
        if value and not plain:
            return f"<{len(value)} {type(value[0]).__name__}>"
        return f"({', '.join(map(_brief, value))}{',' * (len(value) == 1)})"
    if isinstance(value, Mapping) and type(value).__repr__ is dict.__repr__ and value:
        return f"<{type(value).__name__} of {len(value)}>"
    return repr(value)


class Brief:
    """A dataclass whose repr tells what arrays and mappings there are, and not what is in them."""

    def __repr__(self) -> str:
        if not is_dataclass(self):
            return object.__repr__(self)
        shown = [f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self) if f.repr]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.__repr__ is Brief.__repr__:  # dataclass() keeps one that is a class's own
            cls.__repr__ = Brief.__repr__  # type: ignore[method-assign]


class ReadOnly(Brief):
    """What has read-only arrays, which stay so when it is unpickled or copied deeply."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)


def as_floats(
    values: ArrayLike, shape: tuple[int, ...], what: str, *, copy: bool = True
) -> NDArray[np.float64]:
    """Copy of `values` as C-order float64 of exactly this shape; GraphError says what is wrong.

    Where matrices (..., 3, 3) are expected, SciPy's `Rotation` is understood, and a list of these.
    Without `copy`, an array that is in order is handed on as it is.
    """
    many = what.split(" of ")[0].endswith("s")  # the entries of ..., not the rotation of ...
    be, have = ("are", "have") if many else ("is", "has")
    try:
        if np.ma.is_masked(values):
            raise GraphError(f"{what} {be} masked in part, expected numbers everywhere")
        if shape[-2:] == (3, 3) and hasattr(values, "as_matrix"):
            values = values.as_matrix()
        elif shape[-2:] == (3, 3) and isinstance(values, (list, tuple)):
            values = [v.as_matrix() if hasattr(v, "as_matrix") else v for v in values]
        array = np.array(values, order="C") if copy else np.asarray(values, order="C")
        if array.dtype.kind == "c":
            raise GraphError(f"{what} {be} complex, expected real numbers")
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError) as error:
        if isinstance(error, GraphError):
            raise
        # NumPy shows its scalars as np.str_('a').
        reason = re.sub(r"np\.\w+\(([^()]*)\)", r"\1", str(error))
        if "inhomogeneous" in reason:
            reason = "its entries differ in shape"
        raise GraphError(f"{what} {be} not an array of numbers: {reason}") from error
    if array.shape != shape:
        raise GraphError(f"{what} {have} shape {array.shape}, expected {shape}")
    return array


def rows_by_label(label: NDArray[Any], count: int) -> list[NDArray[np.int64]]:
    """The rows, rising, of each of the labels 0 to count - 1 in an array (n,)."""
    order = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[order], np.arange(count + 1))
    return [order[low:high] for low, high in zip(ends[:-1], ends[1:])]


def read_only(array: Array) -> Array:
    """The same array, no longer writeable."""
    array.setflags(write=False)
    return array
