"""Results as a table for a paper."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rotavg.base.errors import GraphError
from rotavg.evaluation.compare import compare
from rotavg.evaluation.known import Rotations
from rotavg.solving.solution import Solution

_SPECIAL = str.maketrans(
    {
        **{c: f"\\{c}" for c in "&%$#_{}"},
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "\\": r"\textbackslash{}",
    }
)


def latex_table(
    solutions: Mapping[str, Solution], reference: Rotations | None = None, *, digits: int = 4
) -> str:
    """Solutions side by side, as a LaTeX `tabular` with the rules of the package booktabs.

    A row for each: its name, iterations, the seconds of starting and iterating, the objective, the
    bound on its relative distance from the optimum, and the verdict; with a reference, median and
    mean error in degrees as well (`rotavg.compare`).

    Args:
        solutions: by the names that the rows get.
        reference: known rotations, anything that `rotavg.compare` takes.
        digits: significant ones, of the objective and the errors.

    Raises GraphError if there are no solutions, or where the reference does not fit.
    """
    if not solutions:
        raise GraphError("there are no solutions to make a table of")
    head = ["", "iterations", "time [s]", "objective", "relative gap", "verdict"]
    if reference is not None:
        head += ["median [deg]", "mean [deg]"]
    rows = []
    for name, solution in solutions.items():
        certificate = solution.certificate
        gap = "--" if certificate is None else _power(certificate.relative_gap)
        verdict = "--" if certificate is None else str(certificate.verdict).replace("_", " ")
        seconds = solution.timings.init + solution.timings.solve
        row = [
            name.translate(_SPECIAL),
            str(solution.iterations),
            f"{seconds:.2g}",
            f"{solution.objective:.{digits}g}",
            gap,
            verdict,
        ]
        if reference is not None:
            errors = compare(solution, reference)
            row += [f"{np.degrees(e):.{digits}g}" for e in (errors.median, errors.mean)]
        rows.append(row)
    lines = [" & ".join(row) + r" \\" for row in (head, *rows)]
    return "\n".join(
        [
            rf"\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}",
            r"\toprule",
            lines[0],
            r"\midrule",
            *lines[1:],
            r"\bottomrule",
            r"\end{tabular}",
        ]
    )


def _power(value: float) -> str:
    """A small number as LaTeX writes it: $3.2 \\cdot 10^{-7}$."""
    if not math.isfinite(value):
        return "--"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    return rf"${value / 10.0**exponent:.1f} \cdot 10^{{{exponent}}}$"
