"""How the commands' help is laid out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click


class Command(click.Command):
    """A command whose help lists its options in groups.

    Args:
        groups: the names of the parameters under each title; what is named nowhere comes last.
    """

    def __init__(
        self, *args: Any, groups: Mapping[str, Sequence[str]] | None = None, **settings: Any
    ) -> None:
        super().__init__(*args, **settings)
        self.title_of = {name: title for title, names in (groups or {}).items() for name in names}

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, group by group."""
        sections: dict[str, list[tuple[str, str]]] = {t: [] for t in self.title_of.values()}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                title = self.title_of.get(parameter.name or "", "Options")
                sections.setdefault(title, []).append(record)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl(records)


class Count(click.IntRange):
    """A whole number; help does not name the largest that there is."""

    def __init__(self, low: int = 0) -> None:
        super().__init__(low, 2**31 - 1)

    def _describe_range(self) -> str:
        return f"x>={self.min}"


class PlainNumber(float):
    """A default that help shows as people write it: 1e+12, not 1000000000000.0."""

    def __str__(self) -> str:
        return f"{self:g}"


class Commands(click.Group):
    """A group that lists its commands in the order in which they were added."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands."""
        return list(self.commands)
