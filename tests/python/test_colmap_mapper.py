"""COLMAP: databases in and out, and its mapper behind rotavg's rotations."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs rotavg[images]")
pytest.importorskip("pycolmap", reason="needs rotavg[colmap]")

import pycolmap

import rotavg
from photographs import FOCAL, TURNS_DEG, room_folder, rotations
from rotavg import colmap, images
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.reproduce.photographs import angles_deg
from test_cli import run

pycolmap.logging.minloglevel = pycolmap.logging.WARNING.value


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("colmap")
    room_folder(folder / "room")
    return folder


@pytest.fixture(scope="module")
def measured(room: Path) -> images.Measurement:
    return images.measure(room / "room", focal=FOCAL)


@pytest.fixture(scope="module")
def database(room: Path, measured: images.Measurement) -> Path:
    path = room / "room.db"
    colmap.create_database(path, measured)
    return path


def relative_rotation(path: Path, i: int, j: int) -> np.ndarray:
    """What pycolmap reads: camera_j_from_camera_i."""
    opened = pycolmap.Database.open(path)
    geometry = opened.read_two_view_geometry(i, j)
    opened.close()
    return np.asarray(geometry.cam2_from_cam1.rotation.matrix())


def test_pycolmap_reads_the_database(database: Path, measured: images.Measurement) -> None:
    opened = pycolmap.Database.open(database)
    assert opened.num_images() == 4
    assert opened.num_cameras() == 1
    assert opened.num_verified_image_pairs() == 6
    (camera,) = opened.read_all_cameras()
    assert (camera.width, camera.height, camera.focal_length) == (320, 240, FOCAL)
    assert opened.read_num_matches() is not None
    for pair, (i, j) in zip(measured.pairs, [(1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)]):
        geometry = opened.read_two_view_geometry(i, j)
        assert len(geometry.inlier_matches) == pair.num_inliers
        inliers = geometry.inlier_matches
        rays = [
            np.array([camera.cam_from_img(x) for x in opened.read_keypoints(k)[rows, :2]])
            for k, rows in ((i, inliers[:, 0]), (j, inliers[:, 1]))
        ]
        errors = pycolmap.compute_squared_sampson_error(*rays, geometry.E)
        assert np.sqrt(np.max(errors)) < 1.01 / FOCAL
    opened.close()
    truth = rotations(TURNS_DEG)
    # vision family: R_j R_i^T of camera_from_world
    assert angles_deg(relative_rotation(database, 1, 3), truth[2].T @ truth[0]) < 0.3


def test_a_database_comes_back_as_the_graph(database: Path, measured: images.Measurement) -> None:
    graph, expected = rotavg.read(database), measured.graph
    assert graph.edges.tolist() == expected.edges.tolist()
    np.testing.assert_allclose(graph.rotations, expected.rotations, atol=1e-14)
    np.testing.assert_array_equal(graph.weights, expected.weights)


def test_written_rotations_are_consistent(database: Path, tmp_path: Path) -> None:
    before = database.read_bytes()
    solution = rotavg.solve(rotavg.read(database))
    copy = tmp_path / "copy.db"
    assert colmap.write_rotations(database, solution, copy) == 0
    assert database.read_bytes() == before
    assert not list(database.parent.glob(f"{database.name}?*"))  # no log left beside it
    again = rotavg.solve(rotavg.read(copy))
    assert again.objective < 1e-20
    np.testing.assert_allclose(again.rotations, solution.rotations, atol=1e-12)
    expected = solution["d.png"].T @ solution["b.png"]
    np.testing.assert_allclose(relative_rotation(copy, 2, 4), expected, atol=1e-12)
    with pytest.raises(rotavg.FileAccessError, match="there is a file already"):
        colmap.write_rotations(database, solution, copy)


def test_contradicted_and_unknown_pairs_lose_their_geometry(database: Path, tmp_path: Path) -> None:
    graph = rotavg.read(database)
    wrong = graph.edges.tolist().index(["a.png", "c.png"])
    R = np.array(graph.rotations)
    R[wrong] = R[wrong] @ rotations([[0, 90, 0]])[0]
    changed = tmp_path / "changed.db"
    changed.write_bytes(database.read_bytes())
    with closing(sqlite3.connect(changed)) as opened:
        q = quaternions_from_matrices(R[wrong].T)[[3, 0, 1, 2]]
        opened.execute(
            "UPDATE two_view_geometries SET qvec = ? WHERE pair_id = ?",
            (q.tobytes(), 2147483647 * 1 + 3),
        )
        opened.commit()
    np.testing.assert_allclose(rotavg.read(changed).rotations, R, atol=1e-12)
    solution = rotavg.solve(graph.subgraph(["a.png", "b.png", "c.png"]))
    assert colmap.write_rotations(changed, solution, tmp_path / "copy.db") == 1
    left = rotavg.read(tmp_path / "copy.db").edges.tolist()
    assert left == [["a.png", "b.png"], ["b.png", "c.png"]]


def test_poses_that_colmap_left_out_are_computed(database: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.db"
    bare.write_bytes(database.read_bytes())
    with closing(sqlite3.connect(bare)) as opened:
        opened.execute("UPDATE two_view_geometries SET qvec = NULL, tvec = NULL")
        opened.commit()
    (note,) = rotavg.read(bare).notes
    assert note.startswith("6 relative poses are computed")
    assert angles_deg(rotavg.read(bare).rotations, rotavg.read(database).rotations).max() < 0.5
    assert colmap.two_views.complete_poses(bare) == 6
    a, b = rotavg.read(bare), rotavg.read(database)
    assert angles_deg(a.rotations, b.rotations).max() < 0.5


def test_command_line(room: Path, database: Path, tmp_path: Path) -> None:
    output = tmp_path / "scene"
    done = run("colmap", database, room / "room", "-o", output, "--picture", "--threads", 1)
    assert done.returncode == 0, done.stderr
    assert "4 images" in done.stdout
    assert sorted(path.name for path in output.iterdir()) == [
        "0", "database.db", "picture.png", "rotations.npz",
    ]  # fmt: skip
    model = pycolmap.Reconstruction(output / "0")
    truth = dict(zip(("a.png", "b.png", "c.png", "d.png"), rotations(TURNS_DEG)))
    found = {i.name: i.cam_from_world().rotation.matrix().T for i in model.images.values()}
    for name, R in found.items():
        gauge = truth["a.png"] @ found["a.png"].T
        assert angles_deg(gauge @ R, truth[name]) < 0.3
    done = run("colmap", database, room / "room", "-o", output)
    assert done.returncode == 2
    assert "not an empty folder" in done.stderr
    done = run("colmap", database, room / "room", "-o", tmp_path / "other", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["models"][0]["images"] == 4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.db", "room"], "missing.db: cannot be read"),
        (["text.db", "room"], "text.db: found no readable database"),
        (["empty.db", "room"], "found no COLMAP database"),
        (["room.db", "nowhere"], "nowhere: cannot be read: there is no such folder"),
    ],
)
def test_bad_input(database: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room.db").write_bytes(database.read_bytes())
    (tmp_path / "text.db").write_text("no database" * 100)
    (tmp_path / "empty.db").touch()
    before = sorted(tmp_path.rglob("*"))
    done = run("colmap", *arguments, "-o", "scene", cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_images_writes_the_database_too(room: Path, tmp_path: Path) -> None:
    arguments = ["images", room / "room", "-o", tmp_path / "g.txt", "--focal", FOCAL, "--database"]
    done = run(*arguments, tmp_path / "g.db")
    assert done.returncode == 0, done.stderr
    assert rotavg.read(tmp_path / "g.db").num_edges == 6
    done = run(*arguments, tmp_path / "g.db")
    assert done.returncode == 2
    assert "there is a file already" in done.stderr


@pytest.mark.parametrize("what", ["create_database", "write_rotations"])
def test_a_full_disk_is_told_and_leaves_nothing(
    database: Path, measured: images.Measurement, tmp_path: Path, what: str
) -> None:
    resource = pytest.importorskip("resource", reason="limits are those of Unix")
    solution = rotavg.solve(rotavg.read(database))
    new = tmp_path / "new.db"
    if what == "create_database":
        write = partial(colmap.create_database, new, measured)
    else:
        write = partial(colmap.write_rotations, database, solution, new)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (database.stat().st_size // 2, before[1]))
    try:
        with pytest.raises(rotavg.FileAccessError, match="cannot be written: disk I/O error"):
            write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
