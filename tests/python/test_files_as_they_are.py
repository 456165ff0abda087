"""Files as people have them: rounded, unnormalised, with NaN where nobody looks, of other tags."""

from __future__ import annotations

import csv
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import FormatError, GraphError, IncompleteWarning
from rotavg.cli.main import commands
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices
from rotavg.io import FORMATS, read, read_rotations, write
from rotavg.io.rotations import read_absolute

I3 = np.eye(3)
SOME = matrices_from_rotvecs(np.random.default_rng(5).standard_normal((6, 3)))
UNIT = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4"


def cases(name: str) -> Path:
    """A file of those on which the product fell short once; a test skips where it is absent."""
    default = Path(__file__).resolve().parents[3] / "shared" / "cases"
    path = Path(os.environ.get("ROTAVG_CASES", default)) / name
    if not path.exists():
        pytest.skip(f"{path} is not there; ROTAVG_CASES says where such files are")
    return path


def run(*arguments: Any, status: int = 0) -> str:
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        result = CliRunner().invoke(commands, [str(a) for a in arguments])
    if isinstance(result.exception, rotavg.Error):
        assert status == 2, result.exception
        return str(result.exception)
    assert result.exit_code == status, result.output
    return "\n".join([result.output, *(str(w.message) for w in warned)])


def put(folder: Path, name: str, *lines: str) -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def row(*values: Any) -> str:
    return " ".join(str(value) for value in np.hstack(values).tolist())


@pytest.mark.parametrize(
    "tag", ["TUTORIAL_EDGE_SE3:QUAT", "edge_se3:quat", "EDGE_SIM3:QUAT", "foo", "Edge3"]
)
@pytest.mark.parametrize("count", [6, 7, 9, 12, 14])
def test_a_file_named_g2o_is_g2o(tmp_path: Path, tag: str, count: int) -> None:
    numbers = "0 0 0 1 " * 4
    line = " ".join([tag, "0", *numbers.split()[: count - 2]])
    with pytest.raises(FormatError, match=f"x.g2o: the file has no edges.*found {tag}: 2"):
        read(put(tmp_path, "x.g2o", line, line))


def test_a_list_of_numbers_named_g2o_is_still_text(tmp_path: Path) -> None:
    assert read(put(tmp_path, "x.g2o", "0 1 0 0 0 1")).edges.tolist() == [[0, 1]]


def test_names_that_look_like_tags_are_names(tmp_path: Path) -> None:
    names = ["edge_1", "EDGE_2", "my_vertex_3"]
    rows = [f"{i} {j} 0 0 0 1" for i, j in zip(names, names[1:])]
    for name in ("x.txt", "x"):
        assert read(put(tmp_path, name, *rows)).nodes.tolist() == sorted(names)


@pytest.mark.parametrize("name", ["poses_tagged2", "tutorial_tags", "lower_tags"])
def test_cases_of_unknown_tags(name: str) -> None:
    with pytest.raises(FormatError, match=r"(?i)the file has no edges.*found .*VERTEX_SE3:QUAT: "):
        read(cases(f"g2o/{name}.g2o"))


@pytest.mark.parametrize("form", [form.name for form in FORMATS if form.write and form.has_graphs])
def test_nodes_without_edges_survive_or_their_loss_is_told(tmp_path: Path, form: str) -> None:
    source = tmp_path / "in.npz"
    write(source, rotavg.MeasurementGraph([[0, 1], [1, 2]], [I3, I3], nodes=[5, 0, 1, 2, 9]))
    out = tmp_path / "new" / "EGs.txt" if form == "1dsfm" else tmp_path / f"out.{form}"
    out.parent.mkdir(exist_ok=True)
    told = run("convert", source, out, "--output-format", form)
    found = read(out, format=form).num_nodes
    assert f": {found} nodes, 2 edges" in told
    assert (found == 5) == ("without an edge" not in told)
    if found < 5:
        assert f"2 nodes without an edge are not in it (5, 9), {form} has no place for such" in told
        with pytest.warns(IncompleteWarning, match="2 nodes without an edge"):
            write(out, read(source), format=form)


