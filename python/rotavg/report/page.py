"""The page: all parts put together in one HTML document that needs no network."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from rotavg import _core
from rotavg.base.errors import FormatError, require
from rotavg.io import atomic
from rotavg.report import charts, robust, tables
from rotavg.report.space import space
from rotavg.report.verdict import statement
from rotavg.solving.diagnosis import diagnose
from rotavg.solving.kept import median_high_largest
from rotavg.solving.printed import OF_COVARIANCES
from rotavg.solving.solution import Solution

SUFFIXES = (".html", ".htm")


@dataclass(frozen=True)
class Run:
    """How a solution was made: what the last section of the page says, so that it can be repeated.

    Attributes:
        command: the command line or the call.
        input: the file (or folder) that the graph was read from.
        settings: what was asked for, by name.
        seconds: further wall-clock times by name, such as that of reading.
    """

    command: str = ""
    input: Path | None = None
    settings: Mapping[str, object] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


def write_report(
    path: str | os.PathLike[str], solution: Solution, run: Run | None = None, *, title: str = ""
) -> None:
    """Write the report on a solution as one HTML page, all at once or not at all.

    Args:
        path: a file named .html; it is replaced if it is there.
        solution: what to report on.
        run: how it was made, for the section that tells how to repeat it.
        title: of the page; the input's name by default.

    Raises:
        MissingExtraError: Plotly or Jinja is not installed (the extra [report]).
        FileAccessError: the file cannot be written; what was there before is untouched.
        FormatError: the name does not end in .html.
    """
    check_report(path)
    atomic.write_files({Path(path): html(solution, run, title=title).encode()})


def check_report(path: str | os.PathLike[str]) -> None:
    """Raise what `write_report` would raise, as far as it can be told before the work."""
    path = Path(path)
    for module in ("plotly.graph_objects", "jinja2"):
        require(module, "report")
    if path.suffix.lower() not in SUFFIXES and not (path.exists() and not path.is_file()):
        raise FormatError("the name of a report ends in .html", path=path)
    atomic.check_writable(path)


def html(solution: Solution, run: Run | None = None, *, title: str = "") -> str:
    """The report on a solution as an HTML document; arguments and errors as in `write_report`."""
    run = run or Run()
    jinja2 = require("jinja2", "report")
    markup = require("markupsafe", "report").Markup
    scene, scene_said = space(solution)
    figures = {
        "space": scene,
        "residuals": charts.residuals(solution),
        "convergence": charts.convergence(solution),
        "adjacency": charts.adjacency(solution),
    }
    if solution.robust is not None:
        figures["weights"] = robust.weights(solution)
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_part), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["figure"] = _figure
    known = solution.known_covariances
    diagnosis = diagnose(solution)
    page = environment.get_template("page.html").render(
        title=title or (run.input.name if run.input else "solution"),
        statement=statement(solution),
        facts=_facts(solution),
        space_said=scene_said,
        robust=robust.robust_section(solution),
        of_kept="" if solution.robust is None else " of the edges that were kept",
        tables={
            "edges": tables.worst_edges(solution),
            **{f"{k}s": tables.shares(diagnosis, k) for k in ("node", "frame", "sensor")},
            "uncertainty": None if known is None else tables.uncertainty(solution, known),
            "components": tables.components(solution) if solution.num_components > 1 else None,
        },
        notes=solution.graph.notes,
        run=run,
        settings=_settings(solution, run),
        seconds=_seconds(solution, run),
        versions=f"rotavg {_core.__version__}, NumPy {np.__version__}, "
        f"Python {platform.python_version()}, {platform.platform()}",
        # Within a script element only "<" could end it; within JSON it is found in strings alone.
        figures=markup(_json(figures).replace("<", "\\u003c")),
        plotly=markup(require("plotly.offline", "report").get_plotlyjs()),
    )
    return str(page)


def _part(name: str) -> str:
    return resources.files("rotavg.report").joinpath(name).read_text(encoding="utf-8")


def _json(figures: Mapping[str, Any]) -> str:
    parts = []
    for name, figure in figures.items():
        figure.update_layout(template="none")  # the page has its own, light and dark
        parts.append(f'"{name}": {figure.to_json()}')
    return "{" + ",\n".join(parts) + "}"


def _figure(value: object) -> str:
    """A number for people: four digits, whole numbers whole."""
    if isinstance(value, float):
        return f"{value + 0.0:.4g}"
    return str(value)


def _facts(solution: Solution) -> list[tuple[str, str]]:
    median, high, largest = median_high_largest(solution)
    outliers, kept = [], ""
    if solution.robust is not None:
        kept = ", edges kept"
        outliers.append(("outliers", f"{int(solution.is_outlier.sum())}"))
    return [
        ("nodes", f"{solution.graph.num_nodes}"),
        ("edges", f"{solution.graph.num_edges}"),
        *outliers,
        ("components", f"{solution.num_components}"),
        (f"median residual{kept}", f"{median:.3g}°"),
        (f"95 % below{kept}", f"{high:.3g}°"),
        (f"largest{kept}", f"{largest:.3g}°"),
        ("weighted objective" if outliers else "objective", f"{solution.objective:.6g}"),
        ("time", f"{solution.timings.total:.3g} s"),
    ]


def _settings(solution: Solution, run: Run) -> list[tuple[str, str]]:
    rows = [
        ("status", str(solution.status)),
        ("method", solution.reason or solution.method),
        ("start", solution.init),
        ("iterations", f"{solution.iterations}"),
        ("objective", f"{solution.objective:.15g}{OF_COVARIANCES[solution.anisotropic]}"),
        ("gradient", f"{solution.gradient_norm:.2g}, relative {solution.relative_gradient:.2g}"),
    ]
    if solution.certificate is not None:
        rows += [
            ("lambda_min", f"{solution.certificate.lambda_min + 0.0:.2g}"),
            ("certificate by", solution.certificate.method),
        ]
    if run.input is not None and run.input.is_file():
        data = run.input.read_bytes()
        rows.append(
            ("input", f"{run.input}, {len(data)} bytes, SHA-256 {hashlib.sha256(data).hexdigest()}")
        )
    elif run.input is not None:
        rows.append(("input", str(run.input)))
    options = (
        (name if name.startswith("-") else f"option {name}", _default_or(value))
        for name, value in run.settings.items()
    )
    return [*rows, *options]


def _default_or(value: object) -> str:
    return "default" if value is None else str(value)


def _seconds(solution: Solution, run: Run) -> list[tuple[str, str]]:
    timings = solution.timings
    own = {"initial value": timings.init, "solve": timings.solve, "certify": timings.certify}
    return [(name, f"{value:.3g} s") for name, value in {**run.seconds, **own}.items()]
