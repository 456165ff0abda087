"""What a file format is, and which one a file is in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Union, runtime_checkable

from numpy.typing import NDArray

from rotavg.errors import FileAccessError, FormatError, GraphError
from rotavg.graph import MeasurementGraph


@runtime_checkable
class SolutionLike(Protocol):
    """What a writer needs of a solution: world_from_node for every node of its graph."""

    @property
    def graph(self) -> MeasurementGraph:
        """The graph that was solved, of n nodes."""
        ...

    @property
    def rotations(self) -> NDArray[Any]:
        """(n, 3, 3), world_from_node."""
        ...

    @property
    def quaternions(self) -> NDArray[Any]:
        """(n, 4), the same as xyzw."""
        ...


Writable = Union[MeasurementGraph, SolutionLike]


@dataclass(frozen=True)
class Format:
    """A file format, stated once.

    Attributes:
        name: what users call it.
        suffixes: how its files are named, lower case with the dot; the first is the usual one.
        recognises: whether the beginning of a file (up to 64 KiB) is in this format.
        read: (path, whole content, unit_weights) -> graph; raises FormatError.
        write: (path, graph or solution) -> whole content; raises FormatError.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    read: Callable[[Path, bytes, bool], MeasurementGraph]
    write: Callable[[Path, Writable], bytes]


HEAD_SIZE = 1 << 16


def named(formats: Sequence[Format], name: str) -> Format:
    """The format of this name; FormatError lists the known ones."""
    for form in formats:
        if form.name == name:
            return form
    raise FormatError(f"unknown format {name!r}, {_expected(formats)}")


def by_suffix(formats: Sequence[Format], path: Path) -> Format:
    """The format that the file's name tells; FormatError lists the known ones."""
    for form in formats:
        if path.suffix.lower() in form.suffixes:
            return form
    raise FormatError(f"the name does not tell the format, {_expected(formats)}", path=path)


def of_content(formats: Sequence[Format], path: Path, data: bytes) -> Format:
    """The format that the content tells, or failing that the name."""
    for form in formats:
        if form.recognises(data[:HEAD_SIZE]):
            return form
    try:
        return by_suffix(formats, path)
    except FormatError:
        found = "neither content nor name tells the format"
        raise FormatError(f"{found}, {_expected(formats)}", path=path) from None


def read_bytes(path: Path) -> bytes:
    """The whole file; FileAccessError if it cannot be read, FormatError if it is empty."""
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=path) from error
    if not data.strip():
        raise FormatError("the file is empty, expected a measurement graph", path=path)
    return data


@contextmanager
def blame_line(path: Path, lines: Sequence[int] | None = None) -> Iterator[None]:
    """Turn a GraphError about an edge into a FormatError about the line it was read from."""
    try:
        yield
    except GraphError as error:
        line = None if lines is None or error.edge is None else int(lines[error.edge])
        raise FormatError(str(error), path=path, line=line) from error


def _expected(formats: Sequence[Format]) -> str:
    known = ", ".join(f"{form.name} ({'/'.join(form.suffixes)})" for form in formats)
    return f"expected one of the known formats: {known}"