def test_a_vertex_that_is_fixed_needs_a_pose(tmp_path: Path) -> None:
    edges = [f"EDGE_SE3:QUAT {k} {k + 1} 1 0 0 0 0 0 1 {UNIT}" for k in range(2)]
    for pose, message in (
        ("0 0 0 0 0 0 0", "vertex 1 is fixed .line 4., but the quaternion is zero"),
        ("0 0 0 0 0 0 nan", "found nan"),
        ("nan 0 0 0 0 0 1", "found nan"),
        ("0 0 0 0 0 0 3", "found a quaternion of length 3"),
    ):
        path = put(tmp_path, "f.g2o", f"VERTEX_SE3:QUAT 1 {pose}", *edges, "FIX 1")
        with pytest.raises(FormatError, match=rf"f\.g2o:1: {message}"):
            read(path)
        # Without FIX the pose is a guess that is not needed.
        path = put(tmp_path, "g.g2o", f"VERTEX_SE3:QUAT 1 {pose}", *edges)
        write(tmp_path / "out.g2o", rotavg.solve(read(path)))
        ids, rotations = read_rotations(tmp_path / "out.g2o")
        assert sorted(ids.tolist()) == [0, 1, 2]
        np.testing.assert_allclose(rotations, np.broadcast_to(I3, (3, 3, 3)), atol=1e-12)


@pytest.mark.parametrize("kind", ["EDGE_SE3:QUAT 3 4", "EDGE_SE2 2 1", "EDGE3 3 3", "EDGE2 2 1"])
def test_pose_graphs_without_information(tmp_path: Path, kind: str) -> None:
    tag, moved, turned = kind.split()
    turn = "0 0 0 1" if turned == "4" else " ".join(["0.1"] * int(turned))
    move = " ".join(["1"] * int(moved))
    lines = [f"{tag} 0 1 {move} {turn}", f"{tag} 1 2 {move} {turn}"]
    path = put(tmp_path, "n.g2o", *lines)
    with pytest.raises(FormatError, match=r"n\.g2o:1: .*no information.*--unit-weights"):
        read(path)
    graph = read(path, unit_weights=True)
    assert graph.weights.tolist() == [1, 1]
    assert graph.notes == ("the edges have no information: every edge weighs 1",)
    run("convert", path, tmp_path / "out.g2o", "--unit-weights", "--output-format",
        "toro" if tag in ("EDGE3", "EDGE2") else "g2o")  # fmt: skip
    again = read(tmp_path / "out.g2o")
    np.testing.assert_allclose(again.weights, [1, 1])
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-15)
    some = [lines[0], f"{lines[1]} {' '.join(['0'] * {'3': 21, '2': 6}[moved])}"]
    assert read(put(tmp_path, "some.g2o", *some), unit_weights=True).num_edges == 2
    with pytest.raises(FormatError, match=r"some\.g2o:1: found .* numbers"):
        read(tmp_path / "some.g2o")


def test_no_information_about_a_rotation_is_no_edge(tmp_path: Path) -> None:
    nothing = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 0 0 0 0 0 0"
    lines = [f"EDGE_SE3:QUAT {k} {k + 1} 1 2 3 0 0 0 1 {UNIT}" for k in range(3)]
    path = put(tmp_path, "z.g2o", *lines, f"EDGE_SE3:QUAT 3 7 1 2 3 0 0 0 1 {nothing}")
    graph = read(path)
    assert (graph.num_edges, graph.nodes.tolist()) == (3, [0, 1, 2, 3, 7])
    assert graph.notes == ("1 edge of weight 0 is not used (it: 3 -> 7)",)
    assert graph.covariances is not None
    assert graph.translations is not None
    assert len(graph.covariances) == len(graph.translations) == 3
    assert read(path, unit_weights=True).num_edges == 4


def quaternion_files(folder: Path, q: str, wxyz: str) -> dict[str, Path]:
    """The quaternion `q` (xyzw), or the same as wxyz, in line 2 of a file of every kind."""
    return {
        "text": put(folder, "t.txt", "0 1 0 0 0 1", f"1 2 {q}"),
        "csv": put(folder, "c.csv", "0,1,0,0,0,1", f"1,2,{q.replace(' ', ',')}"),
        "glomap": put(folder, "g_relpose.txt", "a b 1 0 0 0 1 2 3", f"b c {wxyz} 1 2 3"),
        "irotavg": put(folder, "r.irotavg", "1 2 0", f"0 1 {wxyz}"),
        "g2o": put(folder, "x.g2o", "# .", f"EDGE_SE3:QUAT 0 1 1 2 3 {q} {UNIT}"),
    }


