"""What an experiment of the paper is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


def _ignore(_: str) -> None:
    pass


@dataclass(frozen=True)
class Settings:
    """How to run experiments.

    Attributes:
        seed: of the simulated graphs; the same seed gives the same graphs.
        runs: graphs per setting of a table; None for each experiment's own number.
        sizes: numbers of nodes; None for each experiment's own. A figure of one graph takes the
            first.
        slow: whether to run what takes hours, too.
        photographs: a folder of them, or of folders of them, for what starts from photographs.
        references: a folder of NAME_glomap_rotations.txt to compare with, if there is one.
        note: receives what a user has to know before the work starts.
        progress: receives what is being done now.
    """

    seed: int = 1
    runs: int | None = None
    sizes: tuple[int, ...] | None = None
    slow: bool = False
    photographs: Path | None = None
    references: Path | None = None
    note: Callable[[str], None] = _ignore
    progress: Callable[[str], None] = _ignore

    def size(self, default: int) -> int:
        """The number of nodes of a figure's graph."""
        return default if self.sizes is None else self.sizes[0]


@dataclass(frozen=True)
class Outcome:
    """What an experiment found.

    Attributes:
        markdown: for people: tables, or what the picture shows.
        data: the same as numbers, for JSON.
        pictures: files by their suffix ("png", "pdf"); none for a table.
    """

    markdown: str
    data: dict[str, Any]
    pictures: dict[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """A table or figure of the paper.

    Attributes:
        name: as the command line knows it.
        title: one line.
        run: does the work.
        from_photographs: whether it needs `Settings.photographs`.
        draws: whether it makes pictures, which needs the extra `[plot]`.
    """

    name: str
    title: str
    run: Callable[[Settings], Outcome]
    from_photographs: bool = False
    draws: bool = False


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
