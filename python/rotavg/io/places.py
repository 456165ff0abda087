"""Where in a file something stands, for errors and notes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rotavg.base.errors import FormatError


class Places:
    """Where in a file each of m measurements stands: a line, or the name of a place."""

    def __init__(self, names: Sequence[str] = (), lines: Sequence[int] = ()) -> None:
        self.names, self.lines = names, lines

    def error(self, path: Path, row: int, reason: str) -> FormatError:
        """What is wrong with one of them."""
        if self.lines:
            return FormatError(reason, path=path, line=self.lines[row])
        return FormatError(f"{self.names[row]}: {reason}", path=path)

    def line(self, row: int) -> int | None:
        """That of one of them, if it has one."""
        return self.lines[row] if self.lines else None

    def other(self, row: int) -> str:
        """Of one of them, in a sentence about another."""
        return f"that in line {self.lines[row]}" if self.lines else self.names[row]

    def name(self, row: int) -> str:
        """Of one of them, in a sentence."""
        return f"in line {self.lines[row]}" if self.lines else f"of {self.names[row]}"