def rotation_files(folder: Path, q: str, wxyz: str) -> dict[str, Path]:
    return {
        "text": put(folder, "s.txt", "# id qx qy qz qw", f"1 {q}"),
        "csv": put(folder, "s.csv", "id,qx,qy,qz,qw", f"1,{q.replace(' ', ',')}"),
        "glomap": put(folder, "s_glomap_rotations.txt", "a 1 0 0 0", f"b {wxyz}"),
        "irotavg": put(folder, "s.irotavg", "1 0 0 0", wxyz),
        "tum": put(folder, "s.tum", "0 1 2 3 0 0 0 1", f"1 1 2 3 {q}"),
        "colmap_images": put(folder, "images.txt", "# .", f"7 {wxyz} 1 2 3 1 7.jpg", ""),
        "g2o": put(folder, "s.g2o", "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1",
                   f"VERTEX_SE3:QUAT 1 1 2 3 {q}"),
    }  # fmt: skip


@pytest.mark.parametrize("length", [0.14, 0.5, 0.9 - 1e-6, 1.1 + 1e-6, 1.4, 5, 13, 1e300])
def test_other_lengths_than_1_are_refused_in_every_format(tmp_path: Path, length: float) -> None:
    q, wxyz = row([0.6 * length, 0, 0, 0.8 * length]), row([0.8 * length, 0.6 * length, 0, 0])
    message = r":2: found a quaternion of length .*, expected length 1"
    for form, path in quaternion_files(tmp_path, q, wxyz).items():
        with pytest.raises(FormatError, match=message):
            read(path, format=form)
    for form, path in rotation_files(tmp_path, q, wxyz).items():
        with pytest.raises(FormatError, match=message):
            read_rotations(path, format=form)


@pytest.mark.parametrize("length", [0.95, 1.004, 1.09])
def test_lengths_that_rounding_explains_are_told(tmp_path: Path, length: float) -> None:
    q, wxyz = row([0.6 * length, 0, 0, 0.8 * length]), row([0.8 * length, 0.6 * length, 0, 0])
    told = f"1 quaternion normalised whose length was not 1 (off by up to {abs(length - 1):.3g}"
    expected = matrices_from_rotvecs([2 * np.arccos(0.8), 0, 0])
    for form, path in quaternion_files(tmp_path, q, wxyz).items():
        graph = read(path, format=form)
        assert f"{told}, in line 2)" in graph.notes
        R = graph.rotations[-1]
        np.testing.assert_allclose(R if form in ("text", "csv", "g2o") else R.T, expected)
    for form, path in rotation_files(tmp_path, q, wxyz).items():
        with pytest.warns(IncompleteWarning, match=r"1 quaternion normalised"):
            R = read_rotations(path, format=form)[1][-1]
        np.testing.assert_allclose(R if form in ("text", "csv", "g2o", "tum") else R.T, expected)


def test_directions_taken_for_a_quaternion_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    lines = []
    for k in range(20):
        t = rng.standard_normal(3)
        q = quaternions_from_matrices(matrices_from_rotvecs(rng.standard_normal(3)))
        lines.append(row(f"a{k} a{k + 1}", t / np.linalg.norm(t), q[[3, 0, 1, 2]]))
    with pytest.raises(FormatError, match="are the columns in another order"):
        read(put(tmp_path, "x_relpose.txt", *lines))


def test_cases_of_lengths(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"len13\.txt:1: found a quaternion of length 13"):
        read(cases("text/len13.txt"))
    message = run("solve", cases("text/two.txt"), "--fixed", cases("colmap/swapped/images.txt"),
                  status=2)  # fmt: skip
    assert "images.txt:3: found a quaternion of length 5.0984" in message


