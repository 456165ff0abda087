"""The command `rotavg`, as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg


def run(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rotavg", *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        cwd=cwd,
        check=False,
    )


@pytest.fixture
def graph_file(tmp_path: Path) -> Path:
    path = tmp_path / "graph.g2o"
    rotavg.write(path, rotavg.simulate("sphere", 100, noise=0.1, seed=1).graph)
    return path


def test_convert_does_not_replace_what_it_reads(graph_file: Path) -> None:
    before = graph_file.read_bytes()
    nodes = graph_file.parent / "nodes.txt"
    nodes.write_text("0\n1\n2\n")
    for output in (graph_file, nodes):
        result = run("convert", graph_file, output, "--nodes", nodes, "--output-format", "g2o")
        assert result.returncode == 2
        assert "it would replace another file of this run" in result.stderr
    assert graph_file.read_bytes() == before


@pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="there is no /dev/stdin")
def test_noisy_edges_come_through_a_pipe(tmp_path: Path) -> None:
    path = tmp_path / "noisy.txt"  # so noisy that another convention is looked for
    rotavg.write(path, rotavg.simulate("complete", 8, noise=0.5, seed=1).graph)
    for command in ("info", "solve"):
        result = subprocess.run(
            [sys.executable, "-m", "rotavg", command, "-"],
            input=path.read_text(), capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert result.returncode == 0, result.stderr
        assert "28" in result.stdout  # edges


def test_what_goes_to_standard_output_goes_there_alone(graph_file: Path) -> None:
    def piped(*arguments: str, data: bytes = b"", to: Any = subprocess.PIPE) -> Any:
        command = [sys.executable, "-m", "rotavg", *arguments]
        return subprocess.run(command, input=data, stdout=to, stderr=subprocess.PIPE, check=False)

    graph = rotavg.read(graph_file)
    solved = piped(
        *("solve", "-", "-o", "-", "--output-format", "csv", "--json"),
        data=graph_file.read_bytes(),
    )
    assert solved.returncode == 0
    path = graph_file.with_name("solved.csv")
    path.write_bytes(solved.stdout)
    nodes, rotations = rotavg.read_rotations(path)
    np.testing.assert_array_equal(nodes, graph.nodes)
    np.testing.assert_allclose(rotations, rotavg.solve(graph).rotations, atol=1e-12)
    assert json.loads(solved.stderr)["nodes"] == graph.num_nodes

    # What is there already stays there.
    kept = graph_file.with_name("kept.txt")
    kept.write_bytes(b"# kept\n")
    with kept.open("ab") as stream:
        converted = piped("convert", str(graph_file), "-", "--output-format", "csv", to=stream)
    assert converted.returncode == 0
    first, *rest = kept.read_bytes().splitlines()
    assert first == b"# kept"
    assert len(rest) == graph.num_edges + 1

    edges = piped("solve", str(graph_file), "--edges", "-")
    assert len(edges.stdout.splitlines()) == graph.num_edges + 1
    assert b"proved" in edges.stderr

    # What comes after it comes after it, and no JSON between.
    with kept.open("wb") as stream:
        for json_too in ([], ["--json"]):
            command = ["convert", str(graph_file), "-", "--output-format", "csv", *json_too]
            assert piped(*command, to=stream).returncode == 0
    assert kept.read_bytes() == b"\n".join([*rest, b""]) * 2

    simulated = piped("simulate", "complete", "-n", "5", "-o", "-", "--output-format", "csv")
    assert simulated.returncode == 0
    assert len(simulated.stdout.splitlines()) == 11

    for arguments in (["-", "--nodes", "-"], [str(graph_file), "--edges", "-", "--report", "-"]):
        twice = piped("solve", *arguments, data=graph_file.read_bytes())
        assert twice.returncode == 2
        assert b"is used already" in twice.stderr


def test_simulate_writes_what_is_true(tmp_path: Path) -> None:
    arguments = ["simulate", "sphere", "-n", "60", "--noise", "0.05", "--outliers", "0.1"]
    files = ["-o", "g.g2o", "--truth", "truth.csv", "--outlier-edges", "wrong.csv"]
    assert run(*arguments, *files, cwd=tmp_path).returncode == 0
    simulation = rotavg.simulate("sphere", 60, noise=0.05, outliers=0.1)
    _, rotations = rotavg.read_rotations(tmp_path / "truth.csv")
    np.testing.assert_allclose(rotations, simulation.ground_truth, atol=1e-12)
    header, *rows = (tmp_path / "wrong.csv").read_text().splitlines()
    assert header == "i,j"
    assert rows == [f"{i},{j}" for i, j in simulation.graph.edges[simulation.is_outlier]]
    assert run("compare", "truth.csv", "truth.csv", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("p.graph", ["the poses of 2 vertices", "which 1 vertices are fixed"]),
        ("p.npz", ["the poses of 2 vertices", "which 1 vertices are fixed"]),
        ("p.csv", ["the translations", "the poses of 2 vertices", "which 1 vertices are fixed"]),
        ("p2.g2o", []),
    ],
)
def test_convert_tells_what_is_lost(name: str, told: list[str], tmp_path: Path) -> None:
    information = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
    (tmp_path / "p.g2o").write_text(
        "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1\nVERTEX_SE3:QUAT 1 2 2 3 0 0 0 1\nFIX 0\n"
        f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {information}\n"
    )
    done = run("convert", "p.g2o", name, cwd=tmp_path)
    notes = [line for line in done.stderr.splitlines() if line.startswith("note: ")]
    assert [note for note in notes if not any(words in note for words in told)] == []
    assert len(notes) == len(told)
    done = run("convert", "p.g2o", name, "--json", cwd=tmp_path)
    assert len(json.loads(done.stdout)["notes"]) == len(told)


def test_zero_positions_are_told(tmp_path: Path) -> None:
    done = run("simulate", "cycle", "-n", "5", "-o", "c.g2o", cwd=tmp_path)
    assert "note: c.g2o: the graph has no translations" in done.stderr
    done = run("solve", "c.g2o", "-o", "s.g2o", cwd=tmp_path)
    assert "note: s.g2o: the graph has no translations" in done.stderr


def test_standard_output_that_takes_nothing_is_told(graph_file: Path) -> None:
    for arguments, redirection in (("solve", ">/dev/full"), ("info --json", ">&-")):
        command = f"{sys.executable} -m rotavg {arguments} {graph_file} {redirection}"
        done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert done.stderr.startswith("Error: standard output: cannot be written: ")
        assert len(done.stderr.splitlines()) == 1


def test_too_little_memory_is_told(tmp_path: Path) -> None:
    done = run("simulate", "complete", "-n", "100000000", "-o", tmp_path / "out.txt")
    assert done.returncode == 2
    refused = "edges would take about 1.75e+09 GB, and this process may have"
    assert refused in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["solve", "missing.g2o"], "missing.g2o: cannot be read: No such file"),
        (["solve", "empty.g2o"], "empty.g2o: the file is empty"),
        (["solve", "graph.g2o", "-o", "no/such/folder/out.g2o"], "cannot be written"),
        (["solve", "graph.g2o", "-o", "out.xyz"], "formats that are written"),
        (["solve", "graph.g2o", "--magic"], "No such option"),
        (["solve", "graph.g2o", "--method", "magic"], "'magic' is not one of"),
        (["solve", "graph.g2o", "--tolerance", "-1"], "-1"),
        (["solve"], "Missing argument"),
        (["dance"], "No such command"),
        (["info", "missing.g2o"], "cannot be read"),
        (["simulate", "klein_bottle", "-n", "5", "-o", "x.g2o"], "'klein_bottle' is not one of"),
        (["simulate", "cycle", "-n", "1", "-o", "x.g2o"], "1 is not in the range"),
        (["simulate", "cycle", "-n", "5", "--drop", "0.9", "-o", "x.g2o"], "drop"),
        (["convert", "graph.g2o", "out.xyz"], "formats that are written"),
        (["convert", "graph.g2o", "out.db"], "out.db: colmap is a format for input only"),
        (["convert", "graph.g2o", "out.tum"], "found a graph to write, expected a solution"),
        (["solve", "graph.g2o", "-o", "EGs.txt"], "found a solution to write, expected a graph"),
        (["solve", "graph.g2o", "--output-format", "1dsfm"], "'1dsfm' is not one of"),
        (["info", "graph.g2o", "--format", "csv"], "graph.g2o:1: found"),
        (["info", "graph.g2o", "--convention", "vision"], "g2o is in the pose family"),
        (["info", "."], "cannot be read: it is a folder, expected a file"),
        (["solve", "graph.g2o", "--edges", "link.g2o"], "link.g2o: it would replace another file"),
        (["solve", "graph.g2o", "--covariances", "graph.g2o"], "would replace another file"),
        (["solve", "graph.g2o", "-o", "a.g2o", "--edges", "./a.g2o"], "would replace another file"),
        (["solve", "graph.g2o", "--fixed", "f", "-o", "f", "--output-format", "csv"], "replace"),
        (["solve", "graph.g2o", "-o", "graph.g2o", "--output-format", "csv"], "would replace"),
        (["solve", "graph.g2o", "-o", "-"], "/dev/stdout: the name does not tell the format"),
        (["solve", "graph.g2o", "--loss-scale", "5"], "--loss-scale is for --loss, which"),
        (["solve", "graph.g2o", "--output-format", "csv"], "--output-format is for --output"),
        (["solve", "-"], "/dev/stdin: the file is empty, expected a measurement graph"),
    ],
)
def test_bad_input_is_exit_status_2_with_one_clear_message(
    arguments: list[str], message: str, graph_file: Path
) -> None:
    folder = graph_file.parent
    (folder / "empty.g2o").touch()
    (folder / "link.g2o").symlink_to("graph.g2o")
    before = sorted(folder.iterdir())
    done = run(*arguments, cwd=folder)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert sorted(folder.iterdir()) == before


def test_info_tells_how_hard_a_graph_is(graph_file: Path) -> None:
    done = run("info", graph_file)
    assert done.returncode == 0
    assert "lambda_2" in done.stdout
    result = json.loads(run("info", graph_file, "--json").stdout)
    assert result["nodes"] == 100
    assert result["cycles"]["independent"] == result["edges"] - 99
    graph = rotavg.read(graph_file)
    L = np.zeros((100, 100))
    for (i, j), w in zip(graph.indices, graph.weights):
        L[[i, j], [i, j]] += w
        L[[i, j], [j, i]] -= w
    assert result["algebraic_connectivity"] == pytest.approx(np.linalg.eigvalsh(L)[1], rel=1e-6)


def test_the_noise_that_info_estimates_is_the_noise_that_was_simulated(tmp_path: Path) -> None:
    graph = rotavg.simulate("sphere", 900, noise=0.05, seed=3).graph
    # The median of |N(0, s)| is 0.67 s; turns about random axes add up as in three dimensions.
    assert rotavg.hardness(graph).noise == pytest.approx(0.05, rel=0.35)


@pytest.mark.parametrize(
    ("kind", "n", "density"), [("complete", 30, 1.0), ("erdos_renyi", 400, 0.05), ("grid", 343, 0)]
)
def test_wrong_edges_are_no_noise(kind: str, n: int, density: float) -> None:
    for seed in range(3):
        for noise in (0.01, 0.1):
            options = {"noise": noise, "seed": seed} | ({"density": density} if density else {})
            clean = rotavg.hardness(rotavg.simulate(kind, n, **options).graph)
            usual = np.median(clean.cycle_angles / np.sqrt(clean.cycle_lengths))
            assert clean.noise == pytest.approx(usual, rel=0.02), seed
            for wrong in (0.1, 0.25, 0.4):
                graph = rotavg.simulate(kind, n, outliers=wrong, **options).graph
                assert rotavg.hardness(graph).noise == pytest.approx(usual, rel=0.35), seed
    exact = rotavg.hardness(rotavg.simulate(kind, n, outliers=0.25, seed=1).graph)
    assert exact.noise < 1e-9


def test_simulate_is_reproducible_and_convert_keeps_the_graph(tmp_path: Path) -> None:
    for name in ("a.txt", "b.txt"):
        done = run(
            "simulate", "grid", "-n", 64, "--noise", "0.2", "--seed", 5, "-o", tmp_path / name
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.txt").read_bytes() == (tmp_path / "b.txt").read_bytes()
    for name in ("c.g2o", "d.csv", "e.npz"):
        done = run("convert", tmp_path / "a.txt", tmp_path / name)
        assert done.returncode == 0, done.stderr
        a, b = (rotavg.read(tmp_path / k) for k in ("a.txt", name))
        np.testing.assert_array_equal(a.edges, b.edges)
        np.testing.assert_allclose(a.rotations, b.rotations, atol=1e-14)


def test_help_shows_examples() -> None:
    for command in ([], ["solve"], ["info"], ["simulate"], ["convert"], ["reproduce"]):
        done = run(*command, "--help")
        assert done.returncode == 0
        assert "Example" in done.stdout
    assert run("--version").stdout.strip().endswith(rotavg.__version__)


@pytest.mark.parametrize(
    "arguments", [["info"], ["info", "--json"], ["solve"], ["solve", "--json"]]
)
def test_a_closed_pipe_is_not_an_error(arguments: list[str], graph_file: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "rotavg", *arguments, str(graph_file)],
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    finally:
        os.close(writer)
    assert done.returncode == 0
    assert done.stderr == ""


def test_unit_weights_are_written_by_convert(tmp_path: Path) -> None:
    graph = rotavg.simulate("cycle", 6, noise=0.1, seed=1).graph
    rotavg.write(tmp_path / "a.g2o", graph.with_weights([1, 2, 3, 4, 5, 6]))
    done = run("convert", "--unit-weights", tmp_path / "a.g2o", tmp_path / "b.g2o")
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(rotavg.read(tmp_path / "b.g2o").weights, 1, rtol=1e-12)


def test_formats_and_families_may_be_told(tmp_path: Path) -> None:
    graph = rotavg.simulate("cycle", 6, seed=1).graph
    vision = rotavg.MeasurementGraph(graph.edges, graph.rotations, convention="vision")
    rotavg.write(tmp_path / "pairs", vision, format="csv")
    told = ["--format", "csv", "--convention", "vision"]
    done = run("solve", tmp_path / "pairs", *told, "-o", tmp_path / "x", "--output-format", "tum")
    assert done.returncode == 0, done.stderr
    found = np.loadtxt(tmp_path / "x")[:, 4:]
    expected = rotavg.solve(graph).quaternions
    np.testing.assert_allclose(found, expected, atol=1e-12)
    done = run("convert", tmp_path / "pairs", tmp_path / "scene", "--output-format", "1dsfm")
    assert done.returncode == 0, done.stderr
    assert run("info", tmp_path / "scene").returncode == 0


def test_lost_weights_are_told_on_stderr(graph_file: Path, tmp_path: Path) -> None:
    weighted = rotavg.read(graph_file)
    rotavg.write(graph_file, weighted.with_weights(np.arange(1.0, weighted.num_edges + 1)))
    done = run("convert", graph_file, tmp_path / "a.irotavg")
    assert done.returncode == 0
    assert "warning: " in done.stderr
    assert "the weights are not in it" in done.stderr


def test_a_pose_graph_needs_no_extra(tmp_path: Path) -> None:
    """Its positions fit what was measured, also where SciPy is not installed."""
    information = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"
    (tmp_path / "pose.g2o").write_text(f"EDGE_SE3:QUAT 0 1 1 2 3 0 0 0 1 {information}\n")
    code = "import sys; sys.modules['scipy'] = None; import rotavg.cli; rotavg.cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "solve", "pose.g2o", "-o", "out.g2o", "--json"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    assert json.loads(done.stdout)["solved"]
    assert "VERTEX_SE3:QUAT 1 1.0 2.0 3.0 0 0 0 1.0\n" in (tmp_path / "out.g2o").read_text()
