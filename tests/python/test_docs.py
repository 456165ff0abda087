"""The pages of docs/: their programs run as printed, and the index names every page."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted(page.name for page in DOCS.glob("*.md"))
NEEDS = {
    "partners.md": ("gtsam", "pycolmap", "networkx", "scipy"),
    "plots.md": ("matplotlib", "scipy"),
    "report.md": ("plotly", "jinja2"),
}
SCRIPTS = {"distributed.md": ("distributed", "pymetis", "scipy")}  # run by other processes
MAKES = {"plots.md": "plots.png", "report.md": "report.html"}
# Photographs are not made up quickly: test_examples.py runs much the same program.
ELSEWHERE = {"photographs.md"}


def programs(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)


@pytest.mark.parametrize("page", [page for page in PAGES if programs(page)])
def test_the_programs_run_as_printed(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if page in ELSEWHERE:
        pytest.skip("its program needs photographs")
    for module in NEEDS.get(page, ()):
        pytest.importorskip(module, reason=f"{module} is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    if page in SCRIPTS:
        for module in SCRIPTS[page]:
            pytest.importorskip(module, reason=f"{module} is not installed")
        for program in programs(page):
            (tmp_path / "program.py").write_text(program, "utf-8")
            done = subprocess.run(
                [sys.executable, "program.py"], capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr
        return
    names: dict[str, object] = {}  # of one page: later programs go on from earlier ones
    for program in programs(page):
        exec(compile(program, page, "exec"), names)
    if page in MAKES:
        assert (tmp_path / MAKES[page]).stat().st_size > 10_000


def test_partners_need_no_other_program() -> None:
    """Each of its programs is for somebody else, so that each has its own imports."""
    for program in programs("partners.md"):
        assert "import rotavg" in program


def test_the_index_names_every_page_and_links_lead_somewhere() -> None:
    index = (DOCS / "README.md").read_text("utf-8")
    assert set(re.findall(r"\]\((\w+\.md)\)", index)) == set(PAGES) - {"README.md"}
    for page in PAGES:
        text = (DOCS / page).read_text("utf-8")
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert (DOCS / target).exists(), f"{page}: {target}"
