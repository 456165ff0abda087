"""From photographs to a graph: of a simulated room, and of the paper's own two sets."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs rotavg[images]")

import PIL.Image

import rotavg
from photographs import FOCAL, photograph, room_folder, rotations
from rotavg import images
from rotavg.images.matching import match
from rotavg.reproduce.photographs import angles_deg, reference_rotations
from shared_data import shared_data
from test_cli import run


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images") / "room"
    room_folder(folder)
    return folder


@pytest.fixture(scope="module")
def truth() -> dict[str, np.ndarray]:
    from photographs import TURNS_DEG

    return dict(zip(("a.png", "b.png", "c.png", "d.png"), rotations(TURNS_DEG)))


def test_relative_rotations_are_those_of_the_room(room: Path, truth: dict[str, np.ndarray]) -> None:
    steps: list[tuple[str, int, int]] = []
    measured = images.measure(room, focal=FOCAL, progress=lambda *step: steps.append(step))
    graph = measured.graph
    assert graph.nodes.tolist() == sorted(truth)
    assert graph.num_edges == 6
    for (i, j), i_from_j in zip(graph.edges.tolist(), graph.rotations):
        assert angles_deg(truth[i] @ i_from_j, truth[j]) < 0.3
    assert graph.weights.tolist() == [pair.num_inliers for pair in measured.pairs]
    assert graph.weights.min() > 100
    solution = rotavg.solve(graph)
    for name in truth:  # the gauge: a.png has the identity
        assert angles_deg(truth["a.png"] @ solution[name], truth[name]) < 0.3
    assert steps[0] == ("features", 0, 4)
    assert steps[-1] == ("pairs", 6, 6)


def test_the_same_photographs_give_the_same_bits(room: Path) -> None:
    a, b = (images.measure(room, focal=FOCAL, seed=5).graph for _ in range(2))
    assert a.rotations.tobytes() == b.rotations.tobytes()
    assert a.weights.tobytes() == b.weights.tobytes()


def test_a_reduced_photograph_keeps_its_geometry(
    room: Path, tmp_path: Path, truth: dict[str, np.ndarray]
) -> None:
    for name in ("a.png", "b.png"):  # twice the size, so twice the focal length
        with PIL.Image.open(room / name) as image:
            image.resize((640, 480), 3).save(tmp_path / name)
    measured = images.measure(tmp_path, focal=2 * FOCAL, max_size=320)
    assert measured.photographs[0].scale == 0.5
    assert measured.photographs[0].points[:, 0].max() > 400
    (i_from_j,) = measured.graph.rotations
    assert angles_deg(truth["a.png"] @ i_from_j, truth["b.png"]) < 0.5


def test_pairs_that_fail_say_why(room: Path, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        shutil.copy(room / name, tmp_path)
    PIL.Image.new("L", (320, 240), 128).save(tmp_path / "blank.png")
    photograph(np.eye(3), np.zeros(3), seed=77).save(tmp_path / "elsewhere.png")
    measured = images.measure(tmp_path, focal=FOCAL)
    reasons = {(pair.i, pair.j): pair.reason for pair in measured.pairs}
    assert reasons.pop(("a.png", "b.png")) == ""
    assert all(reason.startswith("too few") for reason in reasons.values())
    assert reasons["a.png", "blank.png"] == "too few matches (0)"
    assert measured.without_edge == ["blank.png", "elsewhere.png"]
    assert "blank.png, elsewhere.png" in measured.graph.notes[0]
    assert measured.graph.nodes.tolist() == ["a.png", "b.png"]
    (tmp_path / "a.png").unlink()
    with pytest.raises(rotavg.GraphError, match="none of the 3 pairs"):
        _ = images.measure(tmp_path, focal=FOCAL).graph


def test_matches_are_mutual_and_pass_the_ratio_test() -> None:
    rng = np.random.default_rng(3)
    first = rng.integers(0, 256, (60, 128)).astype(np.uint8)
    noise = rng.integers(-60, 61, (60, 128))
    second = np.clip(first[::-1].astype(int) + noise, 0, 255).astype(np.uint8)
    second[:5] = second[5:10]  # twins: nothing tells them apart
    D = np.linalg.norm(first[:, None].astype(float) - second[None].astype(float), axis=2)
    expected = []
    for k in range(60):
        nearest, next_nearest = np.argsort(D[k])[:2]
        if D[k, nearest] < 0.8 * D[k, next_nearest] and np.argmin(D[:, nearest]) == k:
            expected.append((k, int(nearest)))
    assert 30 < len(expected) < 60
    assert [tuple(row) for row in match(first, second, ratio=0.8).tolist()] == expected


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("focal", 0.0), ("focal", float("nan")), ("max_size", 3), ("max_features", 0),
        ("ratio", 0.0), ("ratio", 1.5), ("max_error", -1.0), ("min_inliers", 5), ("seed", -1),
    ],
)  # fmt: skip
def test_options_out_of_range(room: Path, option: str, value: float) -> None:
    with pytest.raises(rotavg.OptionError, match=f"{option} is"):
        images.measure(room, **{"focal": FOCAL, option: value})  # type: ignore[arg-type]


def test_command_line(room: Path, tmp_path: Path) -> None:
    output = tmp_path / "graph.csv"
    done = run("images", room, "-o", output, "--focal", FOCAL)
    assert done.returncode == 0, done.stderr
    assert "6, of which 6 with a relative rotation" in done.stdout
    assert "wrote" in done.stderr
    graph = rotavg.read(output)
    expected = images.measure(room, focal=FOCAL).graph
    assert graph.edges.tolist() == expected.edges.tolist()
    np.testing.assert_allclose(graph.rotations, expected.rotations, atol=1e-14)
    np.testing.assert_array_equal(graph.weights, expected.weights)
    done = run(
        "images", room, "-o", output, "--focal", FOCAL, "--unit-weights", "--json",
        "--min-inliers", 400,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    told = json.loads(done.stdout)
    assert [photo["focal"] for photo in told["photographs"]] == [FOCAL] * 4
    failed = [pair for pair in told["pairs"] if pair["reason"]]
    assert failed
    assert all(pair["reason"].startswith("too few") for pair in failed)
    assert (rotavg.read(output).weights == 1).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["room", "-o", "out.txt"], "a.png: found no focal length"),
        (["missing", "-o", "out.txt"], "missing: cannot be read: No such file"),
        (["empty", "-o", "out.txt"], "found 0 photographs in the folder"),
        (["room", "-o", "out.xyz", "--focal", "300"], "formats that are written"),
        (["room", "-o", "no/out.txt", "--focal", "300"], "cannot be written"),
        (["room", "-o", "out.g2o", "--focal", "300"], "names"),
        (["blanks", "-o", "out.txt", "--focal", "300"], "'a 1.png'"),
        (["room", "-o", "out.txt", "--focal", "-3"], "focal is -3.0"),
        (["broken", "-o", "out.txt", "--focal", "300"], "c.png: found"),
        (["room"], "Missing option"),
    ],
)
def test_bad_input(room: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    shutil.copytree(room, tmp_path / "room")
    (tmp_path / "empty").mkdir()
    for name in ("blanks", "broken"):
        (tmp_path / name).mkdir()
        shutil.copy(room / "b.png", tmp_path / name)
    shutil.copy(room / "a.png", tmp_path / "blanks" / "a 1.png")
    (tmp_path / "broken" / "c.png").write_bytes((room / "c.png").read_bytes()[:2000])
    before = sorted(tmp_path.rglob("*"))
    done = run("images", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(("name", "chosen"), [("ET", [0, 1, 2, 3]), ("kermit", [0, 1, 2, 5])])
def test_real_photographs(tmp_path: Path, name: str, chosen: list[int]) -> None:
    folder = shared_data("images") / name
    truth = reference_rotations(shared_data("relpose") / f"{name}_glomap_rotations.txt")
    for path in [sorted(folder.glob("*.jpg"))[k] for k in chosen]:
        shutil.copy(path, tmp_path)
    graph = images.measure(tmp_path).graph
    errors = [
        angles_deg(truth[i] @ i_from_j, truth[j])
        for (i, j), i_from_j in zip(graph.edges.tolist(), graph.rotations)
    ]
    assert len(errors) >= 5
    assert np.median(errors) < 2.5
