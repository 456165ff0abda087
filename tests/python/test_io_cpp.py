"""The readers and writers in C++ (rotavg/io/*.hpp) beside those of the package: the same answers.

They are run by the program tests/cpp/read_files.cpp, named by ROTAVG_READ_FILES (ctest sets it).
"""

from __future__ import annotations

import os
import re
import subprocess
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from shared_data import shared_data
from tests.fuzz.good_files import good_files
from tests.fuzz.mutations import mutated, pick

PROGRAM = os.environ.get("ROTAVG_READ_FILES", "")
pytestmark = pytest.mark.skipif(not PROGRAM, reason="ROTAVG_READ_FILES names no program")
FORMATS = ("g2o", "text", "csv")
# In C++ ids are signed, TORO is not read, and blanks are those of ASCII.
DIFFERENT = (b"922337203685477580", b"EDGE2", b"EDGE3", b"VERTEX2", b"VERTEX3", b"\xe2\x80\xa8")


@dataclass
class Read:
    """What the program says of a file."""

    nodes: list[str]
    numbers: np.ndarray[Any, Any]  # of edges: rows, quaternion, weight; of nodes: matrices
    precisions: np.ndarray[Any, Any]


@dataclass
class Refused:
    line: int
    message: str


def run(requests: Sequence[tuple[str, Path]]) -> list[Read | Refused | bytes]:
    """One answer for each (format and letters, path)."""
    asked = "".join(f"{form} {path}\n" for form, path in requests)
    done = subprocess.run([PROGRAM], input=asked.encode(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return list(answers(done.stdout))


def answers(output: bytes) -> Iterator[Read | Refused | bytes]:
    while output:
        head, _, output = output.partition(b"\n")
        kind, *counts = head.split(b" ", 2) if head.startswith(b"refused") else head.split()
        if kind == b"refused":
            yield Refused(int(counts[0]), counts[1].decode(errors="replace"))
        elif kind == b"text":
            size = int(counts[0])
            yield output[:size]
            output = output[size:]
        else:
            count = [int(c) for c in counts]
            lines = output.split(b"\n", sum(count) if kind == b"graph" else 2 * count[0])
            output = lines.pop()
            n = count[0]
            if kind == b"graph":
                names, edges, spread = lines[:n], lines[n : n + count[1]], lines[n + count[1] :]
            else:
                names, edges, spread = lines[0::2], lines[1::2], []
            yield Read(
                [name.decode() for name in names],
                np.array([row.split() for row in edges], dtype=np.float64),
                np.array([row.split() for row in spread], dtype=np.float64).reshape(-1, 3, 3),
            )


def in_python(form: str, path: Path) -> rotavg.MeasurementGraph | tuple[Any, Any] | rotavg.Error:
    name, _, letters = form.partition(":")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if "r" in letters:
                return rotavg.read_rotations(
                    path, format=name, convention="vision" if "v" in letters else None
                )
            return rotavg.read(
                path,
                format=name,
                unit_weights="u" in letters,
                skip_self_edges="s" in letters,
                convention="vision" if "v" in letters else None,
            )
        except rotavg.Error as error:
            return error


def same(here: Any, there: Read | Refused | bytes, lines: bool) -> str:
    """What differs; nothing if they agree, also in the line that they refuse where `lines`."""
    if isinstance(here, rotavg.Error):
        if not isinstance(there, Refused):
            return f"Python alone refuses it: {here}"
        line = getattr(here, "line", None) or 0
        return "" if line == there.line or not lines else f"Python: {here}; C++: {there.message}"
    if not isinstance(there, Read):
        return f"C++ alone refuses it: {there}"
    if isinstance(here, tuple):
        nodes, rotations = here
        if [str(node) for node in nodes.tolist()] != there.nodes:
            return "other nodes"
        found = np.swapaxes(there.numbers.reshape(-1, 3, 3), 1, 2)  # columns were printed
        return "" if np.abs(found - rotations).max() < 1e-14 else "other rotations"
    if [str(node) for node in here.nodes.tolist()] != there.nodes:
        return "other nodes"
    if not (there.numbers[:, :2] == here.indices).all():
        return "other edges"
    quaternions = there.numbers[:, 2:6]
    off = np.minimum(
        np.abs(quaternions - here.quaternions).max(axis=1),
        np.abs(quaternions + here.quaternions).max(axis=1),
    )
    if off.max() > 1e-14:
        return f"other rotations, off by {off.max()}"
    if not np.allclose(there.numbers[:, 6], here.weights, rtol=1e-13, atol=0):
        return "other weights"
    if (here.covariances is None) != (len(there.precisions) == 0):
        return "covariances in one of them alone"
    if here.covariances is not None:
        unit = here.covariances @ there.precisions
        size = np.linalg.cond(here.covariances)
        if (np.abs(unit - np.eye(3)).max(axis=(1, 2)) > 1e-13 * size).any():
            return "other covariances"
    return ""


def compare(requests: Sequence[tuple[str, Path]], lines: bool = True) -> None:
    there = run(requests)
    assert len(there) == len(requests)
    wrong = []
    for (form, path), answer in zip(requests, there):
        difference = same(in_python(form, path), answer, lines)
        if difference:
            wrong.append(f"{form} {path}: {difference}")
    assert not wrong, "\n".join(wrong[:20])


def test_public_graphs_and_odd_files_are_read_alike() -> None:
    """The files that people published, and those that once fell short."""
    data, cases = shared_data("g2o"), shared_data("../cases")
    files = [("g2o", path) for path in sorted(data.glob("*.g2o"))]
    files += [("g2o", path) for path in sorted((cases / "g2o").glob("*.g2o"))]
    for folder in ("text", "bridges", "weights", "gravity"):
        files += [("text", path) for path in sorted((cases / folder).glob("*.txt"))]
    compare(files + [(f"{form}:u", path) for form, path in files])


ODD = {
    "g2o": (
        "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 7 0 0 0 0 0 0 0\nFIX 0\nXX 1\n"
        "EDGE_SE3:QUAT 0 +2 1 0 0 0 0 1 1.0001 " + "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 1 0 4 0 5\n",
        "EDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3\r\nEDGE_SE2 3 3 0 0 0 1 0 0 1 0 3\r\n",
        "EDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3\rEDGE_SE2 2 3 0 0 0 1 0 0 1 0 0\r",
        "EDGE_SE2 1 2 0 0 0.5\nEDGE_SE2 2 3 0 0 0.5\n",
        "EDGE_SE2 1 2 0 0 0.5\nEDGE_SE2 2 3 0 0 0.5 1 0 0 1 0 3\n",
        "EDGE_SE2 1 2 0 0 0.5 nan 0 0 1 0 3\n",
        "EDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 -3\n",
        "EDGE_SE2 1 2 0 0 1e999 1 0 0 1 0 3\n",
        "EDGE_SE2 1 2 0 0 1e-999 1 0 0 1 0 3\n",
        "EDGE_SE2 1 2.5 0 0 1 1 0 0 1 0 3\n",
        "EDGE_SE2 1 2\n",
        "EDGE_SE2 1\n",
        "EDGE_SE2\n",
        "FIX a\nEDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3\n",
        "VERTEX_SE2 1 0 0 nan\nEDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3\n",
        "VERTEX_SE2 1 0 0 nan\nEDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3\nFIX 1 2",
        "\xef\xbb\xbfEDGE_SE2 1 2 0 0 0.5 1 0 0 1 0 3",
        "VERTEX_SE2 1 0 0 0\nA\nB\nC\nD\nE\nF\nA\n",
        "A\0B\n",
        " \n",
    ),
    "text": (
        "# i j qx qy qz qw weight\n0 1 0 0 0 1 2\n",
        "0 1 0 0 0 1\n1 2 0 0 0.01 1\n2 2 0 0 0 1\n",
        "a b 0 0 0 1 0\nb c 0 0 0.1 1 1\n",
        "007 8 0 0 0 1\n",
        "9223372036854775807 -9223372036854775808 0 0 0 1\n",
        "i j\n",
        "0 1 0 0 0 2\n",
        "0 1 0 0 0 0\n",
        "0 1 0 0 0 x\n",
        "0 1 0 0 0 1\n0 1 0 0 0\n",
        "0 1 0 0 0 1 1 1\n",
        "0 1 0 0 1\n",
        "id qx qy qz qw\n0 0 0 0 1\n",
        "to,from,rz,rx,ry,extra\n2,1,0.3,0.1,0.2,x\n3,1,7,0,0,\n",
        "to,from,rz,rx,ry,extra\n2,1,0.3,0.1,0.2,x\n3,1,1,0,0,\n,,,\n",
        "name_i;name_j;r00;r01;r02;r10;r11;r12;r20;r21;r22\na;b;1;0;0;0;1;0;0;0;1,001\n",
        "i j r11 r12 r13 r21 r22 r23 r31 r32 r33\n1 2 1 0 0 0 1 0 0 0 -1\n",
        "i j r11 r12 r13 r21 r22 r23 r31 r32 r33\n1 2 1 0 0 0 1 0 0 0 1.2\n",
        "i j x y z w weights\n1 2 0 0 0 1 3\n",
        "u v qw qx qy qz w\n1 2 1 0 0 0 3\n",
        "i j qx qy qz qw cxx cxy cxz cyy cyz czz\n1 2 0 0 1 0 2 1 0 3 0 4\n",
        "i j qx qy qz qw cxx cxy cxz cyy cyz czz\n1 2 0 0 1 0 2 3 0 3 0 4\n",
        "one two three four five six\n",
        "1, 2, 0, 0, 0, 1\n2 , 3,0,0,0,1,\n",
        "\n",
        "sep=;\ni;j;qx;qy;qz;qw\n1;2;0;0;0;1\n",
        "SEP=,\n1,2,0,0,0,1\n",
        "sep=ab\n1 2 0 0 0 1\n",
        "sep=;;;;;;\ni;j;qx;qy;qz;qw\n1;2;0;0;0;1\n",
        "sep=,1\n1,2,0,0,0,1\n",
        "1 2 0 0 0 1\nsep=;\n",
    ),
    "csv": (
        'sep=,,,,,\n"i","j","qx","qy","qz","qw"\n"a b",c,0,0,0,1\n',
        'sep=,1\n"i","j","qx","qy","qz","qw"\n"a b",c,0,0,0,1\n',
        'sep=;\n"i";"j";"qx";"qy";"qz";"qw"\n"a b";c;0;0;0;1\n',
        'i,j,qx,qy,qz,qw\n"a, b","c""d",0,0,0,1\n"c""d",e,0,0,0.1,1\n',
        'i,j,qx,qy,qz,qw\n"a,0,0,0,1\n',
        'i,j,qx,qy,qz,qw\n"a"x,b,0,0,0,1\n',
        '# "quoted"\n1,2,0,0,0,1\n',
        'i;j;qx;qy;qz;qw\n"a;b";c;0,0;0;0;1,0\n',
        'i,j,qx,qy,qz,qw\n"","b",0,0,0,1\n',
        'i,j,qx,qy,qz,qw\n"a",b,,0,0,1\n',
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_odd_files_are_read_or_refused_alike(name: str, tmp_path: Path) -> None:
    requests = []
    for k, content in enumerate(ODD[name]):
        path = tmp_path / f"{k}.{name}"
        path.write_bytes(content.encode("latin-1"))
        letters = ("", "u", "s", "us") if name == "g2o" else ("", "u", "s", "v")
        if "id qx" in content:
            letters += ("r", "rv")
        requests += [(f"{name}:{these}" if these else name, path) for these in letters]
    compare(requests)


@pytest.mark.parametrize("name", FORMATS)
def test_spoilt_files_are_read_or_refused_alike(name: str, tmp_path: Path) -> None:
    """Of several faults either may name another. ROTAVG_FUZZ_CASES: how many files."""
    cases = int(os.environ.get("ROTAVG_FUZZ_CASES", "300"))
    good = good_files(tmp_path / "good")[name]
    requests = []
    for k in range(cases):
        rng = np.random.default_rng(2_000_000 + k)
        source = pick(rng, good)
        path = tmp_path / f"{k}_{source.name}"
        content = mutated(source, rng)
        if any(word in content for word in DIFFERENT):
            continue
        path.write_bytes(content)
        letters = "r" if source.parent.name == "s" and name != "g2o" else pick(rng, ("", "u", "s"))
        requests.append((f"{name}:{letters}", path))
    compare(requests, lines=False)


def test_what_is_written_is_the_same_text(tmp_path: Path) -> None:
    graph = rotavg.simulate("erdos_renyi", 30, density=0.3, noise=0.1, seed=3).graph
    names = [f"n {node}" for node in graph.nodes.tolist()]
    named = rotavg.MeasurementGraph(
        np.array(names)[graph.indices], graph.rotations, np.linspace(1, 3, graph.num_edges)
    )
    for name, item in (("g2o", graph), ("text", graph), ("csv", named)):
        path = tmp_path / f"{name}.dat"
        rotavg.write(path, item, format=name)
        (text,) = run([(f"{name}:w", path)])
        assert isinstance(text, bytes)
        rotavg.write(path, rotavg.read(path, format=name), format=name)
        # Both normalise what they read, and round once more as their compilers choose.
        number = re.compile(rb"-?\d[\d.]*(?:e[+-]?\d+)?")
        given, expected = text, path.read_bytes()
        assert number.sub(b"#", given) == number.sub(b"#", expected), name
        numbers = [np.array(number.findall(t), dtype=float) for t in (given, expected)]
        np.testing.assert_allclose(numbers[0], numbers[1], rtol=1e-15, atol=1e-15)


def test_poses_go_back_into_their_file(tmp_path: Path) -> None:
    """The same bytes but for the numbers of vertices, and these the same rotations."""
    path = tmp_path / "in.g2o"
    simulation = rotavg.simulate("sphere", 20, noise=0.05, seed=4)
    rotavg.write(path, rotavg.solve(simulation.graph))
    path.write_bytes(path.read_bytes().replace(b"EDGE", b"FIX 0\n# a comment\nX 1\nEDGE", 1))
    (text,) = run([("g2o:k", path)])
    assert isinstance(text, bytes)
    before, after = path.read_bytes().splitlines(), text.splitlines()
    assert len(before) == len(after)
    for old, new in zip(before, after):
        if old.startswith(b"VERTEX"):
            assert old.split()[:5] == new.split()[:5]  # where positions stay, on purpose
        else:
            assert old == new
    out = tmp_path / "out.g2o"
    out.write_bytes(text)
    graph = rotavg.read(path)
    nodes, rotations = rotavg.read_rotations(out)
    assert nodes.tolist() == graph.nodes.tolist()
    known, given = rotavg.read_rotations(path)
    assert (rotations[0] == given[known.tolist().index(0)]).all()  # fixed
    start = rotavg.solve(graph, init="shortest_path", max_iterations=0, certify=False).rotations
    turn = rotations[0] @ start[0].T
    assert np.abs(turn @ start - rotations).max() < 1e-12


@pytest.mark.parametrize("name", ["sphere2500", "parking-garage", "torus3D", "smallGrid3D"])
def test_positions_of_public_graphs_are_those_of_python(name: str, tmp_path: Path) -> None:
    check_positions(shared_data("g2o") / f"{name}.g2o", tmp_path)


def test_positions_in_odd_files_are_those_of_python(tmp_path: Path) -> None:
    """Information of all kinds, several components and fixed vertices, and the plane."""
    rng = np.random.default_rng(11)
    print("seed 11")
    for dimension in (3, 2):
        path = tmp_path / f"odd{dimension}.g2o"
        path.write_text(odd_pose_graph(rng, dimension))
        check_positions(path, tmp_path)


def check_positions(path: Path, folder: Path) -> None:
    """Poses as C++ writes them are as Python writes them: the gauge and the positions."""
    (text,) = run([("g2o:p", path)])
    assert isinstance(text, bytes)
    given = folder / "cpp.g2o"
    given.write_bytes(text)
    expected = folder / "python.g2o"
    graph = rotavg.read(path)
    start = rotavg.solve(graph, init="shortest_path", max_iterations=0, certify=False)
    rotavg.write(expected, start)
    poses = [
        {
            int(line.split()[1]): np.array(line.split()[2:], dtype=np.float64)
            for line in file.read_text().splitlines()
            if line.startswith("VERTEX")
        }
        for file in (given, expected)
    ]
    assert poses[0].keys() == poses[1].keys() == set(graph.nodes.tolist())
    here, there = (np.array([pose[node] for node in sorted(pose)]) for pose in poses)
    assert graph.translations is not None
    d = graph.translations.dimension
    size = np.abs(there[:, :d]).max()
    assert np.abs(here[:, :d] - there[:, :d]).max() < 1e-9 * max(1.0, size)


def odd_pose_graph(rng: np.random.Generator, dimension: int) -> str:
    """Two components, two fixed vertices in one of them, a node alone, and some vertices."""
    lines = []
    turn = 3 if dimension == 3 else 1

    def numbers(*values: np.ndarray[Any, Any]) -> str:
        return " ".join(repr(x) for x in np.concatenate(values).tolist())

    def pose() -> np.ndarray[Any, Any]:
        where = rng.normal(size=dimension)
        if dimension == 2:
            return np.append(where, rng.uniform(-3, 3))
        q = rng.normal(size=4)
        return np.append(where, q / np.linalg.norm(q))

    tag = "VERTEX_SE3:QUAT" if dimension == 3 else "VERTEX_SE2"
    lines += [f"{tag} {node} {numbers(pose())}" for node in (0, 3, 5, 30, 99)]
    tag = "EDGE_SE3:QUAT" if dimension == 3 else "EDGE_SE2"
    for first, count in ((0, 12), (20, 15)):
        pairs = [(first + k, first + k + 1) for k in range(count - 1)]
        pairs += [tuple(first + rng.choice(count, 2, replace=False)) for _ in range(count)]
        for i, j in pairs:
            root = rng.normal(size=(dimension + turn, dimension + turn))
            omega = root @ root.T + np.eye(dimension + turn)
            values = omega[np.triu_indices(dimension + turn)]
            lines.append(f"{tag} {i} {j} {numbers(pose(), values)}")
    return "\n".join([*lines, "FIX 3 5", ""])
