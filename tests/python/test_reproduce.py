"""The paper's experiments, on sizes that take no time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from rotavg.reproduce import EXPERIMENTS, Outcome, Settings
from rotavg.reproduce.published import TABLE_1, Setting


def outcome(name: str, **settings: Any) -> Outcome:
    return EXPERIMENTS[name].run(Settings(**settings))


def command(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rotavg", "reproduce", *arguments],
        capture_output=True, text=True, cwd=cwd, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def table1() -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = outcome("table1", sizes=(9,), runs=3, seed=5).data["rows"]
    return rows


def test_every_answer_of_table1_is_optimal(table1: list[dict[str, Any]]) -> None:
    assert [(r["phi"], r["p"]) for r in table1] == [(0.2, 0), (0.2, 0.3), (0.5, 0), (0.5, 0.3)]
    for row in table1:
        assert list(row["here"]) == ["BCDSR", "BCD", "SUM", "SUM, adaptive µ"]
        for found in row["here"].values():
            assert found["runs"] == found["certified"] == found["converged"] == 3
            assert abs(found["lambda_min"]) < 1e-9
            assert found["objective_difference"] < 1e-9
            assert found["relaxed_difference"] < 1e-9
            assert found["seconds"] > 0


def test_the_errors_of_table1_are_what_the_definitions_say(table1: list[dict[str, Any]]) -> None:
    for row in table1:
        errors, squares = [], []
        for seed in (5, 6, 7):
            graph = rotavg.simulate("complete", 9, noise=row["phi"], drop=row["p"], seed=seed).graph
            assert graph.num_edges == 36 - round(row["p"] * 36)
            R = rotavg.solve(graph).rotations
            i, j = graph.indices.T
            residuals = np.linalg.norm(R[i] @ graph.rotations - R[j], axis=(1, 2))
            errors.append(residuals.mean())
            squares.append((residuals**2).mean())
        for found in row["here"].values():
            assert found["error"] == pytest.approx(np.mean(errors), rel=1e-6)
            assert found["squared_error"] == pytest.approx(np.mean(squares), rel=1e-6)
            spread = np.std(errors, ddof=1) / np.sqrt(3)
            assert found["error_standard_error"] == pytest.approx(spread, rel=1e-6)


def test_the_same_seed_gives_the_same_table() -> None:
    def without_times(seed: int) -> str:
        rows = outcome("table1", sizes=(6,), runs=1, seed=seed).data["rows"]
        for row in rows:
            for found in row["here"].values():
                del found["seconds"], found["each"][0]["seconds"]
        return json.dumps(rows)

    assert without_times(1) == without_times(1)
    assert without_times(1) != without_times(2)


def test_the_papers_rows_stand_beside_ours() -> None:
    result = outcome("table1", sizes=(20,), runs=1)
    for row in result.data["rows"]:
        printed = TABLE_1[Setting(row["n"], row["phi"], row["p"])]
        assert row["paper"]["BCD"]["error"] == printed["BCD"].error
        assert f"{printed['BCDSR'].error:.4f}" in result.markdown
    # The noise that the paper calls 0.2 is one of 0.2 rad standard deviation, not variance.
    small, large = (row["here"]["BCD"]["error"] for row in result.data["rows"][::2])
    assert small == pytest.approx(0.224, abs=0.03)
    assert large == pytest.approx(0.550, abs=0.07)


def test_what_takes_long_is_announced_with_its_time() -> None:
    notes: list[str] = []
    result = outcome("table1", sizes=(201,), runs=1, slow=True, note=notes.append)
    assert len(notes) == 1
    assert notes[0].startswith("BCDSR at n = 201: 0.0029 GB, about 10 sweeps of ")
    assert all("BCDSR" in row["here"] for row in result.data["rows"])
    result = outcome("table1", sizes=(201,), runs=1)
    assert all("BCDSR" not in row["here"] for row in result.data["rows"])
    assert "| – |" in result.markdown


def test_fig2_falls_to_the_optimum_from_every_start() -> None:
    result = outcome("fig2", sizes=(12,))
    curves = result.data["curves"]
    assert len(curves) == 3 * 6
    for curve in curves:
        assert (np.diff(curve["objective"]) <= 1e-9).all()
        assert (np.diff(curve["seconds"]) >= 0).all()
        assert curve["objective"][-1] == pytest.approx(result.data["optimum"], rel=1e-9)
        assert len(curve["objective"]) == len(curve["seconds"])


def test_fig3_tells_the_objective_of_the_relaxation_from_f() -> None:
    for course in outcome("fig3", sizes=(10,)).data["graphs"]:
        assert (np.diff(course["relaxed"]) <= 1e-9).all()
        assert course["relaxed"][-1] == pytest.approx(1, abs=1e-6)
        iterations, rounded = zip(*course["rounded"])
        assert iterations[0] == 0
        assert iterations[-1] == len(course["relaxed"]) - 1
        assert min(rounded) > 1 - 1e-9  # f of rotations, never below f*
        assert rounded[-1] == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("n", [3, 8])
def test_fig5_holds_without_noise(n: int) -> None:
    for graph in outcome("fig5", sizes=(n,)).data["graphs"]:
        assert graph["objective"] < 1e-24
        assert graph["distance_from_truth"] < 1e-13
        assert graph["distance_from_shortest_paths"] < 1e-13


@pytest.mark.parametrize("name", ["fig2", "fig3", "fig5"])
def test_figures_are_pictures(name: str) -> None:
    pictures = outcome(name, sizes=(6,)).pictures
    assert pictures["png"].startswith(b"\x89PNG")
    assert pictures["pdf"].startswith(b"%PDF")
    if name == "fig5":  # no times in it
        assert outcome(name, sizes=(6,)).pictures == pictures


def test_tables_need_no_matplotlib_and_figures_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    outcome("table1", sizes=(5,), runs=1)
    with pytest.raises(rotavg.MissingExtraError, match=r'pip install "rotavg\[plot\]"'):
        outcome("fig5")


def test_the_command_writes_tables_pictures_and_json(tmp_path: Path) -> None:
    done = command("table1", "fig5", "--sizes", "6", "--runs", "1", "-o", "a/b", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "| 6 | 0.5 | 0.3 | 1 |" in done.stdout
    names = sorted(path.name for path in (tmp_path / "a" / "b").iterdir())
    assert names == ["fig5.json", "fig5.md", "fig5.pdf", "fig5.png", "table1.json", "table1.md"]
    assert "fig5.png" in (tmp_path / "a" / "b" / "fig5.md").read_text(encoding="utf-8")

    done = command("fig5", "--json", "--sizes", "6", cwd=tmp_path)
    assert done.stderr == ""
    assert json.loads(done.stdout) == {
        "fig5": json.loads((tmp_path / "a" / "b" / "fig5.json").read_text(encoding="utf-8"))
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing argument 'WHAT...'"),
        (["fig1"], "'fig1' is not one of 'table1'"),
        (["table1", "--sizes", "20,x"], "found '20,x', expected numbers from 3"),
        (["table1", "--sizes", "2"], "found '2'"),
        (["table1", "--sizes", "20,9999"], "found '20,9999'"),
        (["table1", "--sizes", ""], "found ''"),
        (["table1", "--runs", "0"], "0 is not in the range"),
        (["fig5", "-o", "file"], "file: cannot be made a folder"),
        (["fig5", "-o", "file/below"], "cannot be made a folder"),
    ],
)
def test_bad_usage_is_exit_status_2(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = command(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
