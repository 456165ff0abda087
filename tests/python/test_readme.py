"""The README's programs run, and print what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rotavg

README = Path(__file__).resolve().parents[2] / "README.md"


def python_blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def test_the_python_programs_run_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rotavg.write("torus3D.g2o", rotavg.simulate("grid", 64, noise=0.1, seed=1).graph)
    first, *others = python_blocks()
    names: dict[str, object] = {}
    exec(first, names)
    assert capsys.readouterr().out.endswith("(4, 3, 3) proved\n")
    for block in others:
        exec(block, names)
    assert (tmp_path / "solved.g2o").is_file()
