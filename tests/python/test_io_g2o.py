"""g2o as its users write it."""

from __future__ import annotations

import pickle
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rotavg
from answers import random_answer
from rotavg.base.errors import FormatError, IncompleteWarning
from rotavg.graph.conventions import matrices_from_quaternions, quaternions_from_matrices
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io import read, write
from rotavg.simulation.simulate import simulate
from shared_data import shared_data

REAL = ["tinyGrid3D", "smallGrid3D", "sphere2500", "torus3D", "parking-garage"]
SOME_Q = "0.1 -0.2 0.3 0.9273618495495703"


def information(rotation: str = "4 0 0 4 0 4") -> str:
    k = rotation.split()
    return f"1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 {' '.join(k)}"


def pose(fields: list[bytes]) -> list[float]:
    return [float(field) for field in fields]


def xyzw(rotation: NDArray[np.float64]) -> list[float]:
    return quaternions_from_matrices(rotation).tolist()


def edge(i: int, j: int, q: str = SOME_Q, rotation: str = "4 0 0 4 0 4") -> str:
    return f"EDGE_SE3:QUAT {i} {j} 1 2 3 {q} {information(rotation)}"


MESSY = "\r\n".join(
    [
        "# a comment",
        "",
        "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1",
        "  VERTEX_SE3:QUAT   18446744073709551615 1.5  2.5 -3e-2   0 0 0 1   # the last one",
        "VERTEX_SE3:QUAT 77 9 9 9 0 0 0 1",
        edge(18446744073709551615, 3),
        "EDGE_XY 1 2 3",
        "FIX 3",
        "\tVERTEX_SE3:QUAT 3 7 8 9 0.5 0.5 0.5 0.5",
        edge(3, 12, "0 0 0.0105 1.05", "3 0 0 6 0 6") + " # a bit too long",
        "EDGE_XY 3 4 5",
        "   ",
        edge(12, 18446744073709551615) + "  ",
        "",
    ]
)


@pytest.fixture
def messy(tmp_path: Path) -> Path:
    path = tmp_path / "messy.g2o"
    path.write_bytes(MESSY.encode())
    return path


def test_reads_what_users_write(messy: Path) -> None:
    graph = read(messy)
    last = 18446744073709551615
    assert graph.nodes.tolist() == [3, 12, 77, last]
    assert graph.edges.tolist() == [[last, 3], [3, 12], [12, last]]
    # kappa = 3 / (2 tr(Omega^-1)): Omega = 4 I gives 2, diag(3, 6, 6) gives 3 / (2 * 2/3).
    np.testing.assert_allclose(graph.weights, [2, 2.25, 2], rtol=1e-15)
    some = matrices_from_quaternions([float(x) for x in SOME_Q.split()])
    np.testing.assert_allclose(graph.rotations[0], some, atol=1e-15)
    np.testing.assert_allclose(
        graph.rotations[1], matrices_from_quaternions([0, 0, 0.01, 1]), atol=1e-15
    )
    skipped, normalised = graph.notes
    assert skipped == "3 lines with unknown tags skipped (EDGE_XY: 2, PARAMS_SE3OFFSET: 1)"
    assert normalised.startswith("1 quaternion normalised")
    assert normalised.endswith("in line 10)")


