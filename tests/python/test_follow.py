"""`rotavg solve --follow`: edges that come line by line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.cli.main import commands
from rotavg.graph.conventions import quaternions_from_matrices

INFORMATION = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"


def line(i: int, j: int, angle: float) -> str:
    """Of g2o, turned about z."""
    pose = f"0 0 0 0 0 {np.sin(angle / 2)} {np.cos(angle / 2)}"
    return f"EDGE_SE3:QUAT {i} {j} {pose} {INFORMATION}\n"


LINES = [
    "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n",
    line(0, 1, 1.0),
    "\n",
    line(1, 2, 1.1),
    line(2, 0, -2),
]


def test_follow_prints_a_line_for_every_edge(tmp_path: Path) -> None:
    file = tmp_path / "robot.g2o"
    file.write_text("".join(LINES))
    result = CliRunner().invoke(commands, ["solve", "--follow", str(file)])
    assert result.exit_code == 0, result.output
    states = [json.loads(text) for text in result.output.splitlines()]
    assert [(s["step"], s["line"], s["nodes"], s["edges"]) for s in states] == [
        (1, 2, 2, 1),
        (2, 4, 3, 2),
        (3, 5, 3, 3),
    ]
    solution = rotavg.solve(rotavg.read(file))
    assert states[-1]["objective"] == pytest.approx(solution.objective, rel=1e-9)
    assert all(s["certificate"]["verdict"] == "proved" for s in states)
    loose = CliRunner().invoke(commands, ["solve", "--follow", str(file), "--tolerance", "0.5"])
    last = json.loads(loose.output.splitlines()[-1])
    assert last["certificate"]["relative_gap"] <= 0.5
    assert last["certificate"]["verdict"] == "proved"
    for tolerance in ("0", "1"):
        arguments = ["solve", "--follow", str(file), "--tolerance", tolerance]
        refused = CliRunner().invoke(commands, arguments)
        assert refused.exit_code != 0
    # A second closure that agrees with the first to a few per cent moves nothing.
    with file.open("a") as more:
        more.write(line(2, 0, -2.01))
    waits = CliRunner().invoke(commands, ["solve", "--follow", str(file), "--tolerance", "0.5"])
    strict = CliRunner().invoke(commands, ["solve", "--follow", str(file)])
    steps = [json.loads(run.output.splitlines()[-1]) for run in (waits, strict)]
    assert steps[0]["objective"] > steps[1]["objective"] * (1 + 1e-6)


def test_every_line_tells_the_newest_pose(tmp_path: Path) -> None:
    file = tmp_path / "robot.g2o"
    file.write_text("".join(LINES))
    result = CliRunner().invoke(commands, ["solve", "--follow", str(file)])
    states = [json.loads(text) for text in result.output.splitlines()]
    assert [s["rotation"]["node"] for s in states] == [1, 2, 2]
    first, _, last = (np.array(s["rotation"]["xyzw"]) for s in states)
    np.testing.assert_allclose(first, [0, 0, np.sin(0.5), np.cos(0.5)], atol=1e-12)
    solution = rotavg.solve(rotavg.read(file))
    expected = quaternions_from_matrices(solution[0].T @ solution[2])
    assert abs(last @ expected) == pytest.approx(1.0, abs=1e-12)


def test_trusted_edges_are_named(tmp_path: Path) -> None:
    """A wrong step that is not trusted is rejected; without the file it is odometry."""
    file, trusted = tmp_path / "robot.g2o", tmp_path / "trusted.txt"
    ways = [(0, 1, 0.1), (1, 2, 0.1), (2, 3, 1.5), (0, 2, 0.2), (2, 4, 0.2), (0, 4, 0.4)]
    ways += [(3, 4, 0.1), (1, 3, 0.2), (0, 3, 0.3)]
    file.write_text("".join(line(*way) for way in ways))
    trusted.write_text("0 1\n1 2\n4 2\n7 9\n")
    robust = ["solve", "--follow", str(file), "--loss", "tls", "--loss-scale", "10"]
    named = CliRunner().invoke(commands, [*robust, "--trusted", str(trusted)])
    *_, last, unseen = named.output.splitlines()
    assert json.loads(last)["outliers"] == 1
    assert unseen == "1 of the trusted edges did not come, as 7 -> 9"
    trusted.write_text("0 1\n1 2\n4 2\n")
    both = CliRunner().invoke(commands, [*robust, "--trusted", str(trusted), "--trust-odometry"])
    by_ids = CliRunner().invoke(commands, robust)
    states = [json.loads(run.output.splitlines()[-1]) for run in (both, by_ids)]
    assert states[0]["objective"] > 0.1  # 2 -> 4 and the wrong step contradict each other
    assert states[1]["outliers"] > 1  # of the closures: that step is believed
    refused = CliRunner().invoke(
        commands, ["solve", "--follow", str(file), "--trusted", str(trusted)]
    )
    assert refused.exit_code == 2
    assert "--trusted is for --loss" in refused.output
    trusted.write_text("0 1\na b\n")
    wrong = CliRunner().invoke(commands, [*robust, "--trusted", str(trusted)])
    assert isinstance(wrong.exception, rotavg.FormatError)
    assert "trusted.txt:2: found an edge between 'a' and 'b'" in str(wrong.exception)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("EDGE_SE3:QUAT 0 x 0 0 0 0 0 0 1\n", ":3:"),
        ("EDGE_SE3:QUAT 0\n", ":3:"),
        ("EDGE_SE3:QUAT 0 5 0 0 0 0 0 0 0\n", ":3:"),
        ("EDGE_SE3:QUAT 0 5 0 0 0 nan 0 0 1\n", ":3:"),
        ("EDGE_SE3:QUAT 5 5 0 0 0 0 0 0 1\n", ":3:"),
        ("EDGE_SE3:QUAT 0 5 0 0 0 0 0 0 1 3\n", ":3:"),
    ],
)
def test_follow_names_the_line_that_is_wrong(tmp_path: Path, text: str, place: str) -> None:
    file = tmp_path / "robot.g2o"
    file.write_text("".join([*LINES[:2], text, *LINES[3:]]))
    done = subprocess.run(
        [sys.executable, "-m", "rotavg", "solve", "--follow", str(file)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert place in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stdout.splitlines()) == 1  # what came before it


def test_follow_refuses_what_it_cannot_do(tmp_path: Path) -> None:
    file = tmp_path / "robot.g2o"
    file.write_text("".join(LINES))
    for more in (["-o", "x.zzz"], ["--output-format", "csv"], ["--report", "x.html"]):
        result = CliRunner().invoke(commands, ["solve", "--follow", str(file), *more])
        assert result.exit_code != 0
    for more in (["--loss", "auto"], ["--loss", "tls"], ["--method", "bcd"]):
        result = CliRunner().invoke(commands, ["solve", "--follow", str(file), *more])
        assert result.exit_code == 2
    robust = [*("--loss", "tls"), *("--loss-scale", "10")]
    assert CliRunner().invoke(commands, ["solve", "--follow", str(file), *robust]).exit_code == 0
    empty = subprocess.run(
        [sys.executable, "-m", "rotavg", "solve", "--follow", "-"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert empty.returncode == 2
    assert "no edges" in empty.stderr


def interrupted(*options: str) -> tuple[int, str, list[Any]]:
    """Exit status, standard error and answers of a stream of two edges that Ctrl-C ends."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rotavg", "solve", "--follow", "-", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    answers = []
    for text in (LINES[1], LINES[3]):
        process.stdin.write(text)
        process.stdin.flush()
        answers.append(json.loads(process.stdout.readline()))  # before the next one comes
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    return process.returncode, errors, answers


