"""The examples run, and say what they should."""

from __future__ import annotations

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rotavg

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run(name: str, *arguments: str, cwd: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", str(EXAMPLES / name), *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_arrays_in_ten_lines(tmp_path: Path) -> None:
    lines = run("ten_lines.py", cwd=tmp_path).splitlines()
    assert lines[-1] == "proved"
    angles = [float(line.split()[1]) for line in lines[:4]]
    assert angles[0] == 0
    np.testing.assert_allclose(np.abs(angles[1:]), [90, 180, 90], atol=1.5)
    assert list(tmp_path.iterdir()) == []


def test_slam_with_g2o(tmp_path: Path) -> None:
    pytest.importorskip("scipy", reason="scipy is not installed")
    out = run("slam_g2o.py", cwd=tmp_path)
    assert "proved globally optimal" in out
    solved = rotavg.read(tmp_path / "solved.g2o")
    rows = [line.split()[1:] for line in (tmp_path / "solved.g2o").read_text().splitlines()[:400]]
    found = np.array(rows, dtype=float)[:, 1:4]
    # All poses fit together: a sphere of radius 10, wherever it is.
    centre = np.linalg.lstsq(
        np.column_stack([2 * found, np.ones(400)]), (found**2).sum(axis=1), rcond=None
    )[0][:3]
    np.testing.assert_allclose(np.linalg.norm(found - centre, axis=1), 10, atol=1)
    assert solved.num_edges == rotavg.read(tmp_path / "sphere.g2o").num_edges
    again = run("slam_g2o.py", "sphere.g2o", "other.g2o", cwd=tmp_path)
    assert "wrote other.g2o" in again
    assert (tmp_path / "other.g2o").read_bytes() == (tmp_path / "solved.g2o").read_bytes()


def test_a_robust_run(tmp_path: Path) -> None:
    out = run("robust_run.py", cwd=tmp_path)
    errors = [float(found) for found in re.findall(r"median error ([\d.]+) deg", out)]
    assert errors[1] < 1 < errors[0]
    there = re.search(r"(\d+) outliers found, (\d+) of the (\d+) there are", out)
    assert there is not None
    found, right, all_of_them = map(int, there.groups())
    assert right >= 0.97 * all_of_them
    assert found <= 1.03 * all_of_them
    assert len((tmp_path / "edges.csv").read_text().splitlines()) > 1000


def test_photographs_with_colmap(tmp_path: Path) -> None:
    pytest.importorskip("cv2", reason="OpenCV is not installed")
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    from photographs import FOCAL, room_folder

    room_folder(tmp_path / "room")
    out = run("photographs.py", "room", str(FOCAL), cwd=tmp_path)
    assert "4 images" in out
    assert rotavg.read(tmp_path / "graph.npz").num_nodes == 4


@pytest.mark.parametrize("notebook", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_those_of_the_pages_and_run(
    notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("scipy")
    made = runpy.run_path(str(EXAMPLES / "notebooks.py"))
    page = EXAMPLES.parent / made["PAGES"][notebook.stem]
    text = notebook.read_text("utf-8")
    assert text == made["notebook"](page), "python examples/notebooks.py writes it anew"
    content = json.loads(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {}
    for cell in content["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            exec(compile(source, notebook.name, "exec"), names)
        else:
            for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", source):
                assert (EXAMPLES / target).exists(), target
