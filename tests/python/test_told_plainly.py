"""What people are told: with line and column, what else there is, and what to do."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.cli.main import commands
from rotavg.io import FORMATS, read_gravity

I6 = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
I3 = "1 0 0 1 0 1"


def run(*arguments: Any) -> str:
    result = CliRunner().invoke(commands, [str(a) for a in arguments])
    return f"{result.exit_code} {result.output}{result.exception or ''}"


@pytest.mark.parametrize(
    ("name", "text", "where"),
    [
        ("g.g2o", f"EDGE_SE3:QUAT 0 1 0 0 nan 0 0 0 1 {I6}", ":1: found nan, .* \\(z\\)"),
        ("g.g2o", f"EDGE_SE3:QUAT 0 1 0 0 0 0 inf 0 1 {I6}", ":1: found inf, .* \\(qy\\)"),
        ("g.g2o", f"EDGE_SE2 0 1 0 0 nan {I3}", "\\(theta\\)"),
        ("g.g2o", "EDGE_SE2 0 1 0 0 1 1 0 0 1 0 nan", "\\(value 6 of the information\\)"),
        ("g.graph", f"EDGE3 0 1 0 0 0 0 nan 0 {I6}", "\\(pitch\\)"),
        ("p.pyfg", f"EDGE_SE2 0 A0 A1 0 0 nan {I3}", "\\(theta\\)"),
        ("p.pyfg", "EDGE_SE2 0 A0 A1 0 0 1 1 0 0 1 0 nan", "\\(value 6 of the covariance\\)"),
        ("t.txt", "0 1 0 0 0 1 1\n1 2 0 0 0 1 nan", ":2: found nan, .* \\(weight\\)"),
        ("t.csv", "i,j,rx,ry,rz\n0,1,0,nan,0", ":2: found nan, .* \\(ry\\)"),
        ("EGs.txt", "0 1 1 0 0 0 nan 0 0 0 1 0 0 0", "\\(r22\\)"),
        ("x.irotavg", "1 2 500\n1 2 1 0 nan 0\n", "found nan, .* \\(qy\\)"),
    ],
)
def test_what_is_not_finite_is_told_with_line_and_column(
    tmp_path: Path, name: str, text: str, where: str
) -> None:
    path = tmp_path / name
    path.write_text(text + "\n")
    with pytest.raises(rotavg.FormatError, match=where):
        rotavg.read(path)


def test_lists_of_formats_name_what_can_be_done(tmp_path: Path) -> None:
    graph = rotavg.simulate("cycle", 5, noise=0.1, seed=1).graph
    path = tmp_path / "graph.csv"
    rotavg.write(path, graph)
    written = {form.name for form in FORMATS if form.write}
    read = {form.name for form in FORMATS if form.read or form.rotations}
    assert written != read
    (tmp_path / "odd.bin").write_bytes(b"nothing that is known")
    for arguments, names in (
        (("convert", path, tmp_path / "out.xyz"), written),
        (("convert", path, tmp_path / "out.jrl"), written),
        (("solve", path, "-o", tmp_path / "out.jrl"), written),
        (("info", tmp_path / "odd.bin"), read),
    ):
        told = run(*arguments)
        assert told.startswith(("1", "2"))
        listed = told.partition("expected one of the formats that are ")[2]
        assert set(re.findall(r"([0-9a-z_]+) \(", listed)) == names, told
    with pytest.raises(rotavg.FormatError, match=r"tum holds rotations alone .* read: npz"):
        rotavg.read(path, format="tum")
    with pytest.raises(rotavg.FormatError, match=r"unknown format 'jpeg', expected .* written"):
        rotavg.write(tmp_path / "x", graph, format="jpeg")


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    rotavg.write(tmp_path / "g.csv", rotavg.simulate("cycle", 5, seed=1).graph)
    graph, folder = tmp_path / "g.csv", tmp_path / "folder"
    folder.mkdir()
    expected = "it is a folder, expected a file"
    for arguments in (
        ("info", folder),
        ("convert", folder, tmp_path / "o.csv"),
        ("compare", folder, graph),
        ("solve", graph, "--fixed", folder),
        ("solve", graph, "--gravity", folder),
        ("solve", graph, "--rigs", folder),
        ("solve", graph, "--nodes", folder),
        ("solve", graph, "--init", folder),
        ("solve", graph, "--excluded", folder),
    ):
        assert expected in run(*arguments), arguments
    for read in (rotavg.read, rotavg.read_rotations, read_gravity):
        with pytest.raises(rotavg.FileAccessError, match=expected):
            read(folder)


def test_gravity_of_zero_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "gravity.txt"
    path.write_text("# of cameras\na 0 1 0\nb 0 0 0\n")
    with pytest.raises(rotavg.FormatError, match=r"txt:3: the gravity of 'b' is zero"):
        read_gravity(path)
    path.write_text("a 0 nan 0\n")
    with pytest.raises(rotavg.FormatError, match=r"txt:1: found nan, .* \(gy\)"):
        read_gravity(path)
    database = tmp_path / "d.db"
    with sqlite3.connect(database) as connection:
        connection.execute("CREATE TABLE images (image_id INTEGER, name TEXT)")
        connection.execute(
            "CREATE TABLE pose_priors (corr_data_id INTEGER, corr_sensor_type INTEGER, "
            "gravity BLOB)"
        )
        connection.execute("INSERT INTO images VALUES (1, 'a.jpg')")
        connection.execute("INSERT INTO pose_priors VALUES (1, 0, ?)", (np.zeros(3).tobytes(),))
    connection.close()
    with pytest.raises(rotavg.FormatError, match=r"the gravity of 'a\.jpg' is zero"):
        read_gravity(database)


def test_rotations_from_a_file_have_names(tmp_path: Path) -> None:
    solution = rotavg.solve(rotavg.simulate("cycle", 5, seed=1).graph)
    rotavg.write(tmp_path / "s.csv", solution)
    found = rotavg.read_rotations(tmp_path / "s.csv")
    nodes, rotations = found
    assert nodes is found.nodes
    assert rotations is found.rotations
    assert nodes.tolist() == list(range(5))
    np.testing.assert_allclose(rotations, solution.rotations, atol=1e-14)
    assert rotavg.compare(found, solution).rms < 1e-7


def test_a_core_that_is_older_than_the_package_says_what_to_do() -> None:
    from rotavg import _core

    with pytest.raises(ImportError, match="has no 'solve_all': it is older than the Python pack"):
        from rotavg._core import solve_all  # type: ignore[attr-defined]  # noqa: F401
    with pytest.raises(ImportError, match="install it anew: the wheel"):
        _core.solve_all  # type: ignore[attr-defined]  # noqa: B018
    assert not hasattr(_core, "__path__")


def test_uncertainty_beyond_half_a_turn_is_told(tmp_path: Path) -> None:
    path = tmp_path / "g.csv"
    rotavg.write(path, rotavg.simulate("cycle", 5, noise=0.1, seed=1).graph)
    out = tmp_path / "c.csv"
    told = run("solve", path, "--covariances", out, "--noise-variance", 100)
    assert "4 of 5 beyond 180 deg, which no rotation can be off by" in told
    assert '"beyond_half_a_turn": 4' in run(
        "solve", path, "--covariances", out, "--noise-variance", 100, "--json"
    )
    assert "beyond 180" not in run("solve", path, "--covariances", out)


@pytest.mark.parametrize(
    "other", [3, None, ("a",), ["a", "b"], object(), [1, 2], {0: 1}, [[np.eye(3)], [3]]]
)
def test_what_cannot_be_compared_is_told_without_numpys_words(other: Any) -> None:
    solution = rotavg.solve(rotavg.simulate("cycle", 5, seed=1).graph)
    with pytest.raises(rotavg.GraphError, match=r"^reference") as caught:
        rotavg.compare(solution, other)
    assert "np." not in str(caught.value)
    assert "inhomogeneous" not in str(caught.value)


def test_a_database_with_a_damaged_schema_is_told(tmp_path: Path) -> None:
    """What a fuzzer found: SQLite's message quotes the schema, and that is no text."""
    path = tmp_path / "d.db"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE images (image_id INTEGER, name TEXT, camera_id INTEGER)")
        connection.execute("CREATE TABLE two_view_geometries (pair_id INTEGER)")
    connection.close()
    data = path.read_bytes()
    for old in (b"image_id", b"CREATE TABLE images", b"(image_id"):
        for new in (b"\xff", b"\xff\xfe", b"\x80("):
            path.write_bytes(data.replace(old, new.ljust(len(old), b"\xff"), 1))
            with pytest.raises(rotavg.FormatError, match=re.escape(str(path))):
                rotavg.read(path)


def test_arrays_without_a_length_are_refused(tmp_path: Path) -> None:
    """What a fuzzer found in npz: a number where an array of translations is expected."""
    graph = rotavg.simulate("cycle", 5, noise=0.1, seed=1).graph
    for shape in ((), (0,), (3,), (2, 3, 3)):
        with pytest.raises(rotavg.GraphError, match="translations have shape"):
            rotavg.RelativeTranslations(np.ones(shape))
        with pytest.raises(rotavg.GraphError):
            rotavg.solve(graph).covariances(np.ones(shape, dtype=np.int64))
    path = tmp_path / "g.npz"
    np.savez(path, edges=graph.edges, rotations=graph.rotations, translations=np.float64(1))
    with pytest.raises(rotavg.FormatError, match=r"g\.npz: translations have shape \(\)"):
        rotavg.read(path)
