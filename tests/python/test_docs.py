"""The pages of docs/: their programs run as printed, and the index names every page."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from rotavg.cli.main import commands

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md"))
NEEDS = {
    "conventions.md": ("scipy",),
    "gallery.md": ("matplotlib", "scipy"),
    "partners.md": ("gtsam", "pycolmap", "networkx", "scipy", "pandas"),
    "plots.md": ("matplotlib", "scipy"),
    "report.md": ("plotly", "jinja2"),
    "tutorial.md": ("matplotlib",),
}
SCRIPTS = {"distributed.md": ("distributed", "pymetis", "scipy")}  # run by other processes
MAKES = {
    "gallery.md": "gallery-noise.png",
    "plots.md": "plots.png",
    "report.md": "report.html",
    "tutorial.md": "residuals.png",
}
# Options of other programs, or of all commands.
OF_OTHERS = {"--load", "--help", "--version", "--from-sdist"}
# Photographs are not made up quickly: test_examples.py runs much the same program.
ELSEWHERE = {"photographs.md"}


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text("utf-8"), re.DOTALL)


def programs(page: str) -> list[str]:
    return blocks(DOCS / page, "python")


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


def test_the_tutorial_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What stands in a comment behind a print is what it prints."""
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {}
    for program in programs("tutorial.md"):
        exec(compile(program, "tutorial.md", "exec"), names)
        printed = capsys.readouterr().out
        for said in re.findall(r"^print\(.*\)  # (\S+)$", program, re.MULTILINE):
            assert said in printed.split(), said


def test_the_tutorials_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = blocks(DOCS / "tutorial.md", "sh")
    for line in block.splitlines():
        done = CliRunner().invoke(commands, shlex.split(line)[1:])
        assert done.exit_code == 0, f"{line}: {done.output}"


@pytest.mark.parametrize("page", [ROOT / "README.md", *(DOCS / page for page in PAGES)], ids=str)
def test_commands_and_options_exist(page: Path) -> None:
    """In shell blocks, and of tables that have a column for the command line."""
    for block in blocks(page, "sh"):
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            if words[:1] == ["rotavg"] and words[1] != "completion":
                known = {
                    option
                    for parameter in commands.commands[words[1]].params
                    for option in (*parameter.opts, *parameter.secondary_opts)
                }
                assert {w for w in words[2:] if re.match(r"--?[a-z]", w)} <= known, line
    known = {
        option
        for sub in commands.commands.values()
        for parameter in sub.params
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    said = set(re.findall(r"`(--[a-z][a-z-]+)", page.read_text("utf-8")))
    assert said <= known | OF_OTHERS, said - known


@pytest.mark.parametrize("page", ["report.md", "uncertainty.md", "warm_start.md", "robust.md"])
def test_the_first_commands_of_a_page_run_in_an_empty_folder(page: str, tmp_path: Path) -> None:
    lines = next(iter(blocks(DOCS / page, "sh"))).splitlines()
    script = "\n".join(line for line in lines if not line.startswith("pip "))
    run = f'rotavg() {{ "{sys.executable}" -m rotavg "$@"; }}\n{script}\n'
    done = subprocess.run(
        ["bash", "-e"], input=run, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_the_index_names_every_page_and_links_lead_somewhere() -> None:
    index = (DOCS / "README.md").read_text("utf-8")
    named = set(re.findall(r"\]\((\w[\w/]*\.md)\)", index))
    assert named == set(PAGES) - {"README.md"}
    for page in PAGES:
        text = (DOCS / page).read_text("utf-8")
        text = re.sub(r"\$.*?\$", "", text)  # of an equation
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert ((DOCS / page).parent / target).exists(), f"{page}: {target}"


def test_anchors_are_headings() -> None:
    """A link to a place on a page, as GitHub and the site name it."""
    for page in PAGES:
        for target, anchor in re.findall(
            r"\]\(([\w./-]*?\.md)?#([^)]+)\)", (DOCS / page).read_text("utf-8")
        ):
            there = (DOCS / page).parent / target if target else DOCS / page
            headings = re.findall(r"^#+ (.*)$", there.read_text("utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
            assert anchor in slugs, f"{page}: {target}#{anchor}"