def test_weight_of_a_full_information_matrix(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    omega = []
    for _ in range(50):
        factor = rng.standard_normal((6, 6)) * 10.0 ** rng.uniform(-3, 3)
        omega.append(factor @ factor.T)
    lines = [
        f"EDGE_SE3:QUAT {k} {k + 1} 0 0 0 0 0 0 1 "
        + " ".join(map(repr, o[np.triu_indices(6)].tolist()))
        for k, o in enumerate(omega)
    ]
    path = tmp_path / "full.g2o"
    path.write_text("\n".join(lines))
    expected = [1.5 / np.trace(np.linalg.inv(o[3:, 3:])) for o in omega]
    np.testing.assert_allclose(read(path).weights, expected, rtol=1e-8)
    assert read(path, unit_weights=True).weights.tolist() == [1.0] * 50


def test_information_must_be_positive_definite(tmp_path: Path) -> None:
    path = tmp_path / "flat.g2o"
    for flat in ("4 0 0 0 0 4", "1 2 0 1 0 1", "-1 0 0 -1 0 -1"):
        path.write_text("\n".join([edge(0, 1), edge(1, 2, rotation=flat)]))
        with pytest.raises(FormatError, match=r"flat\.g2o:2: .*not positive definite"):
            read(path)
        assert read(path, unit_weights=True).weights.tolist() == [1, 1]


def test_solution_goes_back_into_its_file(messy: Path, tmp_path: Path) -> None:
    graph = read(messy)
    answer = random_answer(graph, seed=5)
    out = tmp_path / "out.g2o"
    write(out, answer)
    new = out.read_bytes().split(b"\r\n")
    old = MESSY.encode().split(b"\r\n")
    # The file fixes node 3: it stays, and with it the gauge. 77 is a component of its own.
    world_from_3 = matrices_from_quaternions([0.5, 0.5, 0.5, 0.5])
    expected = world_from_3 @ answer.rotations[0].T @ answer.rotations
    where = rotavg.positions(graph, expected, fixed={0: [7, 8, 9], 2: [9, 9, 9]})
    # Node 12 has no vertex line: it gets one, before the first edge. All else stays, byte for byte.
    fields = new.pop(5).split()
    assert fields[:2] == [b"VERTEX_SE3:QUAT", b"12"]
    np.testing.assert_allclose(pose(fields[2:]), [*where[1], *xyzw(expected[1])], atol=1e-13)
    assert len(new) == len(old)
    for k, (before, after) in enumerate(zip(old, new)):
        if k == 3:
            start, end = b"  VERTEX_SE3:QUAT   18446744073709551615 ", b"   # the last one"
            assert after.startswith(start)
            assert after.endswith(end)
            found = pose(after[len(start) : -len(end)].split())
            np.testing.assert_allclose(found, [*where[3], *xyzw(expected[3])], atol=1e-13)
        elif k == 4:
            assert pose(after.split()[1:]) == [77, 9, 9, 9, 0, 0, 0, 1]
        else:
            assert after == before
    again = read(out)
    np.testing.assert_array_equal(again.edges, graph.edges)
    np.testing.assert_array_equal(again.weights, graph.weights)


def test_positions_that_overflow_are_told_and_the_rotations_written(tmp_path: Path) -> None:
    lines = [edge(k, k + 1, "0 0 0 1").replace(" 1 2 3 ", " 1e308 2 3 ") for k in range(2)]
    (tmp_path / "far.g2o").write_text("\n".join(lines) + "\n")
    solution = rotavg.solve(read(tmp_path / "far.g2o"))
    with pytest.warns(IncompleteWarning, match="too large or too far apart"):
        write(tmp_path / "out.g2o", solution)
    lines = (tmp_path / "out.g2o").read_text().splitlines()
    np.testing.assert_allclose(pose(lines[2].split()[5:]), solution.quaternions[2], atol=1e-14)


def test_fixed_landmarks_stay_fixed(tmp_path: Path) -> None:
    lines = ["VERTEX_XYZ 99 1 2 3", "FIX 0 3 99", "FIX 3", edge(0, 1), edge(1, 2), edge(3, 4)]
    (tmp_path / "a.g2o").write_text("\n".join(lines) + "\n")
    graph = read(tmp_path / "a.g2o")
    write(tmp_path / "b.g2o", graph)
    assert (tmp_path / "b.g2o").read_text().splitlines() == lines
    write(tmp_path / "c.g2o", graph.largest_component())
    assert (tmp_path / "c.g2o").read_text().splitlines() == [lines[0], "FIX 0 99", *lines[3:5]]


def test_solutions_of_unpickled_graphs_go_back(messy: Path, tmp_path: Path) -> None:
    graph = read(messy)
    write(tmp_path / "a.g2o", random_answer(graph, seed=5))
    write(tmp_path / "b.g2o", random_answer(pickle.loads(pickle.dumps(graph)), seed=5))
    assert (tmp_path / "a.g2o").read_bytes() == (tmp_path / "b.g2o").read_bytes()


def test_several_fixed_vertices_stay_where_they_are(tmp_path: Path) -> None:
    lines = [f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 {0.05 * k} 1" for k in range(6)]
    lines += [edge(k, k + 1) for k in range(5)]
    path = tmp_path / "fixed.g2o"
    path.write_text("\n".join([*lines, "FIX 1 4", "FIX 5"]) + "\n")
    write(tmp_path / "out.g2o", rotavg.solve(read(path)))
    new = (tmp_path / "out.g2o").read_text().splitlines()
    same = [before == after for before, after in zip(lines, new)]
    assert same[:6] == [False, True, False, False, True, True]


def test_components_keep_their_places(tmp_path: Path) -> None:
    quarter = f"0 0 {np.sqrt(0.5)} {np.sqrt(0.5)}"
    lines = [f"VERTEX_SE3:QUAT 0 5 5 5 {quarter}", "VERTEX_SE3:QUAT 7 -5 0 0 0 0 0 1"]
    lines += [edge(0, 1, "0 0 0 1"), edge(7, 8, "0 0 0 1")]
    path = tmp_path / "two.g2o"
    path.write_text("\n".join(lines) + "\n")
    write(tmp_path / "out.g2o", rotavg.solve(read(path)))
    new = [line.split() for line in (tmp_path / "out.g2o").read_text().splitlines()[:4]]
    found = {int(line[1]): [float(x) for x in line[2:]] for line in new}
    turned = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
    np.testing.assert_allclose(found[0], [5, 5, 5, *turned], atol=1e-14)
    np.testing.assert_allclose(found[1], [5 - 2, 5 + 1, 5 + 3, *turned], atol=1e-14)
    np.testing.assert_allclose(found[7], [-5, 0, 0, 0, 0, 0, 1], atol=1e-14)
    np.testing.assert_allclose(found[8], [-4, 2, 3, 0, 0, 0, 1], atol=1e-14)


def test_nodes_without_edges_survive(tmp_path: Path) -> None:
    graph = MeasurementGraph([[1, 2]], [np.eye(3)], nodes=[1, 2, 3])
    write(tmp_path / "alone.g2o", graph)
    assert read(tmp_path / "alone.g2o").nodes.tolist() == [1, 2, 3]
    write(tmp_path / "solved.g2o", rotavg.solve(read(tmp_path / "alone.g2o")))
    assert read(tmp_path / "solved.g2o").nodes.tolist() == [1, 2, 3]


def test_graph_goes_back_unchanged(messy: Path, tmp_path: Path) -> None:
    write(tmp_path / "same.g2o", read(messy))
    assert (tmp_path / "same.g2o").read_bytes() == MESSY.encode()


def test_new_weights_scale_the_rotation_information_only(messy: Path, tmp_path: Path) -> None:
    for unit_weights in (False, True):
        graph = read(messy, unit_weights=unit_weights)
        write(tmp_path / "w.g2o", graph.with_weights([graph.weights[0], 9.0, 1e-3]))
        new = (tmp_path / "w.g2o").read_bytes().splitlines()
        assert new[5] == MESSY.encode().splitlines()[5]
        assert new[9].endswith(b"# a bit too long")
        values = [float(x) for x in new[9].split()[10:31]]
        assert values[:15] == [float(x) for x in information().split()[:15]]
        weights = read(tmp_path / "w.g2o").weights
        np.testing.assert_allclose(weights, [2, 9, 1e-3], rtol=1e-14)


def test_part_of_a_graph_is_written_as_that_part(tmp_path: Path) -> None:
    lines = [f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 0 1" for k in range(5)]
    lines += [edge(0, 1), edge(1, 2), edge(3, 4)]
    path = tmp_path / "two.g2o"
    path.write_text("\n".join(lines) + "\n")
    part = read(path).largest_component()
    answer = random_answer(part, seed=2)
    write(tmp_path / "part.g2o", answer)
    new = (tmp_path / "part.g2o").read_text().splitlines()
    assert [line.split()[:2] for line in new[:3]] == [line.split()[:2] for line in lines[:3]]
    assert new[3:] == lines[5:7]
    np.testing.assert_array_equal(read(tmp_path / "part.g2o").nodes, [0, 1, 2])


def test_from_elsewhere_round_trip(tmp_path: Path) -> None:
    graph = simulate("sphere", 60, noise=0.3, seed=4).graph
    weights = np.random.default_rng(4).uniform(1e-3, 1e3, graph.num_edges)
    graph = MeasurementGraph(graph.edges, graph.rotations, weights)  # without translations
    write(tmp_path / "graph.g2o", graph)
    again = read(tmp_path / "graph.g2o")
    np.testing.assert_array_equal(again.edges, graph.edges)
    np.testing.assert_allclose(again.rotations, graph.rotations, atol=1e-14)
    np.testing.assert_allclose(again.weights, graph.weights, rtol=1e-14)

    answer = random_answer(graph, seed=9)
    write(tmp_path / "answer.g2o", answer)
    vertices = [x.split() for x in (tmp_path / "answer.g2o").read_text().splitlines()][:60]
    assert [v[:5] for v in vertices] == [
        ["VERTEX_SE3:QUAT", str(k), "0", "0", "0"] for k in range(60)
    ]
    written = np.array([[float(x) for x in v[5:]] for v in vertices])
    np.testing.assert_array_equal(written, answer.quaternions)
    np.testing.assert_array_equal(read(tmp_path / "answer.g2o").edges, graph.edges)


def test_names_cannot_be_written(tmp_path: Path) -> None:
    graph = MeasurementGraph([["a", "b"]], [np.eye(3)])
    with pytest.raises(FormatError, match=r"no\.g2o: nodes have names such as 'a'"):
        write(tmp_path / "no.g2o", graph)
    assert list(tmp_path.iterdir()) == []


def test_recognised_by_content(messy: Path) -> None:
    other = messy.with_suffix(".txt")
    messy.rename(other)
    assert read(other).num_edges == 3


def test_byte_order_mark_and_old_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "mark.g2o"
    path.write_bytes(b"\xef\xbb\xbf" + "\r".join([edge(0, 1), edge(1, 2)]).encode())
    assert read(path).num_edges == 2


@pytest.mark.parametrize("name", REAL)
def test_real_graph_round_trip(name: str, tmp_path: Path) -> None:
    path = shared_data(f"g2o/{name}.g2o")
    graph = read(path)
    answer = random_answer(graph, seed=1)
    write(tmp_path / "out.g2o", answer)
    again = read(tmp_path / "out.g2o")
    for attribute in ("nodes", "edges", "rotations", "weights"):
        np.testing.assert_array_equal(getattr(again, attribute), getattr(graph, attribute))
    old, new = path.read_bytes().splitlines(), (tmp_path / "out.g2o").read_bytes().splitlines()
    assert len(old) == len(new)
    gauge = answer.rotations[0].T  # every one of these files has its first node at the origin
    expected = gauge @ answer.rotations
    numbers = np.hstack([rotavg.positions(graph, expected), quaternions_from_matrices(expected)])
    row = {node: k for k, node in enumerate(graph.nodes.tolist())}
    for before, after in zip(old, new):
        if before.startswith(b"VERTEX"):
            b, a = before.split(), after.split()
            assert a[:2] == b[:2]
            found = np.array(pose(a[2:]))
            wanted = numbers[row[int(b[1])]]
            np.testing.assert_allclose(found[:3], wanted[:3], atol=1e-9)
            sign = np.sign(found[3:] @ wanted[3:])
            np.testing.assert_allclose(found[3:], sign * wanted[3:], atol=1e-13)
        else:
            assert after == before
    write(tmp_path / "graph.g2o", graph)
    assert (tmp_path / "graph.g2o").read_bytes() == path.read_bytes()


def test_real_graph_is_read_quickly() -> None:
    path = shared_data("g2o/sphere2500.g2o")
    read(path)
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        assert read(path).num_edges == 4949
        seconds.append(time.perf_counter() - start)
    print(f"sphere2500: {1e3 * min(seconds):.1f} ms")
    assert min(seconds) < 0.5  # 30 ms on a quiet machine
