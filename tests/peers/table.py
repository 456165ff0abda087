"""The table of peers' tests in docs/partners.md.

    python -m tests.peers.table                          # run all, print the table
    python -m tests.peers.table --check docs/partners.md # whether the page has these rows

Exit status 1 if a figure is beyond its tolerance, or the page has other rows.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from tests.peers import averaging_cases, colmap_cases, gtsam_cases, robot_cases, vision_cases
from tests.peers.left_out import LEFT_OUT
from tests.peers.suite import CASES, Case

# Whose imports list the cases.
_MODULES = (averaging_cases, colmap_cases, gtsam_cases, robot_cases, vision_cases)
_ORDER = ("COLMAP", "GLOMAP", "GTSAM", "Theia", "GraphOptim", "OpenMVG", "GTSFM", "DPGO", "SE-Sync")


def _place(suite: str) -> int:
    return _ORDER.index(suite) if suite in _ORDER else len(_ORDER)


def asked(case: Case) -> str:
    """The first three cells of a row."""
    bound = "must hold" if case.tolerance == 0 else f"{case.tolerance:.3g} {case.unit}".strip()
    return f"| {case.suite} | {case.tests} | {bound} |"


def rows(figures: dict[str, str]) -> list[str]:
    """The lines of both tables, with the figures by the rows that they are of."""
    lines = ["| suite | tests | bound | rotavg |", "|---|---|---|---|"]
    for case in sorted(CASES, key=lambda c: _place(c.suite)):
        lines.append(f"{asked(case)} {figures[asked(case)]} |")
    lines += ["", "| suite | left out | why |", "|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in sorted(LEFT_OUT, key=lambda r: _place(r[0]))]
    return lines


def figure_of(case: Case) -> tuple[str, bool]:
    """What to print of a case, and whether it is within its tolerance."""
    if case.missing:
        return f"not run: {', '.join(case.missing)} not installed", True
    figure = case.figure()
    if case.tolerance == 0:
        return ("holds" if figure == 0 else "**does not hold**"), figure == 0
    return (f"{figure:.2g}" if figure >= 1e-300 else "0"), figure <= case.tolerance


def main() -> None:
    """Run and print, or check a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", type=Path, metavar="PAGE")
    arguments = parser.parse_args()
    if arguments.check is not None:
        wrong = differences(arguments.check.read_text("utf-8"))
        print("\n".join(wrong) or f"{arguments.check}: all {len(CASES)} rows are there")
        sys.exit(1 if wrong else 0)
    figures, good = {}, True
    for case in CASES:
        figures[asked(case)], within = figure_of(case)
        good &= within
    print("\n".join(rows(figures)))
    sys.exit(0 if good else 1)


def differences(page: str) -> list[str]:
    """Rows that a page lacks, or has of nothing, and figures on it beyond their bounds."""
    wrong = []
    for case in CASES:
        found = re.search(re.escape(asked(case)) + r" ([^|]*) \|", page)
        if found is None:
            wrong.append(f"not on the page: {asked(case)}")
        elif case.tolerance > 0 and not float(found[1]) <= case.tolerance:
            wrong.append(f"beyond its bound: {found[0]}")
        elif case.tolerance == 0 and found[1] != "holds":
            wrong.append(f"does not hold: {found[0]}")
    wrong += [f"not on the page: {row}" for row in LEFT_OUT if f"| {' | '.join(row)} |" not in page]
    return wrong


if __name__ == "__main__":
    main()