def test_follow_answers_at_once_and_ends_by_ctrl_c() -> None:
    status, errors, answers = interrupted()
    assert [answer["certificate"]["verdict"] for answer in answers] == ["proved", "proved"]
    assert status == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors


def follow(*arguments: Any) -> Any:
    words = ["solve", "--follow", *map(str, arguments)]
    return CliRunner().invoke(commands, words, standalone_mode=False)


@pytest.mark.parametrize("name", ["out.g2o", "out.csv", "out.tum", "out.npz"])
def test_follow_writes_what_solve_writes(name: str, tmp_path: Path) -> None:
    """The same poses, in the file's gauge; of a pose graph with the positions that fit."""
    pytest.importorskip("scipy")
    source = tmp_path / "in.g2o"
    graph = rotavg.simulate("sphere", 60, noise=0.05, seed=2).graph
    rng = np.random.default_rng(2)
    moved = rotavg.RelativeTranslations(rng.normal(size=(graph.num_edges, 3)))
    rotavg.write(
        source,
        rotavg.MeasurementGraph(graph.edges, graph.rotations, graph.weights, translations=moved),
    )
    source.write_text("# kept\n" + source.read_text() + "VERTEX_SE3:QUAT 3 1 2 3 0 0 0 1\nFIX 3\n")
    done, expected = tmp_path / name, tmp_path / f"solve_{name}"
    assert follow(source, "-o", done).exception is None
    words = ["solve", str(source), "-o", str(expected)]
    assert CliRunner().invoke(commands, words).exit_code == 0
    ids, rotations = rotavg.read_rotations(done)
    same, others = rotavg.read_rotations(expected)
    assert ids.tolist() == same.tolist()
    np.testing.assert_allclose(rotations, others, atol=1e-6)
    if name == "out.g2o":
        here, there = (path.read_text().splitlines() for path in (done, expected))
        assert len(here) == len(there)
        for a, b in zip(here, there):
            if a.startswith("VERTEX"):
                np.testing.assert_allclose(
                    [float(x) for x in a.split()[1:]], [float(x) for x in b.split()[1:]], atol=1e-5
                )
            else:
                assert a == b