def test_a_time_stamp_is_a_number(tmp_path: Path) -> None:
    path = put(tmp_path, "t.txt", "timestamp x y z qx qy qz qw", "1.5 0 0 0 0 0 0 1")
    assert read_rotations(path, format="tum")[0].tolist() == ["1.5"]
    for stamp in ("img0.jpg", "timestamp", "1_0", "-"):
        put(tmp_path, "t.txt", "1.5 0 0 0 0 0 0 1", f"{stamp} 0 0 0 0 0 0 1")
        with pytest.raises(FormatError, match=rf"t\.txt:2: found '{stamp}', expected a time stamp"):
            read_rotations(path, format="tum")
    with pytest.raises(FormatError, match=r"found 'img0.jpg', expected a time stamp"):
        read_rotations(cases("text/hloc_ref.txt"), format="tum")


@pytest.mark.parametrize("nothing", ["nan", "inf", "-nan", "1e999"])
def test_what_is_not_read_need_not_be_finite(tmp_path: Path, nothing: str) -> None:
    t = f"{nothing} {nothing} {nothing}"
    graph = read(put(tmp_path, "x_relpose.txt", f"a b 1 0 0 0 {t}"))
    np.testing.assert_array_equal(graph.rotations, [I3])
    graph = read(put(tmp_path, "EGs.txt", f"0 1 {row(SOME[0].ravel())} {t}"))
    np.testing.assert_allclose(graph.rotations, SOME[:1])
    for form, path in {
        "tum": put(tmp_path, "s.tum", f"1 {t} 0 0 0 1"),
        "colmap_images": put(tmp_path, "images.txt", f"7 1 0 0 0 {t} 1 7.jpg", ""),
        "g2o": put(tmp_path, "s.g2o", f"VERTEX_SE3:QUAT 1 {t} 0 0 0 1"),
    }.items():
        np.testing.assert_array_equal(read_rotations(path, format=form)[1], [I3])
    with pytest.raises(FormatError, match="expected a finite number"):
        read(put(tmp_path, "y_relpose.txt", f"a b 1 0 0 {nothing} 0 0 0"))


def test_cases_of_nan() -> None:
    assert read(cases("glomap/n_relpose.txt")).num_edges == 2
    assert read(cases("1dsfm/nan_t")).num_edges == 6


@pytest.mark.parametrize("decimals", [2, 3, 4])
def test_matrices_of_a_few_decimals_are_projected_and_told(tmp_path: Path, decimals: int) -> None:
    rounded = np.round(SOME, decimals)
    lines = [f"{k} {k + 1} {row(R.ravel())} 0 0 0" for k, R in enumerate(rounded)]
    np.savez(tmp_path / "g.npz", edges=[[k, k + 1] for k in range(6)], rotations=rounded)
    np.savez(tmp_path / "s.npz", nodes=np.arange(6), rotations=rounded)
    off = np.abs(np.swapaxes(rounded, 1, 2) @ rounded - I3).max(axis=(1, 2))
    count, first = int((off > 1e-3).sum()), int(np.argmax(off > 1e-3))
    for path, place in ((put(tmp_path, "EGs.txt", *lines), f"line {first + 1}"),
                        (tmp_path / "g.npz", f"row {first}")):  # fmt: skip
        graph = read(path)
        assert np.abs(graph.rotations - SOME).max() < 10.0**-decimals
        np.testing.assert_allclose(graph.rotations, rotavg.nearest_rotation(rounded), atol=1e-12)
        if count == 0:
            assert graph.notes == ()
        else:
            assert graph.notes[0].startswith(f"{count} matri")
            assert graph.notes[0].endswith(f"(off by up to {off.max():.3g}, first in {place})")
    if count:
        with pytest.warns(IncompleteWarning, match="replaced by the nearest rotation"):
            R = read_rotations(tmp_path / "s.npz")[1]
    else:
        R = read_rotations(tmp_path / "s.npz")[1]
    assert np.abs(R - SOME).max() < 10.0**-decimals


def test_matrices_that_are_no_rotations_are_refused(tmp_path: Path) -> None:
    for wrong in (-SOME[0], np.diag([1, 1, -1]) @ SOME[0], 1.2 * SOME[0], 0 * SOME[0]):
        with pytest.raises(FormatError, match=r"EGs\.txt:1: the matrix is not a rotation"):
            read(put(tmp_path, "EGs.txt", f"0 1 {row(wrong.ravel())} 0 0 0"))


