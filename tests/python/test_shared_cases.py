"""Small files on which readers or solvers once fell short; skipped where they are absent."""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rotavg
from rotavg.cli.main import commands

CASES = Path(
    os.environ.get("ROTAVG_CASES", Path(__file__).resolve().parents[3] / "shared" / "cases")
)
LOSSES = ("auto", "huber", "l1", "l_half", "cauchy", "geman_mcclure", "tls")


def file(name: str) -> Path:
    path = CASES / name
    if not path.exists():
        pytest.skip(f"{path} is not there; ROTAVG_CASES says where the cases are")
    return path


def refused(*arguments: Any) -> str:
    """The error of a command."""
    result = CliRunner().invoke(commands, [str(a) for a in arguments])
    assert isinstance(result.exception, rotavg.Error), result.output
    return str(result.exception)


def done(*arguments: Any) -> str:
    """All that a command prints, with what it warns of."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = CliRunner().invoke(commands, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    return "\n".join([result.output, *(str(w.message) for w in told)])


@pytest.mark.parametrize("loss", LOSSES)
def test_bridges_change_no_verdict(loss: str) -> None:
    core, chain = (
        rotavg.solve(rotavg.read(file(f"bridges/pendant_{name}.txt")), loss=loss)
        for name in ("core", "chain")
    )
    assert core.solved
    assert chain.solved
    assert chain.robust.noise == pytest.approx(core.robust.noise, rel=1e-6)
    assert chain.is_outlier.sum() == core.is_outlier.sum() == 0


@pytest.mark.parametrize("name", ["ring_only", "advice"])
def test_a_ring_with_or_without_a_tail_needs_no_robust_loss(name: str) -> None:
    path = file(f"bridges/bridges_{name}.txt")
    assert "outliers?" not in done("solve", path)
    assert not rotavg.solve(rotavg.read(path), loss="auto").is_outlier.any()


def test_an_ordered_pose_graph(tmp_path: Path) -> None:
    path = file("g2o/kimera_ordered.g2o")
    solution = rotavg.solve(rotavg.read(path), loss="auto")
    assert solution.solved
    assert solution.is_outlier.sum() <= 1
    for name in ("a.csv", "a.txt", "a.irotavg", "a_relpose.txt", "a.json"):
        told = done("convert", path, tmp_path / name)
        found = rotavg.read(tmp_path / name).num_nodes
        assert f": {found} nodes, 153 edges" in told
        assert (found == 140) == ("without an edge" not in told)


@pytest.mark.parametrize("name", ["g_4_0.01_0", "g_8_0.001_2"])
def test_gravity_is_proved_by_default(name: str) -> None:
    gravity = file(f"gravity/{name}_gravity.txt")
    told = json.loads(done("solve", file(f"gravity/{name}.txt"), "--gravity", gravity, "--json"))
    assert told["certificate"]["verdict"] == "proved"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("poses_tagged2", "no edges: .*found TUTORIAL_VERTEX_SE3:QUAT"),
        ("tutorial_tags", "no edges: .*found TUTORIAL_EDGE_SE3:QUAT: 6"),
        ("lower_tags", "no edges: .*found edge_se3:quat: 6"),
        ("zeroq_fix", "g2o:1: vertex 0 is fixed .*quaternion is zero"),
        ("no_info", "g2o:6: .*no information.*--unit-weights"),
    ],
)
def test_g2o_files_that_are_refused(name: str, message: str) -> None:
    with pytest.raises(rotavg.FormatError, match=message):
        rotavg.read(file(f"g2o/{name}.g2o"))


def test_g2o_files_that_are_read(tmp_path: Path) -> None:
    graph = rotavg.read(file("g2o/no_info.g2o"), unit_weights=True)
    assert "no information" in graph.notes[0]
    told = done("convert", file("g2o/isolated_vertex.g2o"), tmp_path / "a.csv")
    assert ": 5 nodes" in told
    assert "1 node without an edge is not in it (17)" in told


def test_databases() -> None:
    graph = rotavg.read(file("colmap/zero_qvec.db"))
    assert graph.num_edges == 4
    assert any("no relative pose computed" in note for note in graph.notes)
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    old = rotavg.read(file("colmap/colmap36.db"))
    assert any("too old to store relative poses" in note for note in old.notes)


def test_quaternions_that_are_none() -> None:
    swapped = file("colmap/swapped/images.txt")
    assert "images.txt:3: found a quaternion of length 5.098" in refused(
        "solve", file("text/two.txt"), "--fixed", swapped
    )
    with pytest.raises(rotavg.FormatError, match=r"len13\.txt:1: found a quaternion of length 13"):
        rotavg.read(file("text/len13.txt"))
    with pytest.raises(rotavg.FormatError, match=r"hloc_ref\.txt:1: .*expected a time stamp"):
        rotavg.read_rotations(file("text/hloc_ref.txt"), format="tum")


def test_what_is_not_read_does_not_matter() -> None:
    assert rotavg.read(file("glomap/n_relpose.txt")).num_edges == 2
    assert rotavg.read(file("1dsfm/nan_t")).num_edges == 6
    assert "replaced by the nearest rotation" in rotavg.read(file("1dsfm/dec3")).notes[0]
    assert rotavg.read(file("1dsfm/blanknames")).nodes[0] == "images/0000 a.jpg"


def test_weights_and_outliers() -> None:
    graph = rotavg.read(file("weights/sequential_inliers.txt"))
    solution = rotavg.solve(graph, loss="auto")
    assert solution.is_outlier.sum() <= 1
    compared = rotavg.compare(solution, rotavg.read_rotations(file("weights/sequential_truth.txt")))
    assert np.degrees(compared.mean) <= 0.85
    solution = rotavg.solve(rotavg.read(file("weights/k5_one_outlier.txt")), loss="auto")
    assert solution.solved
    assert solution.is_outlier.sum() == 1
