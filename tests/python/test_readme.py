"""The README's programs run, and print what it says."""

from __future__ import annotations

import re
import shutil
import subprocess
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
    rotavg.write("sphere.g2o", rotavg.simulate("sphere", 64, noise=0.1, seed=1).graph)
    first, *others = python_blocks()
    names: dict[str, object] = {}
    exec(first, names)
    assert capsys.readouterr().out.endswith("(4, 3, 3) proved\n")
    for block in others:
        exec(block, names)
    assert (tmp_path / "solved.g2o").is_file()


def cpp_programs() -> list[str]:
    """Those of the README, and what stands in a function of a page as such."""
    programs = re.findall(r"```cpp\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    page = README.parent / "docs" / "formats.md"
    (part,) = re.findall(r"```cpp\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    headers = ("io/node_table.hpp", "io/text.hpp", "rotavg.hpp")
    includes = "".join(f"#include <rotavg/{header}>\n" for header in headers)
    return [*programs, f"{includes}int main() {{\n{part}}}\n"]


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
@pytest.mark.parametrize("program", cpp_programs())
def test_the_cpp_programs_compile(program: str) -> None:
    eigen = Path("/usr/include/eigen3")
    if not eigen.is_dir():
        pytest.skip(f"Eigen is not in {eigen}")
    command = ["g++", "-std=c++17", "-fsyntax-only", "-Wall", "-Wextra", "-DROTAVG_COMPILED"]
    command += [f"-I{README.parent}/cpp/include", f"-isystem{eigen}", "-xc++", "-"]
    done = subprocess.run(command, input=program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
