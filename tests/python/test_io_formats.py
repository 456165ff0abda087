"""Every format: round trips, the family that it is in, the plane, translations."""

from __future__ import annotations

import bz2
import gzip
import lzma
import pickle
from pathlib import Path

import numpy as np
import pytest

import rotavg
from answers import random_answer
from random_graphs import random_graph
from rotavg.base.errors import FormatError, IncompleteWarning
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import FORMATS, read, write

NAMED = {"text", "csv", "npz", "glomap", "1dsfm"}
NUMBERED = {"text", "csv", "npz", "glomap", "1dsfm", "g2o", "toro", "irotavg", "open3d"}
WEIGHTLESS = {"1dsfm", "irotavg"}
FLAT = {
    "a.g2o": "EDGE_SE2 {i} {j} {x} {y} {a} 2 0.5 0.1 3 0.2 8\n",
    "a.graph": "EDGE2 {i} {j} {x} {y} {a} 2 0.5 3 8 0.1 0.2\n",
}


def by_pair(graph: MeasurementGraph) -> dict[tuple[object, object], np.ndarray]:
    """Rotation of every edge and, turned round, of its reverse."""
    pairs = {}
    for (i, j), R in zip(graph.edges.tolist(), graph.rotations):
        pairs[i, j], pairs[j, i] = R, R.T
    return pairs


def test_the_lists_above_are_complete() -> None:
    both = {form.name for form in FORMATS if form.read and form.write}
    assert both == NAMED | NUMBERED
    assert {form.name for form in FORMATS if not form.has_weights} == WEIGHTLESS


@pytest.mark.parametrize("told", [False, True], ids=["by content", "by name of the format"])
@pytest.mark.parametrize(
    ("name", "names"),
    [(name, True) for name in sorted(NAMED)] + [(name, False) for name in sorted(NUMBERED)],
)
def test_round_trip(tmp_path: Path, name: str, names: bool, told: bool) -> None:
    graph = random_graph(names, weighted=name not in WEIGHTLESS)
    write(tmp_path / "graph", graph, format=name)
    again = read(tmp_path / "graph", format=name if told else None)
    np.testing.assert_array_equal(again.nodes, graph.nodes)
    if name == "irotavg":  # its edges have i < j
        found, expected = by_pair(again), by_pair(graph)
        assert found.keys() == expected.keys()
        for pair, R in expected.items():
            np.testing.assert_allclose(found[pair], R, atol=1e-14)
    else:
        np.testing.assert_array_equal(again.edges, graph.edges)
        np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-14)
    np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-14)
    assert rotavg.solve(again).objective < 1e-20
    unit = read(tmp_path / "graph", format=name, unit_weights=True)
    assert set(unit.weights) == {1.0}
    # Graphs go to other processes with what they know of their files.
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(again)).edges, again.edges)


@pytest.mark.parametrize("name", sorted(WEIGHTLESS))
def test_lost_weights_are_told(tmp_path: Path, name: str) -> None:
    with pytest.warns(IncompleteWarning, match="the weights are not in it"):
        write(tmp_path / "graph", random_graph(False), format=name)


@pytest.mark.parametrize("name", sorted({"g2o", "toro", "irotavg"}))
def test_formats_without_names_say_so(tmp_path: Path, name: str) -> None:
    with pytest.raises(FormatError, match=r"nodes have names such as 'im/.*expected integers"):
        write(tmp_path / "graph", random_graph(True), format=name)
    assert list(tmp_path.iterdir()) == []


def test_names_tell_the_format(tmp_path: Path) -> None:
    known = {
        "a.g2o": "g2o", "a.graph": "toro", "a.toro": "toro", "EGs.txt": "1dsfm", "a.tum": "tum",
        "a_relpose.txt": "glomap", "a_glomap_rotations.txt": "glomap",
        "images.txt": "colmap_images",
        "my_images.txt": "text", "rotations.txt": "text",
        "a.irotavg": "irotavg", "a.rcd": "irotavg", "a.db": "colmap", "a.txt": "text",
        "a.csv": "csv", "a.NPZ": "npz",
    }  # fmt: skip
    for file, name in known.items():
        assert rotavg.io.registry.by_suffix(FORMATS, tmp_path / file).name == name, file


@pytest.mark.parametrize("suffix", ["txt", "csv", "npz"])
def test_the_user_may_tell_the_family_where_it_is_open(tmp_path: Path, suffix: str) -> None:
    graph = random_graph(True)
    write(tmp_path / f"g.{suffix}", graph)
    vision = read(tmp_path / f"g.{suffix}", convention="vision")
    np.testing.assert_allclose(vision.rotations, np.swapaxes(graph.rotations, 1, 2), atol=1e-14)
    assert rotavg.solve(vision).objective > 1e3  # of a consistent graph, so it is the wrong one


def test_fixed_families_stay_fixed(tmp_path: Path) -> None:
    write(tmp_path / "a.g2o", random_graph(False))
    write(tmp_path / "relpose.txt", random_graph(True))
    assert read(tmp_path / "a.g2o", convention="pose").num_nodes == 30
    with pytest.raises(FormatError, match="g2o is in the pose family by definition"):
        read(tmp_path / "a.g2o", convention="vision")
    with pytest.raises(FormatError, match="glomap is in the vision family by definition"):
        read(tmp_path / "relpose.txt", convention="pose")
    with pytest.raises(FormatError, match="convention is 'left', expected"):
        read(tmp_path / "a.g2o", convention="left")


