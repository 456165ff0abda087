"""Bad files are refused with the place and the reason; what cannot be written leaves no trace."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from rotavg.base.errors import FileAccessError, FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import read, write

GOOD_G2O = "EDGE_SE3:QUAT 0 1 1 2 3 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"
GOOD_TEXT = "0 1 0 0 0 1 2"
I3 = np.eye(3)


@pytest.mark.parametrize("name", ["gone.g2o", "gone.txt", "gone.npz", "no_folder/gone.g2o"])
def test_missing_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileAccessError, match="cannot be read: No such file") as caught:
        read(tmp_path / name)
    assert isinstance(caught.value, OSError)
    assert isinstance(caught.value, FormatError)
    assert str(tmp_path / name) in str(caught.value)


def test_directory(tmp_path: Path) -> None:
    with pytest.raises(FileAccessError, match="cannot be read: it is a folder, expected a file"):
        read(tmp_path)


def test_unreadable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "secret.g2o"
    path.write_text(GOOD_G2O)
    path.chmod(0)

    def forbidden(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    if os.access(path, os.R_OK):  # root may read everything
        monkeypatch.setattr(Path, "read_bytes", forbidden)
    with pytest.raises(FileAccessError, match=r"secret\.g2o: cannot be read: Permission denied"):
        read(path)


@pytest.mark.parametrize("name", ["a.g2o", "a.txt", "a.csv", "a.npz", "a.dat"])
@pytest.mark.parametrize("content", [b"", b" \n\r\n\t"])
def test_empty_file(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match="the file is empty"):
        read(tmp_path / name)


@pytest.mark.parametrize("name", ["a.g2o", "a.txt", "a.csv", "a.npz", "a.dat"])
@pytest.mark.parametrize("seed", range(5))
def test_binary_junk(tmp_path: Path, name: str, seed: int) -> None:
    junk = np.random.default_rng(seed).bytes(3000)
    (tmp_path / name).write_bytes(junk)
    with pytest.raises(FormatError):
        read(tmp_path / name)
    (tmp_path / name).write_bytes(junk.replace(b"\0", b"\1"))
    with pytest.raises(FormatError):
        read(tmp_path / name)


def test_unknown_formats_list_the_known(tmp_path: Path) -> None:
    path = tmp_path / "a.dat"
    path.write_text("hello\n")
    known = r"npz \(\.npz\), .*g2o \(\.g2o\), .*csv \(\.csv\), text"
    with pytest.raises(FormatError, match=known):
        read(path)
    with pytest.raises(FormatError, match=r"unknown format 'ply', expected one of .*g2o"):
        read(path, format="ply")
    graph = MeasurementGraph([[0, 1]], [I3])
    with pytest.raises(FormatError, match=r"out\.dat: the name does not tell the format.*g2o"):
        write(tmp_path / "out.dat", graph)
    with pytest.raises(FormatError, match="a folder's name does not tell the format"):
        write(tmp_path, graph)
    assert not (tmp_path / "out.dat").exists()
    write(tmp_path / "out.dat", graph, format="g2o")
    assert read(tmp_path / "out.dat").num_edges == 1


def g2o(old: str, new: str) -> str:
    assert old in GOOD_G2O
    return GOOD_G2O.replace(old, new, 1)


BAD_G2O = [
    ("EDGE_SE3:QUAT 0 1 1 2 3 0 0", "found 6 numbers.*expected 28|expected 28"),
    ("EDGE_SE3:QUAT 0 1", "truncated"),
    ("EDGE_SE3:QUAT 0", "truncated"),
    ("EDGE_SE3:QUAT", "truncated"),
    (GOOD_G2O[:-2], "found 27 numbers.*expected 28"),
    (GOOD_G2O + " 7", "found 29 numbers.*expected 28"),
    (g2o("1 2 3", "1 two 3"), "found 'two', expected a number"),
    (g2o("1 2 3", "1 2_0 3"), "found '2_0', expected a number"),
    (g2o("1 2 3", "1 2,0 3"), "found '2,0', expected a number"),
    (g2o("0 1 1 2 3", "0 1.5 1 2 3"), "found '0' '1.5' for node ids, expected integers"),
    (g2o("0 1 1 2 3", "0 x 1 2 3"), "found '0' 'x' for node ids, expected integers"),
    (g2o("1 2 3", "1 nan 3"), "found nan, expected a finite number"),
    (g2o("1 2 3", "1 2 -inf"), "found -inf, expected a finite number"),
    (g2o("0 0 0 1 1", "0 0 0 1e999 1"), "found inf, expected a finite number"),
    (g2o("0 0 0 1 1", "0 0 0 0 1"), r"edge 1 \(0 -> 1\): the quaternion is zero"),
    (g2o("0 1 1", "4 4 1"), r"edge 1 \(4 -> 4\)"),
    (g2o("4 0 0 4 0 4", "4e-300 0 0 4e-300 0 4e-300"), r"edge 1 \(0 -> 1\): .*weight"),
    ("VERTEX_SE3:QUAT 5 1 2 3 0 0 0", "expected 7"),
    ("VERTEX_SE3:QUAT 5 1 2 3 0 0 0 q", "found 'q', expected a number"),
    ("VERTEX_SE3:QUAT v 1 2 3 0 0 0 1", "found 'v' for node ids, expected integers"),
]


@pytest.mark.parametrize(("line", "message"), BAD_G2O)
def test_bad_g2o_line(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "bad.g2o"
    path.write_text(f"# first\n{GOOD_G2O}\n\n{line}\n{GOOD_G2O}\n")
    with pytest.raises(FormatError, match=rf"bad\.g2o:4: .*({message})") as caught:
        read(path)
    assert (caught.value.path, caught.value.line) == (path, 4)


def test_g2o_without_edges(tmp_path: Path) -> None:
    path = tmp_path / "none.g2o"
    path.write_text("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n")
    with pytest.raises(FormatError, match=r"none\.g2o: the file has no edges"):
        read(path)
    path.write_text("VERTEX_SE2 0 0 0 0\nEDGE_SE2_XY 0 1 0 0 0 1 0\n")
    with pytest.raises(FormatError, match=r"no line EDGE_SE3:QUAT, .*; found .*EDGE_SE2_XY: 1"):
        read(path)


BAD_TEXT = [
    ("0 1 0 0 0 1", "found 4 numbers.*expected 5"),
    ("0 1 0 0 0 1 2 3", "found 6 numbers.*expected 5"),
    ("0 1", "found 2 fields, expected 7"),
    ("0 1 0 zero 0 1 2", "found 'zero', expected a number"),
    ("0 1 0 0 0 1 2x", "found '2x', expected a number"),
    ("0,1,0,,0,1,2", "found 4 numbers.*expected 5"),
    ("0 1 0 0 nan 1 2", "found nan, expected a finite number"),
    ("0 1 0 0 0 inf 2", "found inf, expected a finite number"),
    ("0 1 0 0 0 0 2", r"edge 1 \(0 -> 1\): the quaternion is zero"),
    ("3 3 0 0 0 1 2", r"edge 1 \(3 -> 3\)"),
    ("0 1 0 0 0 1 -2", r"edge 1 \(0 -> 1\): .*weight"),
    ("0 1 0 0 0 1 -2", r"edge 1 \(0 -> 1\): .*weight"),
    ("0 1 0 0 0 1 nan", "found nan, expected a finite number"),
]


@pytest.mark.parametrize("suffix", [".txt", ".csv"])
@pytest.mark.parametrize(("line", "message"), BAD_TEXT)
def test_bad_text_line(tmp_path: Path, suffix: str, line: str, message: str) -> None:
    path = tmp_path / f"bad{suffix}"
    if suffix == ".csv":
        line = line.replace(" ", ",")
    path.write_text(f"# first\n{GOOD_TEXT}\n\n{line}\n{GOOD_TEXT}\n")
    with pytest.raises(FormatError, match=rf"bad\{suffix}:4: .*({message})") as caught:
        read(path)
    assert (caught.value.path, caught.value.line) == (path, 4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# nothing but a comment\n", r"a\.txt: the file has no edges"),
        ("i j qx qy qz qw\n", r"a\.txt: the file has no edges"),
        ("0 1 2\n", r"a\.txt:1: found 3 fields, expected 6 or 7"),
        ("0 1 1 0 0 0 1 0 0 0 1 0 0\n", r"a\.txt:1: found 13 fields, expected 6 or 7"),
        (f"{2**70} 1 0 0 0 1\n", "expected integers of 64 bits"),
    ],
)
def test_bad_text_file(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.txt").write_text(content)
    with pytest.raises(FormatError, match=message):
        read(tmp_path / "a.txt")


# --- output ---------------------------------------------------------------------------------

OUTPUTS = ["out.g2o", "out.txt", "out.csv", "out.npz"]


@pytest.mark.parametrize("name", OUTPUTS)
def test_output_into_a_folder_that_is_not_there(tmp_path: Path, name: str) -> None:
    graph = MeasurementGraph([[0, 1]], [I3])
    with pytest.raises(FileAccessError, match=rf"{name}: cannot be written: No such file"):
        write(tmp_path / "gone" / name, graph)
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileAccessError, match="cannot be written: Not a directory"):
        write(tmp_path / "file" / name, graph)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_output_onto_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out.g2o").mkdir()
    with pytest.raises(FileAccessError, match="cannot be written: Is a directory"):
        write(tmp_path / "out.g2o", MeasurementGraph([[0, 1]], [I3]))
    assert list(tmp_path.rglob("*")) == [tmp_path / "out.g2o"]


@pytest.mark.parametrize("name", OUTPUTS)
def test_failure_in_the_middle_leaves_all_as_it_was(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_text("precious")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(FileAccessError, match="cannot be written: No space left on device"):
        write(tmp_path / name, MeasurementGraph([[0, 1]], [I3]))
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(name, "precious")]


def test_a_failure_between_two_files_names_the_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    move = Path.replace

    def full(source: Path, target: Path) -> Path:
        if target.name == "cc.txt":
            raise OSError(28, "No space left on device")
        return move(source, target)

    monkeypatch.setattr(Path, "replace", full)
    graph = MeasurementGraph([["a", "b"]], [I3])
    with pytest.raises(FileAccessError, match=r"cc\.txt: cannot be written: No space left"):
        write(tmp_path / "scene", graph, format="1dsfm")
    assert [file.name for file in (tmp_path / "scene").iterdir()] == ["EGs.txt"]


def test_output_keeps_links_and_permissions(tmp_path: Path) -> None:
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write(link, MeasurementGraph([[0, 1]], [I3]))
    assert link.is_symlink()
    assert read(target).num_edges == 1
    assert target.stat().st_mode & 0o777 == 0o640
