"""The paper's experiments (Dong, Xie and Shi 2021), each in a module of its own.

A further one is one more module with an `Experiment` in it, listed here.
"""

from __future__ import annotations

from pathlib import Path

from rotavg.base.json_text import json_text
from rotavg.io import atomic
from rotavg.reproduce import fig2, fig3, fig4, fig5, table1, table2
from rotavg.reproduce.experiment import Experiment, Outcome, Settings

__all__ = ["EXPERIMENTS", "Experiment", "Outcome", "Settings", "write"]

EXPERIMENTS: dict[str, Experiment] = {
    module.EXPERIMENT.name: module.EXPERIMENT for module in (table1, table2, fig2, fig3, fig4, fig5)
}


def write(folder: Path, experiment: Experiment, outcome: Outcome) -> list[Path]:
    """Write an outcome into a folder: NAME.md, NAME.json, and NAME.png and NAME.pdf of a figure.

    Returns what was written. Raises FileAccessError if that cannot be.
    """
    head = f"# {experiment.title}\n\n"
    if outcome.pictures:
        head += f"![{experiment.title}]({experiment.name}.png)\n\n"
    files = {
        "md": (head + outcome.markdown).encode(),
        "json": (json_text(outcome.data) + "\n").encode(),
        **outcome.pictures,
    }
    named = {folder / f"{experiment.name}.{suffix}": data for suffix, data in files.items()}
    atomic.write_files(named)
    return list(named)