@pytest.mark.parametrize("name", sorted(FLAT))
def test_the_plane(tmp_path: Path, name: str) -> None:
    angles = np.array([0.0, 2.0, -2.5, 1.0])
    where = np.array([[0, 0], [1, 0], [2, 3], [-1, 4.0]])
    lines = []
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2)):
        c, s = np.cos(angles[i]), np.sin(angles[i])
        x, y = np.array([[c, s], [-s, c]]) @ (where[j] - where[i])
        lines.append(FLAT[name].format(i=i, j=j, x=x, y=y, a=angles[j] - angles[i]))
    tag = "VERTEX_SE2" if name == "a.g2o" else "VERTEX2"
    lines[:0] = [f"{tag} {k} 9 9 0.5\n" for k in range(1, 4)] + [f"{tag} 0 0 0 0\n"]
    path = tmp_path / name
    path.write_text("".join(lines))
    graph = read(path)
    assert graph.weights.tolist() == [4] * 5  # half of 8: exp(-w |.|_F^2) has variance 1 / (2 w)
    omega = graph.translations.information[0]
    np.testing.assert_array_equal(omega, [[2, 0.5, 0], [0.5, 3, 0], [0, 0, 2.5]])
    write(tmp_path / f"out_{name}", rotavg.solve(graph))
    new = [line.split() for line in (tmp_path / f"out_{name}").read_text().splitlines()]
    found = np.array([[float(x) for x in line[1:]] for line in new[:4]])
    expected = np.column_stack([[1, 2, 3, 0], where[[1, 2, 3, 0]], angles[[1, 2, 3, 0]]])
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert [" ".join(line) for line in new[4:]] == [line.strip() for line in lines[4:]]
    # To the other dialect of the plane and back.
    other = next(iter(FLAT.keys() - {name}))
    write(tmp_path / f"other_{other}", graph)
    again = read(tmp_path / f"other_{other}")
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
    np.testing.assert_allclose(again.weights, graph.weights)
    np.testing.assert_array_equal(again.translations.vectors, graph.translations.vectors)
    np.testing.assert_array_equal(again.translations.information, graph.translations.information)


def test_a_tilted_answer_in_the_plane_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.g2o").write_text(FLAT["a.g2o"].format(i=0, j=1, x=1, y=2, a=0.5))
    answer = random_answer(read(tmp_path / "a.g2o"), seed=1)
    with pytest.warns(IncompleteWarning, match="cannot say that a node is tilted by"):
        write(tmp_path / "b.g2o", answer)


def test_the_larger_kind_of_lines_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mixed.g2o"
    space = "EDGE_SE3:QUAT {} {} 1 0 0 0 0 0 1 " + "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n"
    flat = FLAT["a.g2o"].format(i=0, j=1, x=1, y=2, a=0.5)
    path.write_text(space.format(0, 1) + space.format(1, 2) + flat + "VERTEX_SE2 0 0 0 0\n")
    graph = read(path)
    assert graph.num_edges == 2
    assert graph.notes == ("2 lines with unknown tags skipped (EDGE_SE2: 1, VERTEX_SE2: 1)",)


def test_translations_without_information_are_told(tmp_path: Path) -> None:
    path = tmp_path / "flat.g2o"
    zeros = "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 1 0 0 1 0 1"
    path.write_text(f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {zeros}\n")
    graph = read(path)
    assert graph.translations is None
    assert "translations not used" in graph.notes[0]


@pytest.mark.parametrize("name", ["a.npz", "a.graph", "a.g2o"])
def test_translations_come_along(tmp_path: Path, name: str) -> None:
    rng = np.random.default_rng(8)
    factor = rng.normal(size=(2, 3, 3))
    moved = rotavg.RelativeTranslations(
        rng.normal(size=(2, 3)), factor @ np.swapaxes(factor, 1, 2) + np.eye(3)
    )
    R = rotavg.simulate("complete", 3, seed=1).graph.rotations[:2]
    graph = MeasurementGraph([[0, 1], [1, 2]], R, translations=moved)
    write(tmp_path / name, graph)
    again = read(tmp_path / name).translations
    np.testing.assert_array_equal(again.vectors, moved.vectors)
    np.testing.assert_allclose(again.information, moved.information, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("gzip", gzip.compress(b"0 1 0.1 0 0\n")),
        ("bzip2", bz2.compress(b"0 1 0.1 0 0\n")),
        ("xz", lzma.compress(b"0 1 0.1 0 0\n")),
        ("zstd", bytes.fromhex("28b52ffd")),
    ],
)
def test_compressed_files_are_told(tmp_path: Path, name: str, data: bytes) -> None:
    path = tmp_path / "graph.g2o"
    path.write_bytes(data)
    for reader in (read, rotavg.read_rotations):
        with pytest.raises(FormatError, match=rf"is compressed \({name}\), unpack it first"):
            reader(path)
