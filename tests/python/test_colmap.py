"""COLMAP: its database, its pose graphs, its rotation averaging, its images.txt."""

from __future__ import annotations

import sqlite3
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import (
    FileAccessError,
    FormatError,
    GraphError,
    MissingExtraError,
)
from rotavg.colmap import from_pose_graph, run_rotation_averaging, to_pose_graph
from rotavg.graph.conventions import matrices_from_quaternions, quaternions_from_matrices
from rotavg.io import read, read_gravity, write
from rotavg.io.colmap_sqlite import pair_id_of, pair_of

WITHOUT = "pycolmap is not installed: pip install rotavg[colmap]"
IDENTITY = [1.0, 0, 0, 0]


def blob(values: Any) -> bytes:
    return np.asarray(values, dtype="<f8").tobytes()


def database(path: Path, pairs: list[tuple[Any, ...]], names: str = "abcde") -> Path:
    """A database with the two tables that are read; image ids are 1, 3, 5 ..."""
    with sqlite3.connect(path) as connection:
        connection.execute(
            "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name TEXT, camera_id INTEGER)"
        )
        connection.execute(
            "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows INTEGER, "
            "cols INTEGER, data BLOB, config INTEGER, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB)"
        )
        for k, name in enumerate(names):
            connection.execute("INSERT INTO images VALUES (?, ?, 4)", (2 * k + 1, f"{name}.jpg"))
        for i, j, rows, config, qvec, tvec in pairs:
            connection.execute(
                "INSERT INTO two_view_geometries VALUES (?, ?, 2, NULL, ?, NULL, NULL, NULL, ?, ?)",
                (2147483647 * i + j, rows, config, qvec, tvec),
            )
    connection.close()
    return path