def test_case_of_three_decimals() -> None:
    (note,) = read(cases("1dsfm/dec3")).notes
    assert note.startswith("2 matrices replaced by the nearest rotation")


def test_names_with_blanks_in_a_list(tmp_path: Path) -> None:
    names = ["images/a b.jpg 0 525.3", "c  d.jpg", "e 0.jpg 0 1e3", "f.jpg 0 7", "sept 12"]
    put(tmp_path, "list.txt", *names)
    lines = [f"{k} {k + 1} {row(I3.ravel())} 0 0 0" for k in range(4)]
    graph = read(put(tmp_path, "EGs.txt", *lines))
    expected = ["images/a b.jpg", "c  d.jpg", "e 0.jpg", "f.jpg", "sept 12"]
    assert sorted(graph.nodes.tolist()) == sorted(expected)
    write(tmp_path / "out.csv", graph)
    assert sorted(read(tmp_path / "out.csv").nodes.tolist()) == sorted(expected)
    assert "images/0000 a.jpg" in read(cases("1dsfm/blanknames")).nodes.tolist()


def test_nearest_rotation() -> None:
    rng = np.random.default_rng(3)
    noisy = SOME + 0.01 * rng.standard_normal(SOME.shape)
    near = rotavg.nearest_rotation(noisy)
    U, _, Vt = np.linalg.svd(noisy)
    np.testing.assert_allclose(near, U @ Vt, atol=1e-12)
    np.testing.assert_allclose(rotavg.nearest_rotation(noisy[2]), near[2])
    assert rotavg.nearest_rotation(noisy.reshape(2, 3, 3, 3)).shape == (2, 3, 3, 3)
    for bad, message in (
        (np.full((3, 3), np.nan), "matrix 0 holds a NaN"),
        (-I3, "matrix 0 is not a rotation: its determinant is -1"),
        (np.stack([I3, 2 * I3]), "matrix 1 is not a rotation: .* by 3; expected at most 0.1"),
        (np.eye(4), r"shape \(4, 4\)"),
    ):
        with pytest.raises(GraphError, match=message):
            rotavg.nearest_rotation(bad)
    edges = [[0, 1], [1, 2]]
    off = np.stack([I3, 1.01 * SOME[0]])
    with pytest.raises(GraphError, match=r"edge 1 .*differs from the identity"):
        rotavg.MeasurementGraph(edges, off)
    graph = rotavg.MeasurementGraph(edges, off, tolerance=0.05)
    np.testing.assert_allclose(graph.rotations[1], SOME[0], atol=1e-12)
    with pytest.raises(GraphError, match=r"edge 1 \(1 -> 2\): .*expected at most 0.01"):
        rotavg.MeasurementGraph(edges, off, tolerance=0.01)


def rotations_of(count: int) -> NDArray[np.float64]:
    return matrices_from_rotvecs(np.random.default_rng(count).standard_normal((count, 3)))


def test_edges_of_weight_0_are_not_used() -> None:
    edges = np.array([[0, 1], [1, 2], [2, 0], [2, 3]])
    R = rotations_of(4)
    covariances = np.stack([(k + 1) * I3 for k in range(4)])
    graph = rotavg.MeasurementGraph(
        edges, R, [1, 0, 2, 0], covariances=covariances,
        translations=rotavg.RelativeTranslations(np.arange(12).reshape(4, 3)),
    )  # fmt: skip
    assert graph.edges.tolist() == [[0, 1], [2, 0]]
    assert graph.nodes.tolist() == [0, 1, 2, 3]
    assert graph.notes == ("2 edges of weight 0 are not used (the first: 1 -> 2)",)
    np.testing.assert_allclose(graph.rotations, R[[0, 2]], atol=1e-12)
    assert graph.translations is not None
    assert graph.covariances is not None
    assert graph.translations.vectors.tolist() == [[0, 1, 2], [6, 7, 8]]
    np.testing.assert_array_equal(graph.covariances, covariances[[0, 2]])
    assert rotavg.solve(graph).num_components == 2
    # Errors name edges as they were given.
    R[2, 0, 0] = 7
    with pytest.raises(GraphError, match=r"edge 2 \(2 -> 0\)") as caught:
        rotavg.MeasurementGraph(edges, R, [1, 0, 2, 0])
    assert caught.value.edge == 2
    with pytest.raises(GraphError, match="every edge has weight 0"):
        rotavg.MeasurementGraph(edges, R, np.zeros(4))
    full = rotavg.MeasurementGraph(edges, rotations_of(4))
    assert full.with_weights([0, 1, 1, 1]).edges.tolist() == edges[1:].tolist()


