"""Files as people have them: of other tags, with blanks, with NaN where nobody looks."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from rotavg.base.errors import FormatError, IncompleteWarning
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices
from rotavg.io import FORMATS, read, read_rotations, write
from rotavg.io.rotations import read_absolute
from small_files import I3, SOME, UNIT, cases, put, row, run


def rotations_of(count: int) -> NDArray[np.float64]:
    return matrices_from_rotvecs(np.random.default_rng(count).standard_normal((count, 3)))


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
    assert graph.notes[0] == "2 absolute rotations that are not fixed not read"
    assert graph.notes[1].startswith(
        "2 rotations held fixed; `rotavg solve` uses them where it can"
    )
    ids, held = read_rotations(path)
    assert ids.tolist() == [2, 5]
    np.testing.assert_allclose(held, truth[:2], atol=1e-14)
    told = run("solve", path, "-o", tmp_path / "s.npz")
    assert "2 rotations held fixed, as the graph's file says" in told
    np.testing.assert_allclose(read_rotations(tmp_path / "s.npz")[1], truth, atol=1e-8)
    fixed = dict(zip(ids.tolist(), held))
    for priors in (rotavg.Priors(fixed=fixed), rotavg.read_priors(path, graph)):
        solved = rotavg.solve(graph, priors=priors)
        np.testing.assert_allclose(solved.rotations, truth, atol=1e-8)
        assert "not used" not in str(solved)
    assert "not used    2 rotations held fixed, which the" in str(rotavg.solve(graph))
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