def test_database_by_hand(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    turn, far = blob([half, 0, 0, half]), blob([0, 0, 1])
    path = database(
        tmp_path / "a.db",
        [
            (1, 3, 70, 2, turn, far),
            (1, 5, 20, 3, blob(IDENTITY), far),
            (3, 5, 9, 5, turn, blob([0, 0, 0])),  # panoramic: it has no baseline
            (1, 7, 30, 1, turn, far),  # degenerate
            (3, 7, 30, 7, turn, far),  # watermark
            (5, 7, 30, 2, None, None),  # not computed
            (1, 9, 30, 2, blob(IDENTITY), blob([0, 0, 0])),  # not computed, as it used to be said
            (3, 9, 0, 2, turn, far),
        ],
    )
    before = path.read_bytes()
    graph = read(path)
    assert graph.nodes.tolist() == ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"]
    assert graph.edges.tolist() == [["a.jpg", "b.jpg"], ["a.jpg", "c.jpg"], ["b.jpg", "c.jpg"]]
    assert graph.weights.tolist() == [70, 20, 9]
    # qvec turns from image 1 to image 2 by +90 deg about z; i_from_j turns back.
    np.testing.assert_allclose(graph.rotations[0], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert set(graph.notes) == {
        "1 pair skipped: configuration degenerate",
        "1 pair skipped: configuration watermark",
        "2 pairs skipped: no relative pose computed",
        "1 pair skipped: no inliers",
    }
    assert graph.source.configurations.tolist() == [2, 3, 5]
    assert read(path, unit_weights=True).weights.tolist() == [1, 1, 1]
    assert path.read_bytes() == before
    path.chmod(0o444)
    assert read(path).num_edges == 3
    path.chmod(0o644)
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA journal_mode = WAL")  # as COLMAP has it
    connection.close()
    assert read(path).num_edges == 3
    assert [file.name for file in tmp_path.iterdir()] == ["a.db"]


@pytest.mark.parametrize(("i", "j"), [(1, 2), (7, 2), (2147483646, 1), (5, 2147483646)])
def test_pair_ids(i: int, j: int) -> None:
    assert pair_of(pair_id_of(i, j)) == (min(i, j), max(i, j))
    pycolmap = pytest.importorskip("pycolmap", reason=WITHOUT)
    assert pair_id_of(i, j) == pycolmap.image_pair_to_pair_id(i, j)


def test_bad_databases(tmp_path: Path) -> None:
    path = tmp_path / "bad.db"
    with pytest.raises(FormatError, match=r"bad\.db: the database has no verified image pairs"):
        read(database(path, []))
    path.unlink()
    with pytest.raises(FormatError, match=r"none of the 1 image pairs has .*degenerate: 1\)"):
        read(database(path, [(1, 3, 5, 1, None, None)]))
    path.unlink()
    with pytest.raises(FormatError, match="images 1 and 99, expected ids in the table images"):
        read(database(path, [(1, 99, 5, 2, blob(IDENTITY), blob([1, 0, 0]))]))
    path.unlink()
    with pytest.raises(FormatError, match="found 8 bytes, expected 4 doubles"):
        read(database(path, [(1, 3, 5, 2, blob([1]), blob([1, 0, 0]))]))
    path.unlink()
    with pytest.raises(FormatError, match=r"\(no relative pose computed: 1\)"):
        read(database(path, [(1, 3, 5, 2, blob([0, 0, 0, 0]), blob([1, 0, 0]))]))
    path.unlink()
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE other (x INTEGER)")
    connection.close()
    with pytest.raises(FormatError, match="found no COLMAP database: no such table: images"):
        read(path)
    path.write_bytes(path.read_bytes()[:100] + b"junk" * 2000)
    with pytest.raises((FormatError, FileAccessError), match=r"bad\.db: "):
        read(path)
    with pytest.raises(FormatError, match=r"colmap is a format for input only"):
        write(tmp_path / "out.db", rotavg.MeasurementGraph([[0, 1]], [np.eye(3)]))


@pytest.fixture
def scene(tmp_path: Path) -> tuple[Any, Any, Path]:
    """pycolmap, a reconstruction without noise, and its database."""
    pycolmap = pytest.importorskip("pycolmap", reason=WITHOUT)
    pycolmap.logging.minloglevel = 3
    pycolmap.set_random_seed(1)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1,
        num_cameras_per_rig=2,
        num_frames_per_rig=6,
        two_view_geometry_has_relative_pose=True,
        prior_gravity=True,
    )
    path = tmp_path / "scene.db"
    db = pycolmap.Database.open(str(path))
    reconstruction = pycolmap.synthesize_dataset(options, db)
    db.close()
    return pycolmap, reconstruction, path


def world_from(reconstruction: Any, name: str) -> NDArray[np.float64]:
    image = next(i for i in reconstruction.images.values() if i.name == name)
    return image.cam_from_world().rotation.matrix().T


def test_we_read_what_pycolmap_writes(scene: tuple[Any, Any, Path]) -> None:
    _, reconstruction, path = scene
    graph = read(path)
    assert graph.num_nodes == 12
    truth = [world_from(reconstruction, name) for name in graph.nodes]
    assert rotavg.objective(graph, truth) < 1e-20
    names, gravity = read_gravity(path)
    known = dict(zip(names, gravity))
    for name, R in zip(graph.nodes.tolist(), truth):
        if name in known:  # of the rig's first camera
            np.testing.assert_allclose(known[name], R.T @ [0, 1, 0], atol=1e-12)
    assert len(names) >= 6


def test_pycolmap_reads_what_we_write(scene: tuple[Any, Any, Path], tmp_path: Path) -> None:
    pycolmap, reconstruction, path = scene
    solution = rotavg.solve(read(path))
    folder = tmp_path / "model"
    folder.mkdir()
    reconstruction.write_text(str(folder))  # cameras.txt and points3D.txt
    for name in ("rigs.txt", "frames.txt"):
        (folder / name).unlink(missing_ok=True)
    (folder / "points3D.txt").write_text("")
    write(folder / "images.txt", solution)
    again = pycolmap.Reconstruction(str(folder))
    assert again.num_reg_images() == 12
    for k, name in enumerate(solution.graph.nodes):
        np.testing.assert_allclose(world_from(again, name), solution.rotations[k], atol=1e-12)
    ids = {image.name: image.image_id for image in reconstruction.images.values()}
    assert {image.name: image.image_id for image in again.images.values()} == ids


def test_pose_graph_there_and_back(scene: tuple[Any, Any, Path]) -> None:
    _, _, path = scene
    graph = read(path)
    again = from_pose_graph(to_pose_graph(graph))
    ids = graph.source.image_ids
    expected = {(ids[i], ids[j]): k for k, (i, j) in enumerate(graph.edges.tolist())}
    assert sorted(expected) == sorted(map(tuple, again.edges.tolist()))
    order = [expected[i, j] for i, j in again.edges.tolist()]
    np.testing.assert_allclose(again.rotations, graph.rotations[order], atol=1e-14)
    np.testing.assert_array_equal(again.weights, graph.weights[order])


def test_pose_graph_turns_edges_round() -> None:
    pytest.importorskip("pycolmap", reason=WITHOUT)
    graph = rotavg.MeasurementGraph.from_rotvecs([[5, 2]], [[0, 0, 0.3]], weights=[8])
    again = from_pose_graph(to_pose_graph(graph))
    assert again.edges.tolist() == [[2, 5]]
    np.testing.assert_allclose(again.rotations[0], graph.rotations[0].T, atol=1e-15)
    assert again.weights.tolist() == [8]


def pose_graph_of(pycolmap: Any, path: Path) -> Any:
    db = pycolmap.Database.open(str(path))
    cache = pycolmap.DatabaseCache.create(db, pycolmap.DatabaseCacheOptions())
    result = pycolmap.PoseGraph()
    result.load(cache.correspondence_graph)
    db.close()
    return result


def unposed(pycolmap: Any, reconstruction: Any) -> Any:
    result = pycolmap.Reconstruction(reconstruction)
    for frame in list(result.reg_frame_ids()):
        result.deregister_frame(frame)
    return result


def test_drop_in_for_run_rotation_averaging(scene: tuple[Any, Any, Path]) -> None:
    pycolmap, reconstruction, path = scene
    options = pycolmap.RotationEstimatorOptions()
    found = []
    for average in (pycolmap.run_rotation_averaging, run_rotation_averaging):
        graph, target = pose_graph_of(pycolmap, path), unposed(pycolmap, reconstruction)
        # The last frame's edges go: it stays without a pose.
        last = max(reconstruction.frames)
        for image in reconstruction.images.values():
            for other in reconstruction.images.values():
                apart = (image.frame_id == last) != (other.frame_id == last)
                if apart and graph.has_edge(image.image_id, other.image_id):
                    graph.delete_edge(image.image_id, other.image_id)
        assert average(options, graph, target, [])
        turned = {}
        for k in target.frames:
            if target.frame(k).has_pose():
                turned[k] = target.frame(k).rig_from_world.rotation.matrix()
        found.append((turned, sorted(target.reg_frame_ids()), valid(graph)))
        first = min(turned)
        for k, R in turned.items():
            truth = reconstruction.frame(k).rig_from_world.rotation.matrix()
            origin = reconstruction.frame(first).rig_from_world.rotation.matrix()
            np.testing.assert_allclose(R @ turned[first].T, truth @ origin.T, atol=1e-5)
    theirs, ours = found
    assert theirs[0].keys() == ours[0].keys()
    assert theirs[1:] == ours[1:]
    assert len(ours[1]) == 5


def valid(graph: Any) -> dict[int, bool]:
    return {int(pair): bool(edge.valid) for pair, edge in graph.edges.items()}


def test_drop_in_marks_edges_that_are_contradicted(scene: tuple[Any, Any, Path]) -> None:
    pycolmap, reconstruction, path = scene
    pairs = [
        (a, b)
        for a in reconstruction.images
        for b in reconstruction.images
        if a < b and reconstruction.image(a).frame_id != reconstruction.image(b).frame_id
    ]
    wrong = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0, 0, 1.0, 0])), np.zeros(3))
    kept = []
    for average in (pycolmap.run_rotation_averaging, run_rotation_averaging):
        graph, target = pose_graph_of(pycolmap, path), unposed(pycolmap, reconstruction)
        edge = pycolmap.PoseGraphEdge(cam2_from_cam1=wrong, num_matches=50)
        graph.update_edge(*pairs[0], edge)
        assert average(pycolmap.RotationEstimatorOptions(), graph, target, [])
        kept.append(valid(graph))
    assert kept[0] == kept[1]
    assert [pair for pair, good in kept[1].items() if not good] == [pair_id_of(*pairs[0])]