def test_edges_of_weight_0_in_files(tmp_path: Path) -> None:
    path = put(tmp_path, "z.txt", "0 1 0 0 0 1 2", "1 2 0 0 0 1 0", "2 0 0 0 0 1 -0.0")
    graph = read(path)
    assert graph.num_edges == 1
    assert "note: 2 edges of weight 0 are not used (the first: 1 -> 2)" in run("info", path)
    assert read(path, unit_weights=True).num_edges == 3
    put(tmp_path, "a_relpose.txt", "a b 1 0 0 0 0 0 0", "b c 1 0 0 0 0 0 0")
    put(tmp_path, "a_weight.txt", "b a 0", "b c 3")
    assert read(tmp_path / "a_relpose.txt").edges.tolist() == [["b", "c"]]
    np.savez(tmp_path / "w.npz", edges=[[0, 1], [1, 2]], rotations=[I3, I3], weights=[0.0, 1])
    assert read(tmp_path / "w.npz").edges.tolist() == [[1, 2]]


def test_self_edges_are_skipped_on_request(tmp_path: Path) -> None:
    edges, R = [["a", "b"], ["b", "b"], ["b", "c"]], rotations_of(3)
    with pytest.raises(GraphError, match=r"edge 1 .*it joins a node to itself"):
        rotavg.MeasurementGraph(edges, R)
    graph = rotavg.MeasurementGraph(edges, R, skip_self_edges=True)
    assert graph.edges.tolist() == [edges[0], edges[2]]
    assert graph.notes == ("1 edge from a node to itself is not used (it: 'b' -> 'b')",)
    path = put(tmp_path, "s.txt", "0 1 0 0 0 1", "1 1 0 0 0 1")
    with pytest.raises(FormatError, match=r"s\.txt:2: .*itself"):
        read(path)
    assert read(path, skip_self_edges=True).num_edges == 1
    for command in ("info", "solve"):
        assert "from a node to itself is not used" in run(command, path, "--skip-self-edges")
    run("convert", path, tmp_path / "t.txt", "--skip-self-edges")
    assert read(tmp_path / "t.txt").num_edges == 1


def test_rotations_that_irotavg_holds_fixed(tmp_path: Path) -> None:
    truth = rotations_of(4)  # world_from_node of the nodes 2, 5, 7, 11
    nodes, pairs = [2, 5, 7, 11], [(0, 1), (1, 2), (2, 3), (0, 3)]
    wxyz = quaternions_from_matrices(np.swapaxes(truth, 1, 2))[:, [3, 0, 1, 2]]
    edges = []
    for i, j in pairs:
        q = quaternions_from_matrices(truth[j].T @ truth[i])[[3, 0, 1, 2]]
        edges.append(row(f"{nodes[i]} {nodes[j]}", q))
    path = put(tmp_path, "g.irotavg", "4 4 2", *edges, *(row(q) for q in wxyz))
    graph = read(path)
    assert graph.notes == ("2 absolute rotations that are not fixed not read",)
    ids, held = read_rotations(path)
    assert ids.tolist() == [2, 5]
    np.testing.assert_allclose(held, truth[:2], atol=1e-14)
    told = run("solve", path, "-o", tmp_path / "s.npz")
    assert "2 rotations held fixed, as the graph's file says" in told
    np.testing.assert_allclose(read_rotations(tmp_path / "s.npz")[1], truth, atol=1e-8)
    fixed = dict(zip(ids.tolist(), held))
    solved = rotavg.solve(graph, priors=rotavg.Priors(fixed=fixed))
    np.testing.assert_allclose(solved.rotations, truth, atol=1e-8)
    # Those held stay bit by bit, whatever is measured.
    rest = [row(q) for q in wxyz]
    put(tmp_path, "h.irotavg", "4 4 2", *edges[:-1], "2 11 1 0 0 0", *rest)
    run("solve", tmp_path / "h.irotavg", "-o", tmp_path / "s.npz")
    np.testing.assert_allclose(read_rotations(tmp_path / "s.npz")[1][:2], truth[:2], atol=1e-14)
    for head, message in (
        ("4 4 5", "found f = 5 fixed rotations, expected 0 to 4"),
        ("4 4 -1", "found f = -1"),
        ("4 4 3", "found 2 absolute rot"),
    ):
        put(tmp_path, "b.irotavg", head, *edges, *(row(q) for q in wxyz[:2]))
        with pytest.raises(FormatError, match=message):
            read(tmp_path / "b.irotavg", format="irotavg")
    put(tmp_path, "n.irotavg", "4 4 0", *edges)
    with pytest.raises(FormatError, match="the file has no fixed rotations"):
        read_rotations(tmp_path / "n.irotavg")


