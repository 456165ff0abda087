"""Files read at once, in compiled code, and line by line: the same graphs, the same errors."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

import rotavg
from rotavg.io import bulk
from rotavg.io.lines import exactly

SEED = 20261127
SUFFIXES = (".txt", ".csv", ".g2o", ".graph")
# What may stand where a number does, or between two, or at the end of a line.
ODD = (
    b"", b" ", b"\t", b",", b";", b"#", b"# a b", b"\r", b"\r\n", b"\n", b"\n\n", b"\0", b'"', b"-",
    b"+", b"+1", b"-0", b"007", b"1_0", b"0x1", b".5", b"5.", b".", b"1e5", b"1e", b"1e400",
    b"1e-400", b"nan", b"inf", b"a b", b"\xc3\xa9", b"\xff", b"99999999999999999999", b"FIX 1",
    b",,", b"\v", b"\f", b"VERTEX_SE3:QUAT 3 0 0 0 0 0 0 1\n", b"OTHER 1 2", b"\xef\xbb\xbf",
)  # fmt: skip


def outcome(path: Path, options: dict[str, object]) -> tuple[object, ...]:
    """All that reading this file comes to."""
    try:
        graph = rotavg.read(path, **options)
    except rotavg.Error as error:
        return type(error), str(error), getattr(error, "line", None)
    told = None if graph.translations is None else graph.translations.vectors.tobytes()
    spread = None if graph.covariances is None else graph.covariances.tobytes()
    return (
        graph.nodes.tolist(), graph.edges.tolist(), graph.rotations.tobytes(),
        graph.weights.tobytes(), graph.notes, told, spread, graph.nodes.dtype.kind,
    )  # fmt: skip


def both(path: Path, monkeypatch: pytest.MonkeyPatch, **options: object) -> None:
    """Check that both ways to read the file come to the same."""
    at_once = outcome(path, options)
    with monkeypatch.context() as patch:
        patch.setattr(bulk, "_read", lambda *arguments: None)
        assert at_once == outcome(path, options), path.read_bytes()


@pytest.fixture(scope="module")
def graph() -> rotavg.MeasurementGraph:
    simulation = rotavg.simulate("erdos_renyi", 12, density=0.5, noise=0.1, seed=SEED)
    weights = np.linspace(0.5, 2.0, simulation.graph.num_edges)
    return simulation.graph.with_weights(weights)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_of_ours_are_read_at_once(
    graph: rotavg.MeasurementGraph,
    suffix: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / f"graph{suffix}"
    rotavg.write(path, graph)
    both(path, monkeypatch)
    with monkeypatch.context() as patch:
        patch.setattr("rotavg.io.lines.number_table", None)  # of the other way
        patch.setattr("rotavg.io.table.number_table", None)
        patch.setattr("rotavg.io.g2o_lines.number_table", None)
        assert rotavg.read(path).num_edges == graph.num_edges


def test_names_are_read_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "graph.csv"
    path.write_bytes(b"from,to,qw,qx,qy,qz,what\na b,c,1,0,0,0,?\nc,d-1,1,0,0,0,\n")
    both(path, monkeypatch)
    monkeypatch.setattr("rotavg.io.table.number_table", None)
    assert rotavg.read(path).nodes.tolist() == ["a b", "c", "d-1"]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("unit_weights", [False, True])
def test_odd_files_come_to_the_same(
    graph: rotavg.MeasurementGraph,
    suffix: str,
    unit_weights: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / f"graph{suffix}"
    rotavg.write(path, graph)
    data = path.read_bytes()
    rng = np.random.default_rng([SEED, len(suffix), unit_weights])
    for _ in range(150):
        text = bytearray(data)
        for _ in range(rng.integers(1, 3)):
            at = int(rng.integers(len(text)))
            until = at + int(rng.choice([0, 0, 1, 5, 40]))
            text[at:until] = ODD[rng.integers(len(ODD))]
        path.write_bytes(text)
        both(path, monkeypatch, unit_weights=unit_weights)


@pytest.mark.parametrize(
    "data",
    [
        b"0 1 0 0 0 1\r\n1 2 0 0 0 1\r\n",
        b"0 1 0 0 0 1\r1 2 0 0 0 1\r",
        b"\xef\xbb\xbf0 1 0 0 0 1\n",
        b"0;1;0;0;0;1\n",
        b"0;1;0,5;0,5;0,5;0,5\n",
        b"i,j,qx,qy,qz,qw\n0,1,0,0,0,1,,\n1,2,0,0,0,1\n,,,,,\n",
        b"0 1 0 0 0 1 # one\n\n   \n# all\n1 2 0 0 0 1",
        b"18446744073709551615 1 0 0 0 1\n",
        b"99999999999999999999 1 0 0 0 1\n",
        b"a 1 0 0 0 1\nb 2 0 0 0 1\n",
        b"a,b;c,0,0,0,1\na,d,0,0,0,1\n",
        b"0 1,5 0 0 0 1\n",
        b"0 0 0 0 0 1\n0 1 0 0 0 1\n",
        b"0 1 0 0 0 0\n",
        b"0 1 0 0 0 1 0\n1 2 0 0 0 1 1\n",
    ],
)
def test_what_files_may_hold(data: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("graph.txt", "graph.csv"):
        (tmp_path / name).write_bytes(data)
        both(tmp_path / name, monkeypatch)
        both(tmp_path / name, monkeypatch, skip_self_edges=True, unit_weights=True)


def test_long_texts_keep_their_line_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [b"%d %d 0 0 0 1\n" % (k, k + 1) for k in range(250_000)]
    rows[123_456] += b"# nothing\n\n"
    rows[200_000] = b"7 7 0 0 0 1\n"  # in line 200003 of several megabytes
    path = tmp_path / "graph.txt"
    path.write_bytes(b"".join(rows))
    with pytest.raises(rotavg.FormatError, match="itself") as caught:
        rotavg.read(path)
    assert caught.value.line == 200_003


def test_numbers_are_written_as_python_does() -> None:
    rng = np.random.default_rng(SEED)
    bits = rng.integers(0, 2**64, 20_000, dtype=np.uint64)
    numbers = np.concatenate(
        [
            np.frombuffer(struct.pack(f"<{len(bits)}Q", *bits.tolist()), dtype=np.float64),
            rng.normal(size=20_000),
            10.0 ** rng.integers(-9, 24, 20_000) * rng.integers(-999, 999, 20_000),
            [
                0.0,
                -0.0,
                1e-4,
                1e-5,
                1e15,
                1e16,
                9999999999999998.0,
                5e-324,
                np.inf,
                -np.inf,
                np.nan,
            ],
        ]
    )
    nothing = np.empty((len(numbers), 0), dtype=np.int64)
    written = bulk.write_rows(nothing, numbers[:, None]).decode().split()
    assert written == exactly(numbers)
    short = bulk.write_rows(nothing, numbers[:, None], short_zeros=True).decode().split()
    assert short == ["0" if x == 0 else repr(x) for x in numbers.tolist()]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_both_ways_write_the_same(
    graph: rotavg.MeasurementGraph,
    suffix: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rotavg.write(tmp_path / f"a{suffix}", graph)
    monkeypatch.setattr("rotavg._text.knows_numbers", False)
    rotavg.write(tmp_path / f"b{suffix}", graph)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()