def test_drop_in_starts_from_what_is_there_and_refuses_what_it_cannot(
    scene: tuple[Any, Any, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    pycolmap, reconstruction, path = scene
    options = pycolmap.RotationEstimatorOptions(skip_initialization=True)
    graph, target = pose_graph_of(pycolmap, path), pycolmap.Reconstruction(reconstruction)
    assert run_rotation_averaging(options, graph, target, method="bcd", max_iterations=1)
    assert target.num_reg_frames() == 6
    assert not run_rotation_averaging(options, pycolmap.PoseGraph(), target)
    with pytest.raises(GraphError, match="image 1 is not in the reconstruction"):
        run_rotation_averaging(options, graph, pycolmap.Reconstruction())
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(MissingExtraError, match=r'pip install "rotavg\[colmap\]"'):
        to_pose_graph(read(path))


def test_bad_pose_graphs() -> None:
    pytest.importorskip("pycolmap", reason=WITHOUT)
    I3 = np.eye(3)
    for edges, message in (
        ([["a", "b"]], "expected the image ids of a COLMAP database"),
        ([[-1, 2]], r"nodes run from -1 to 2, expected image ids"),
        ([[1, 2], [2, 1]], "edge 1 is a second one between the images 2 and 1"),
    ):
        with pytest.raises(GraphError, match=message):
            to_pose_graph(rotavg.MeasurementGraph(edges, [I3] * len(edges)))


def test_images_without_a_database(tmp_path: Path) -> None:
    graph = rotavg.simulate("cycle", 4, seed=1).graph
    solution = rotavg.solve(graph)
    write(tmp_path / "images.txt", solution)
    rows = [
        line.split()
        for line in (tmp_path / "images.txt").read_text().splitlines()
        if line and line[0] != "#"
    ]
    assert [(row[0], row[8], row[9]) for row in rows] == [
        (str(k + 1), "1", str(k)) for k in range(4)
    ]
    wxyz = np.array([[float(x) for x in row[1:5]] for row in rows])
    R = matrices_from_quaternions(wxyz[:, [1, 2, 3, 0]])
    np.testing.assert_allclose(R, np.swapaxes(solution.rotations, 1, 2), atol=1e-15)
    assert quaternions_from_matrices(R).shape == (4, 4)
    with pytest.raises(FormatError, match="colmap_images holds rotations alone"):
        read(tmp_path / "images.txt")
    with pytest.raises(FormatError, match="found a graph to write, expected a solution"):
        write(tmp_path / "images.txt", graph)