def test_follow_writes_after_ctrl_c(tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    status, errors, _ = interrupted("-o", str(out))
    assert status == 130
    assert f"wrote {out}" in errors
    assert "Traceback" not in errors
    ids, rotations = rotavg.read_rotations(out)
    assert ids.tolist() == [0, 1, 2]
    np.testing.assert_allclose(rotations[0], np.eye(3), atol=1e-15)


def test_follow_writes_what_stands_before_a_wrong_line(tmp_path: Path) -> None:
    file, out = tmp_path / "in.g2o", tmp_path / "out.g2o"
    file.write_text("".join([*LINES[:2], LINES[3], "EDGE_SE3:QUAT 0 x 0 0 0 0 0 0 1\n"]))
    failed = follow(file, "-o", out)
    assert isinstance(failed.exception, rotavg.FormatError)
    assert failed.exception.line == 4
    assert rotavg.read(out, unit_weights=True).num_edges == 2
    # Lines that no file holds beside those before them.
    file.write_text("".join([*LINES[:2], "EDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3\n"]))
    failed = follow(file, "-o", out)
    assert isinstance(failed.exception, rotavg.FormatError)
    assert "expected EDGE_SE3:QUAT" in str(failed.exception)
    assert follow(file).exception is None
    # What nobody looks at is no reason to lose the solution.
    file.write_text("".join([*LINES[1:], "VERTEX_SE3:QUAT 0 nonsense\n"]))
    with pytest.warns(rotavg.IncompleteWarning, match="only the edges are kept"):
        assert follow(file, "-o", out).exception is None
    assert rotavg.read(out, unit_weights=True).num_edges == 3


def test_follow_leaves_wrong_closures_out_of_positions(tmp_path: Path) -> None:
    """With a robust loss; a closure whose rotation is wrong, and whose translation is far off."""
    pytest.importorskip("scipy")
    lines = [f"EDGE_SE3:QUAT {k} {k + 1} 1 0 0 0 0 0 1 {INFORMATION}\n" for k in range(5)]
    lines += [f"EDGE_SE3:QUAT {k} {k + 2} 2 0 0 0 0 0 1 {INFORMATION}\n" for k in range(4)]
    lines += [f"EDGE_SE3:QUAT 0 5 90 0 0 0 0 1 0 {INFORMATION}\n"]
    file, out = tmp_path / "in.g2o", tmp_path / "out.g2o"
    file.write_text("".join(lines))
    assert follow(file, "-o", out, "--loss", "tls", "--loss-scale", 10).exception is None
    places = {
        int(line.split()[1]): float(line.split()[2])
        for line in out.read_text().splitlines()
        if line.startswith("VERTEX")
    }
    assert places[5] - places[0] == pytest.approx(5, abs=1e-6)