def test_csv_is_a_table_from_its_first_line_on(tmp_path: Path) -> None:
    graph = rotavg.MeasurementGraph([["a b", "c"], ["c", "d"]], rotations_of(2), [1, 2])
    solution = rotavg.solve(graph)
    for item, header in ((graph, "i,j,qx,qy,qz,qw,weight"), (solution, "id,qx,qy,qz,qw")):
        write(tmp_path / "t.csv", item)
        with (tmp_path / "t.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(rows[0]) == header.split(",")
        assert {len(row) for row in rows} == {header.count(",") + 1}
        assert all(np.isfinite(float(row["qw"])) for row in rows)
    rotavg.write_edges(tmp_path / "t.csv", solution)
    assert (tmp_path / "t.csv").read_text().startswith("i,j,residual_deg")


def test_outputs_tell_components_apart(tmp_path: Path) -> None:
    edges = [["a", "b"], ["b", "c"], ["x", "y"]]
    solution = rotavg.solve(rotavg.MeasurementGraph(edges, rotations_of(3), nodes=[*"abcxyz"]))
    for name in ("s.txt", "s.csv", "s.npz"):
        write(tmp_path / name, solution)
        found = read_absolute(tmp_path / name)
        assert found.nodes.tolist() == [*"abcxyz"]
        assert found.component is not None
        assert found.component.tolist() == [0, 0, 0, 1, 1, 2]
        np.testing.assert_allclose(found.rotations, solution.rotations, atol=1e-15)
    assert (tmp_path / "s.csv").read_text().startswith("id,qx,qy,qz,qw,component\n")
    write(tmp_path / "g.txt", solution.graph.subgraph([*"abcxy"]))
    told = run("solve", tmp_path / "g.txt", "-o", tmp_path / "s_glomap_rotations.txt")
    assert "2 components, each with a gauge of its own, and glomap does not tell them apart" in told
    assert "apart" not in run("solve", tmp_path / "g.txt", "-o", tmp_path / "s.csv")


@pytest.mark.parametrize("place", range(21))
@pytest.mark.parametrize("word", ["inf", "nan", "1e999"])
def test_with_unit_weights_no_information_is_read(tmp_path: Path, place: int, word: str) -> None:
    values = UNIT.split()
    values[place] = word
    path = put(tmp_path, "in.g2o", f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {' '.join(values)}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read(path, unit_weights=True).num_edges == 1
    with pytest.raises(FormatError, match="expected a finite number"):
        read(path)


@pytest.mark.parametrize("word", ["1e308", "-1e200"])
def test_numbers_too_large_to_square_are_refused_without_a_warning(
    tmp_path: Path, word: str
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(FormatError, match="rotation vector of length inf"):
            read(put(tmp_path, "a.txt", "i j rx ry rz", f"0 1 {word} 0 0"))
        with pytest.raises(FormatError, match="quaternion of length inf"):
            read(put(tmp_path, "b.txt", f"0 1 {word} 0 0 1"))
        with pytest.raises(FormatError):
            read_rotations(put(tmp_path, "c.dat", f"0 1 2 3 0 0 {word} 1"))
