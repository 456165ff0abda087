"""Equivalents of the peers' tests (tests/peers), and the table of them in docs/partners.md."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.peers.suite import Case
from tests.peers.table import CASES, differences

PAGE = Path(__file__).resolve().parents[2] / "docs" / "partners.md"


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.suite}-{case.figure.__name__}")
def test_within_the_peers_own_bound(case: Case) -> None:
    if case.missing:
        pytest.skip(f"{', '.join(case.missing)} is not installed")
    assert case.figure() <= case.tolerance, case.tests


def test_the_page_has_these_rows() -> None:
    assert differences(PAGE.read_text("utf-8")) == []


def test_differences_are_found() -> None:
    page = PAGE.read_text("utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| Theia | robust_rotation"))
    assert len(differences(page.replace(row, ""))) == 1
    worse = " | ".join([*row.split(" | ")[:-1], "99 |"])
    assert differences(page.replace(row, worse))[0].startswith("beyond its bound")
