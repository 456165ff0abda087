"""What fuzzing found in readers of what stands beside a graph, and what is of the same kind."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest

import rotavg
from rotavg.io.edges import read_edge_list
from rotavg.io.node_list import read_node_list
from rotavg.io.positions import positions
from tests.fuzz.beside import BESIDE, good_files_beside

NAMES = [
    ("left/0.jpg", "right/0.jpg"),
    ("right/0.jpg", "left/1.jpg"),
    ("left/1.jpg", "right/1.jpg"),
]
HEADER = "node,frame,sensor,qw,qx,qy,qz\n"


def ring(edges: object = NAMES) -> rotavg.MeasurementGraph:
    return rotavg.MeasurementGraph(edges, np.tile(np.eye(3), (3, 1, 1)))


@pytest.fixture
def database(tmp_path: Path) -> Path:
    return next(p for p in good_files_beside(tmp_path, "rigs") if p.suffix == ".db")


def change(path: Path, *statements: str) -> Path:
    connection = sqlite3.connect(path)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()
    return path


def test_a_sensor_that_took_no_image_is_left_out(database: Path) -> None:
    pose = "(SELECT sensor_from_rig FROM rig_sensors)"
    change(database, f"INSERT INTO rig_sensors SELECT 1, 3, 0, {pose}")
    assert set(rotavg.read_rigs(database, ring()).rotations) == {1, 2}


@pytest.mark.parametrize("camera", ["1.5", "X''", "X'FF'"])
def test_a_sensor_that_is_no_id_is_told_with_the_file(database: Path, camera: str) -> None:
    change(database, f"UPDATE images SET camera_id = {camera} WHERE image_id = 1")
    with pytest.raises(rotavg.FormatError, match=r"rigs\.db: .*'left/0\.jpg' has the sensor"):
        rotavg.read_rigs(database, ring())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[" * 100_000, "found no JSON"),
        ("[" + "1" * 5000 + "]", "found no JSON|rig 1 has no list"),  # too long for an int of 3.11
        ('[\n{"cameras": \xff}]', "found no JSON"),
        (HEADER + "left/0.jpg,0,l,1000\n", ":2: found 4 fields, expected 7"),
        (HEADER + "left/0.jpg,0,l,1_0,0,0,0\n", ":2: found '1_0', expected a number"),
        (HEADER + "left/0.jpg,0,l,nan,0,0,0\n", ":2: found the rotation"),
        (HEADER + "# \x85 ends no line\nleft/0.jpg,0,l,2,0,0,0\n", ":3: found the rotation"),
        (HEADER + f'"{"a" * 140_000}",0,l,1,0,0,0\n', ":2: found no CSV: field larger"),
        (HEADER + "\xff,0,l,1,0,0,0\n", ":2: found .* expected UTF-8"),
        (HEADER + "left/0.jpg,\0,l,1,0,0,0\n", ":2: the file is binary"),
    ],
)
def test_rigs(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "rigs.csv"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(rotavg.FormatError, match=rf"rigs\.csv.*({message})"):
        rotavg.read_rigs(path, ring())


@pytest.mark.parametrize("rotation", ['"1000"', "1", '["1", "0", "0", "0"]', "[1, 0, 0]", "{}"])
def test_a_quaternion_is_four_numbers(tmp_path: Path, rotation: str) -> None:
    path = tmp_path / "rig_config.json"
    path.write_text(
        '[{"cameras": [{"image_prefix": "left/", "ref_sensor": true}, '
        f'{{"image_prefix": "right/", "cam_from_rig_rotation": {rotation}}}]}}]'
    )
    with pytest.raises(rotavg.FormatError, match=r"rig 1, camera 2: found .*expected .*number"):
        rotavg.read_rigs(path, ring())


@pytest.mark.parametrize("node", ["1_0", "\u0661"])
def test_numbers_are_spelt_as_usual(tmp_path: Path, node: str) -> None:
    path = tmp_path / "rigs.csv"
    path.write_text(f"node,frame,sensor\n{node},0,l\n", encoding="utf-8")
    graph = ring([(1, 10), (10, 2), (2, 1)])
    with pytest.raises(rotavg.FormatError, match=r":2: found the node .*expected an integer"):
        rotavg.read_rigs(path, graph)
    edges = tmp_path / "edges.txt"
    edges.write_text(f"1 {node}\n", encoding="utf-8")
    with pytest.raises(rotavg.FormatError, match=r"edges\.txt:1: .*the nodes of the graph are num"):
        BESIDE["edges"].read(edges, 0)


def test_a_field_that_csv_does_not_take_is_told_with_the_line(tmp_path: Path) -> None:
    path = tmp_path / "edges.csv"
    path.write_text(f'i,j\n1,"{"2" * 140_000}"\n')
    with pytest.raises(rotavg.FormatError, match=r":2: found no CSV: field larger"):
        read_edge_list(path, "trusted")


def test_nodes_are_ids(tmp_path: Path) -> None:
    path = tmp_path / "nodes.txt"
    path.write_text("3\n1\n3\n")
    assert read_node_list(path).dtype == np.int64
    path.write_text(f"3\n{2**64}\n")
    with pytest.raises(rotavg.FormatError, match=r"nodes\.txt: .*expected integers of 64 bits"):
        read_node_list(path)


def test_a_mark_alone_is_an_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    path.write_bytes(b"\xef\xbb\xbf \n")
    for read in (
        read_node_list,
        rotavg.read,
        rotavg.read_rotations,
        rotavg.io.read_gravity,
        lambda path: read_edge_list(path, "trusted"),
        lambda path: rotavg.read_rigs(path, ring()),
    ):
        with pytest.raises(rotavg.FormatError, match=r"file\.txt: the file is empty"):
            read(path)


@pytest.mark.parametrize("blank", [b"\xa0", b"\x1c", b"\x85", b"\xc2\xa0"])
def test_blanks_are_those_of_ascii(tmp_path: Path, blank: bytes) -> None:
    source = good_files_beside(tmp_path, "positions")[0]
    path = tmp_path / "g.g2o"
    path.write_bytes(source.read_bytes().replace(b"1 1 0 0.5", b"1 1 " + blank + b"0 0.5"))
    with pytest.raises(rotavg.FormatError, match=r"g\.g2o:2: found '.*0', expected a number"):
        rotavg.read(path)
    gravity = tmp_path / "gravity.txt"
    gravity.write_bytes(b"a 0 1 " + blank + b"0\n")
    with pytest.raises(rotavg.FormatError, match=r"gravity\.txt:1: found '.*0', expected a number"):
        rotavg.io.read_gravity(gravity)


def test_a_mark_before_the_first_vertex_is_none_of_it(tmp_path: Path) -> None:
    source = good_files_beside(tmp_path, "positions")[0]
    path = tmp_path / "g.g2o"
    path.write_bytes(b"\xef\xbb\xbf" + source.read_bytes())
    where = positions(rotavg.read(path))
    assert where is not None
    assert where[1].tolist() == [1, 0, 0.5]
