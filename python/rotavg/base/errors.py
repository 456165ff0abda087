"""The one family of errors: everything this package raises on purpose is a `rotavg.Error`."""

from __future__ import annotations

import importlib
import os
from typing import Any


class Error(Exception):
    """Base of all errors raised by rotavg."""


class GraphError(Error, ValueError):
    """A measurement graph, or an argument that describes one, breaks a rule.

    `edge` is the row of the offending edge in the graph, or in the list of edges that is to blame;
    None where no single edge is.
    """

    def __init__(self, message: str, *, edge: int | None = None) -> None:
        super().__init__(message)
        self.edge = edge


class ArgumentTypeError(GraphError, TypeError):
    """An argument is of another type than was expected."""


class UnknownNodeError(GraphError, KeyError):
    """A graph has no node of this id."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would show it in quotes


class FormatError(Error, ValueError):
    """A file does not hold what its format asks for, or cannot hold what is to be written.

    The message reads "path:line: what was found, what was expected"; `path` and `line` (counted
    from 1, None where no line is to blame) are attributes as well.
    """

    def __init__(
        self,
        message: str,
        *,
        path: str | os.PathLike[str] | None = None,
        line: int | None = None,
    ) -> None:
        place = "" if path is None else os.fspath(path) + ("" if line is None else f":{line}")
        super().__init__(f"{place}: {message}" if place else message)
        self.path = path
        self.line = line


class FileAccessError(FormatError, OSError):
    """A file cannot be read or written; the operating system's error is the `__cause__`."""


class SolverError(Error, RuntimeError):
    """A solver could not be run as asked."""


class OptionError(SolverError, ValueError):
    """An option that does not exist or is out of range; the message says what was expected."""


class MissingExtraError(Error, ImportError):
    """An optional dependency is not installed; the message names the extra that brings it."""


class IncompleteWarning(UserWarning):
    """A file was written, but not all that was known is in it, or not all in it is known.

    Or rotations were read, and some in the file had to be mended.
    """


def expect(value: Any, kind: type, hint: str = "") -> None:
    """ArgumentTypeError where `value` is not of this kind."""
    if not isinstance(value, kind):
        found, expected = _with_article(type(value).__name__), _with_article(kind.__name__)
        raise ArgumentTypeError(f"found {found}, expected {expected}{hint}")


def _with_article(name: str) -> str:
    return f"an {name}" if name[0] in "AEIOUaeiou" else f"a {name}"


def require(module: str, extra: str) -> Any:
    """Import an optional dependency when it is needed, not before.

    Raises MissingExtraError with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{module} is needed for this and cannot be imported ({error}): "
            f'pip install "rotavg[{extra}]"',
            name=module,
        ) from error
