"""Nothing public comes or goes by accident: docs/stability.md and public_api.py."""

from __future__ import annotations

import difflib
import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

import public_api
import rotavg

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ADVICE = "python tests/python/public_api.py writes the list anew; say it in CHANGELOG.md, too"


def check(name: str, found: str) -> None:
    listed = (HERE / name).read_text("utf-8")
    changes = difflib.unified_diff(
        listed.splitlines(), found.splitlines(), "listed", "found", lineterm="", n=0
    )
    assert found == listed, "\n".join([ADVICE, *changes])


def test_python_and_the_command_line_are_as_listed() -> None:
    check("public_api.txt", public_api.python_text())


@pytest.mark.skipif(shutil.which("doxygen") is None, reason="doxygen is not installed")
@pytest.mark.skipif(find_spec("sphinx") is None, reason="Sphinx is not installed")
def test_cpp_is_as_listed(tmp_path: Path) -> None:
    check("public_api_cpp.txt", public_api.cpp_text(tmp_path))


def test_the_lists_hold_what_the_readme_uses() -> None:
    listed = (HERE / "public_api.txt").read_text("utf-8").splitlines()
    readme = (ROOT / "README.md").read_text("utf-8")
    for block in re.findall(r"```python\n(.*?)```", readme, re.DOTALL):
        for name in re.findall(r"rotavg\.([\w.]+)\(", block):
            started = (f"rotavg.{name}(", f"rotavg.{name}.")  # or, of a dataclass, its fields
            assert any(line.startswith(started) for line in listed), name


def test_the_version_stands_in_one_place_and_the_rest_follows() -> None:
    assert f'version: "{rotavg.__version__}"' in (ROOT / "packaging/conda/recipe.yaml").read_text()
    header = (ROOT / "cpp/include/rotavg/version.hpp").read_text()
    parts = re.findall(r"ROTAVG_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", header)
    assert ".".join(parts) == rotavg.__version__
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    versions = re.findall(r"^## \[([\d.]+)\]", changelog, re.MULTILINE)
    assert rotavg.__version__ in versions
