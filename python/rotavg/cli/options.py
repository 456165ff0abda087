"""Options that several commands have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable

import click

PATH = click.Path(path_type=Path)

as_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
unit_weights = click.option(
    "--unit-weights", is_flag=True, help="Weight 1 for every edge, whatever the file says."
)


def choice(name: str, values: list[str], default: str, text: str) -> Callable[[Any], Any]:
    """An option that takes one of a few words."""
    return click.option(
        name, type=click.Choice(values), default=default, show_default=True, help=text
    )


def number(name: str, kind: Any, default: float, text: str) -> Callable[[Any], Any]:
    """An option that takes a number within bounds."""
    metavar = "N" if isinstance(kind, click.IntRange) else "X"
    return click.option(
        name, type=kind, default=default, show_default=True, metavar=metavar, help=text
    )
