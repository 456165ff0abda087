"""COLMAP's models: folders of texts or binaries, and pycolmap's reconstructions, in and out."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pycolmap", reason="pycolmap is not installed: pip install rotavg[colmap]")

import pycolmap

import rotavg
from colmap_scenes import Scene, rotations_of

FILES = ["cameras.txt", "frames.txt", "images.txt", "points3D.txt", "rigs.txt"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("models")
    made = Scene(folder / "rig.db", seed=11, noise=0.5, wrong=0.1, gravity=True)
    for name in ("text", "binary"):
        (folder / name).mkdir()
        getattr(made.reconstruction, f"write_{name}")(str(folder / name))
    return made


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rotavg", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def read_text(folder: Path) -> Any:
    model = pycolmap.Reconstruction()
    model.read_text(str(folder))
    assert model.is_valid()
    return model


def frames_of(model: Any) -> dict[int, tuple[int, set[str]]]:
    return {
        k: (frame.rig_id, {model.image(d.id).name for d in frame.data_ids})
        for k, frame in model.frames.items()
    }


def test_all_ways_to_name_a_model_are_read(scene: Scene) -> None:
    folder = scene.path.parent
    for path in (
        *(folder / "text", folder / "text" / "images.txt"),
        *(folder / "binary", folder / "binary" / "images.bin"),
    ):
        found = rotavg.read_rotations(path)
        assert set(found.nodes) == set(scene.truth)
        for node, R in zip(found.nodes.tolist(), found.rotations):
            np.testing.assert_allclose(R, scene.truth[node], atol=1e-14)
        numbers = rotavg.read_rotations(path, image_ids=True).nodes.tolist()
        names = [scene.reconstruction.image(k).name for k in numbers]
        assert names == found.nodes.tolist()
        assert rotavg.compare(path, scene.reconstruction).angles.max() < 1e-7


def test_reconstructions_are_compared_by_names_or_by_ids(scene: Scene) -> None:
    graph = rotavg.read(scene.path)
    solution = rotavg.solve(graph, loss="auto")
    expected = rotavg.compare(solution, scene.truth)
    for pair in ((solution, scene.reconstruction), (scene.reconstruction, solution)):
        assert rotavg.compare(*pair).rms == pytest.approx(expected.rms, rel=1e-9)
    ids = [graph.source.image_ids[name] for name in graph.nodes.tolist()]
    by_number = dict(zip(ids, solution.rotations))
    found = rotavg.compare(by_number, scene.reconstruction)
    assert found.rms == pytest.approx(expected.rms, rel=1e-9)
    part = pycolmap.Reconstruction(scene.reconstruction)
    part.deregister_frame(1)
    assert rotavg.compare(solution, part).only_in_rotations == 3
    for frame in list(part.reg_frame_ids()):
        part.deregister_frame(frame)
    with pytest.raises(rotavg.GraphError, match="the reconstruction has no image with a pose"):
        rotavg.compare(solution, part)


def test_damaged_binaries_are_told(scene: Scene, tmp_path: Path) -> None:
    data = (scene.path.parent / "binary" / "images.bin").read_bytes()
    path = tmp_path / "images.bin"
    for damaged in (data[:4], data[:100], data[:-1], data + b"x", b"\xff" * 8 + data[8:]):
        path.write_bytes(damaged)
        with pytest.raises(rotavg.FormatError, match=r"images\.bin: found .*damaged"):
            rotavg.read_rotations(path)
    path.write_bytes(bytes(8))
    with pytest.raises(rotavg.FormatError, match="the model has no image with a pose"):
        rotavg.read_rotations(path)
    path.write_bytes(data[:12] + bytes(32) + data[44:])
    with pytest.raises(rotavg.FormatError, match="expected a unit quaternion w x y z"):
        rotavg.read_rotations(path)
    with pytest.raises(rotavg.FormatError, match="colmap_binary holds rotations alone"):
        rotavg.read(path)
    path.unlink()
    with pytest.raises(rotavg.FileAccessError, match=r"colmap_binary: a folder with images\.bin"):
        rotavg.read_rotations(tmp_path)


def test_commands_take_model_folders(scene: Scene, tmp_path: Path) -> None:
    folder = scene.path.parent
    output = tmp_path / "images.txt"
    known = pycolmap.Reconstruction(scene.reconstruction)
    for frame in list(known.reg_frame_ids())[3:]:
        known.deregister_frame(frame)
    (tmp_path / "known").mkdir()
    known.write_binary(str(tmp_path / "known"))
    for options in (["--init", folder / "binary"], ["--fixed", tmp_path / "known"]):
        done = run("solve", scene.path, "--loss", "auto", "-o", output, *options)
        assert done.returncode == 0, done.stderr
        compared = run("compare", output, folder / "binary", "--json")
        assert compared.returncode == 0, compared.stderr
    for node, R in zip(*rotavg.read_rotations(tmp_path / "known")):  # these were held
        ids, found = rotavg.read_rotations(output)
        np.testing.assert_allclose(found[ids.tolist().index(node)], R, atol=1e-9)


def test_a_folder_gets_a_model_with_rigs_and_frames(scene: Scene, tmp_path: Path) -> None:
    output = tmp_path / "sparse"
    done = run("solve", scene.path, "--loss", "auto", "-o", f"{output}/")
    assert done.returncode == 0, done.stderr
    assert sorted(file.name for file in output.iterdir()) == FILES
    model = read_text(output)
    assert (model.num_rigs(), model.num_reg_frames(), model.num_reg_images()) == (2, 20, 60)
    assert model.num_points3D() == 0
    assert frames_of(model) == frames_of(scene.reconstruction)
    for k, camera in scene.reconstruction.cameras.items():
        assert str(model.camera(k)) == str(camera)
        np.testing.assert_array_equal(model.camera(k).params, camera.params)
    for k, rig in scene.reconstruction.rigs.items():
        for sensor, place in rig.non_ref_sensors.items():
            found = model.rig(k).sensor_from_rig(sensor)
            np.testing.assert_allclose(found.matrix(), place.matrix(), atol=1e-15)
    graph = rotavg.read(scene.path)
    priors = rotavg.read_priors(scene.path, graph)
    solution = rotavg.solve(graph, loss="auto", priors=priors)
    for name, R in rotations_of(model).items():
        np.testing.assert_allclose(R, solution[name], atol=1e-9)
    # Once more in its place, and not among what others have written.
    assert run("solve", scene.path, "-o", output, "--json").returncode == 0
    before = {file.name: file.read_bytes() for file in output.iterdir()}
    for name in ("points3D.txt", "mine.txt"):
        kept = before.get(name)
        (output / name).write_text("1 0 0 0 1 1 1 0.1\n")
        done = run("solve", scene.path, "-o", output)
        assert done.returncode == 2
        assert f"found {name} in it, which rotavg has not written" in done.stderr
        with pytest.raises(rotavg.FileAccessError, match="expected a new or empty folder"):
            rotavg.write(output, solution)
        (output / name).unlink()
        if kept is not None:
            (output / name).write_bytes(kept)
    assert before == {file.name: file.read_bytes() for file in output.iterdir()}


def test_images_stand_alone_where_the_rigs_were_not_used(scene: Scene, tmp_path: Path) -> None:
    solution = rotavg.solve(rotavg.read(scene.path), loss="auto")
    with pytest.warns(rotavg.IncompleteWarning, match="the rigs are not in it, as its images"):
        rotavg.write(tmp_path / "apart", solution)
    model = read_text(tmp_path / "apart")
    assert (model.num_rigs(), model.num_frames(), model.num_reg_images()) == (6, 60, 60)
    for name, R in rotations_of(model).items():
        np.testing.assert_allclose(R, solution[name], atol=1e-14)


def test_estimated_sensors_and_parts_of_a_graph(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "rig.db", seed=12, noise=0.2)
    with sqlite3.connect(scene.path) as connection:
        connection.execute("UPDATE rig_sensors SET sensor_from_rig = NULL WHERE sensor_id = 3")
    connection.close()
    graph = rotavg.read(scene.path)
    gone = {name for name, frame in graph.source.rigs.images.items() if frame[0] == 4}
    part = graph.subgraph([name for name in graph.nodes.tolist() if name not in gone])
    solution = rotavg.solve(part, priors=rotavg.read_priors(scene.path, part), gauge="mean")
    assert solution.rigs is not None
    rotavg.write(tmp_path / "model", solution)
    model = read_text(tmp_path / "model")
    assert (model.num_rigs(), model.num_frames(), model.num_images()) == (2, 19, 57)
    for name, R in rotations_of(model).items():
        np.testing.assert_allclose(R, solution[name], atol=1e-9)
    sensor = pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=3)
    place = model.rig(1).sensor_from_rig(sensor)
    np.testing.assert_allclose(place.rotation.matrix().T, solution.rigs.rotation_of[3], atol=1e-14)
    np.testing.assert_array_equal(place.translation, np.zeros(3))


@pytest.mark.parametrize("old", [False, True])
def test_databases_without_rigs(tmp_path: Path, old: bool) -> None:
    scene = Scene(tmp_path / "plain.db", seed=13, cameras=1, noise=0.5)
    if old:  # before COLMAP 3.12
        with sqlite3.connect(scene.path) as connection:
            for table in ("frame_data", "frames", "rig_sensors", "rigs"):
                connection.execute(f"DROP TABLE {table}")
        connection.close()
    solution = rotavg.solve(rotavg.read(scene.path))
    rotavg.write(tmp_path / "model", solution, format="colmap_model")
    model = read_text(tmp_path / "model")
    assert model.num_reg_images() == model.num_reg_frames() == 20
    for name, R in rotations_of(model).items():
        np.testing.assert_allclose(R, solution[name], atol=1e-14)


def test_models_are_of_databases(scene: Scene, tmp_path: Path) -> None:
    rotavg.write(tmp_path / "g.csv", rotavg.simulate("cycle", 5, seed=1).graph)
    done = run("solve", tmp_path / "g.csv", "-o", tmp_path / "model")
    assert done.returncode == 2
    assert "the name does not tell the format" in done.stderr
    command = "solve", tmp_path / "g.csv", "-o", tmp_path / "model"
    done = run(*command, "--output-format", "colmap_model")
    assert done.returncode == 2
    assert "expected a COLMAP database, which has cameras" in done.stderr
    text = scene.path.parent / "text"
    before = (text / "images.txt").read_bytes()
    for source in (tmp_path / "g.csv", scene.path):  # a folder of others is not written to
        assert run("solve", source, "-o", text).returncode == 2
    assert (text / "images.txt").read_bytes() == before
    with sqlite3.connect(scene.path) as connection:
        connection.execute("UPDATE cameras SET model = 99 WHERE camera_id = 2")
    solution = rotavg.solve(rotavg.read(scene.path))  # (without its rigs, of which it would warn)
    with pytest.raises(rotavg.FormatError, match="camera 2 of the database is of the model 99"):
        rotavg.write(tmp_path / "model", solution)
    assert not (tmp_path / "model").exists()


def test_the_mapper_honours_gravity_and_the_loss(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "rig.db", seed=14, noise=1.0, wrong=0.1, gravity=True, frames=4)
    (tmp_path / "images").mkdir()
    errors = []
    for k, options in enumerate(([], ["--gravity", scene.path, "--gravity-weight", "1e6"])):
        output = tmp_path / f"scene{k}"
        settings = "--loss", "cauchy", "--loss-scale", 2, "--threads", 1, *options
        done = run("colmap", scene.path, tmp_path / "images", "-o", output, *settings)
        assert done.returncode == 0, done.stderr
        ids, R = rotavg.read_rotations(output / "rotations.npz")
        down = np.array([scene.truth[name].T @ [0, 1, 0] for name in ids.tolist()])
        tilts = np.einsum("nab,nb->na", R, down) - [0, 1, 0]
        errors.append(np.linalg.norm(tilts, axis=1).max())
    assert errors[1] < 1e-3 < errors[0], errors
    command = "colmap", scene.path, tmp_path / "images", "-o", tmp_path / "out"
    done = run(*command, "--gravity-weight", 1)
    assert done.returncode == 2
    assert "--gravity-weight is for --gravity" in done.stderr
    done = run(*command, "--loss", "l2", "--loss-scale", 1)
    assert done.returncode == 2
    assert "--loss-scale is for --loss" in done.stderr
