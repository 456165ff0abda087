"""Options that several commands have in common."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, Callable, TypeVar

import click
from click.core import ParameterSource

from rotavg.cli.command import PlainNumber
from rotavg.io import FORMATS
from rotavg.io.streams import STDIN, STDOUT

Group = TypeVar("Group")


class _StreamOrPath(click.Path):
    """A path; - is a standard stream, by the name that the system has for it."""

    def __init__(self, stream: Path) -> None:
        super().__init__(path_type=Path)
        self.stream = stream

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """A Path; usage error for a stream that another parameter of the command has."""
        path = super().convert(self.stream if str(value) == "-" else value, param, ctx)
        taken = {} if ctx is None else ctx.meta
        if path == self.stream and taken.setdefault(f"rotavg{path}", param) is not param:
            self.fail(f"{path} is used already", param, ctx)
        return path


PATH = click.Path(path_type=Path)  # of folders and the like
INPUT = _StreamOrPath(STDIN)
OUTPUT = _StreamOrPath(STDOUT)

as_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
unit_weights = click.option(
    "--unit-weights", is_flag=True, help="Weight 1 for every edge, whatever the file says."
)

input_format = click.option(
    "--format",
    "format",
    type=click.Choice([form.name for form in FORMATS if form.read]),
    help="Format of the input.  [default: as its content tells, or its name]",
)


def output_format(formats: list[str]) -> Callable[[Any], Any]:
    """The option that says what to write."""
    return click.option(
        "--output-format",
        type=click.Choice(formats),
        help="Format of the output.  [default: as its name tells]",
    )


output_graph = output_format([form.name for form in FORMATS if form.write and form.has_graphs])
output_solution = output_format(
    [form.name for form in FORMATS if form.write and form.has_solutions]
)
convention = click.option(
    "--convention",
    type=click.Choice(["pose", "vision"]),
    help="Family of the input's rotations, where text, csv or npz leave it open: pose (R_i R_ij = "
    "R_j) or vision (R_ij = R_j R_i^T).  [default: pose]",
)

columns = click.option(
    "--columns",
    metavar="WORDS",
    help="What the columns of a text or CSV file without a header are, such as "
    "i,j,qw,qx,qy,qz,weight; rx,ry,rz for rotation vectors (radians; rx_deg,...), "
    "r11,...,r33 for matrices, _ for none.",
)


def choice(name: str, values: list[str], default: str, text: str) -> Callable[[Any], Any]:
    """An option that takes one of a few words."""
    return click.option(
        name, type=click.Choice(values), default=default, show_default=True, help=text
    )


def number(name: str, kind: Any, default: float, text: str) -> Callable[[Any], Any]:
    """An option that takes a number within bounds."""
    whole = kind is int or isinstance(kind, click.IntRange)
    shown = default if whole else PlainNumber(default)
    return click.option(
        name, type=kind, default=shown, show_default=True, metavar="N" if whole else "X", help=text
    )


def groups_of(**titles: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Titles with their options, after those of reading a graph, which many commands have."""
    return {
        "Reading": (
            *("format", "columns", "convention", "unit_weights", "skip_self_edges", "covariances"),
        ),
        "Which part": ("nodes_path", "largest_component", "min_nodes"),
        **{title.replace("_", " "): names for title, names in titles.items()},
    }


def taken(kind: type[Group], settings: dict[str, Any]) -> Group:
    """The options that are the fields of this dataclass, taken out of all of them."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    return kind(**{name: settings.pop(name) for name in names})


def typed() -> dict[str, str]:
    """The parameters of the running command that the user has typed, each with its option."""
    context = click.get_current_context()
    return {
        parameter.name: max(parameter.opts, key=len)
        for parameter in context.command.params
        if parameter.name
        and context.get_parameter_source(parameter.name) == ParameterSource.COMMANDLINE
    }
