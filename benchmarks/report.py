"""Tables for the terminal and for README.md."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from benchmarks.compare import GraphResult, Settings
from benchmarks.summary import cells, header, rows, title

README = Path(__file__).with_name("README.md")
_BEGIN, _END = "<!-- figures: begin -->", "<!-- figures: end -->"
_TEXT_COLUMNS = ("solver", "its own verdict", "rotavg's verdict")
_VERDICT = header(several_threads=False).index("rotavg's verdict")
_ROBUST_NOTE = "* minimises a robust cost: its distance from f* says nothing against it."
_VERDICT_STYLES = {"proved": "green", "estimated": "green", "not_certified": "red"}


def print_table(console: Console, result: GraphResult) -> None:
    """The rows of one graph."""
    several = len({run.threads for run in result.runs}) > 1
    table = Table(title=Text(title(result)), title_justify="left", title_style="bold")
    for name in header(several):
        if name in _TEXT_COLUMNS:
            table.add_column(name, overflow="fold", no_wrap=name == "solver")
        else:
            table.add_column(name, justify="right", no_wrap=True)
    for row in rows(result):
        texts = [Text(text) for text in cells(row, several)]
        texts[_VERDICT].style = _VERDICT_STYLES.get(row.verdict, "")
        table.add_row(*texts)
    console.print(table)


def print_notes(console: Console, refused: Mapping[str, str]) -> None:
    """What the tables do not say."""
    console.print(_ROBUST_NOTE)
    for name, reason in refused.items():
        console.print(f"{name} was not measured: {reason}", markup=False)


def rewrite_readme(
    results: Sequence[GraphResult],
    *,
    machine: Mapping[str, Any],
    versions: Mapping[str, str],
    settings: Settings,
    refused: Mapping[str, str],
) -> None:
    """Replace the generated part of benchmarks/README.md."""
    text = README.read_text(encoding="utf-8")
    before, _, rest = text.partition(_BEGIN)
    _, _, after = rest.partition(_END)
    threads = ", ".join(map(str, settings.threads))
    parts = [
        f"{machine['time'][:10]}; {machine['processors']} processors {machine['processor']}, "
        f"load {machine['load_average'][0]:.1f} at the start; threads: {threads}; "
        f"medians of {settings.repeat}; limit {settings.timeout:g} s. "
        + ", ".join(f"{name} {version}" for name, version in versions.items())
        + ".",
        *(markdown(result) for result in results),
        _escaped(_ROBUST_NOTE),
        *(f"{name} was not measured: {reason}" for name, reason in refused.items()),
    ]
    block = "\n\n".join(parts)
    README.write_text(f"{before}{_BEGIN}\n\n{block}\n\n{_END}{after}", encoding="utf-8")


def markdown(result: GraphResult) -> str:
    """The table of one graph."""
    several = len({run.threads for run in result.runs}) > 1
    names = header(several)
    rule = ["---" if name in _TEXT_COLUMNS else "---:" for name in names]
    lines = [names, rule, *(cells(row, several) for row in rows(result))]
    table = "\n".join(f"| {' | '.join(map(_escaped, line))} |" for line in lines)
    return f"**{_escaped(title(result))}**\n\n{table}"


def _escaped(text: str) -> str:
    return re.sub(r"([|*])", r"\\\1", text)
