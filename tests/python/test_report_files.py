"""Reports as files: the command that writes them, and what they must not replace."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

import rotavg
from report_pages import Text
from rotavg import report
from test_cli import run


def test_the_command_writes_a_report_that_says_how_to_repeat_it(tmp_path: Path) -> None:
    graph = tmp_path / "my graph.g2o"
    rotavg.write(graph, rotavg.simulate("sphere", 100, noise=0.1, seed=1).graph)
    page = tmp_path / "out.html"
    done = run("solve", graph, "--report", page, "--certificate-seed", "7", "--json")
    assert done.returncode == 0
    assert done.stderr == ""
    assert json.loads(done.stdout)["solved"]
    text = Text(page.read_text(encoding="utf-8"))
    command = text.of("code")[0]
    assert command == f"rotavg solve '{graph}' --report {page} --certificate-seed 7 --json"
    cells = dict(zip(text.of("th"), text.of("td")[-len(text.of("th")) :]))
    assert cells["--certificate-seed"] == "7"
    assert cells["--method"] == "auto"
    assert re.search(r"SHA-256 [0-9a-f]{64}$", cells["input"])
    assert float(cells["read"].removesuffix(" s")) > 0
    done = run("solve", graph, "--report", tmp_path / "out.html")  # replaces it
    assert done.returncode == 0
    assert f"wrote {tmp_path / 'out.html'}" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--report", "out.g2o"], "out.g2o: the name of a report ends in .html"),
        (["--report", "graph.html"], "would replace another file of this run"),
        (["--report", "./link.html"], "would replace another file of this run"),
        (["--report", "x.html", "-o", "x.html"], "formats that are written"),
        (["--report", "no/folder/x.html"], "no/folder/x.html: cannot be written: there is no"),
        (["--report", "folder.html"], "cannot be written: it is a folder"),
    ],
)
def test_a_report_replaces_nothing_it_should_not(
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    rotavg.write(tmp_path / "g.g2o", rotavg.simulate("cycle", 5, noise=0.1, seed=1).graph)
    (tmp_path / "g.g2o").rename(tmp_path / "graph.html")  # recognised by its content
    (tmp_path / "link.html").symlink_to("graph.html")
    (tmp_path / "folder.html").mkdir()
    before = {path: path.is_file() and path.read_bytes() for path in tmp_path.iterdir()}
    done = run("solve", "graph.html", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert {path: path.is_file() and path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("module", ["plotly.graph_objects", "jinja2"])
def test_without_the_extra_it_is_named_before_the_work(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved = rotavg.solve(rotavg.simulate("cycle", 5, noise=0.1, seed=1).graph)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(rotavg.MissingExtraError, match=r"rotavg\[report\]"):
        report.check_report(tmp_path / "out.html")
    with pytest.raises(rotavg.MissingExtraError, match=r"rotavg\[report\]"):
        report.write_report(tmp_path / "out.html", solved)
    assert list(tmp_path.iterdir()) == []
