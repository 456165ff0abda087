"""Quaternions of other lengths than 1, and matrices of a few decimals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotavg
from rotavg.base.errors import FormatError, GraphError, IncompleteWarning
from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices
from rotavg.io import read, read_rotations
from small_files import I3, SOME, UNIT, cases, put, row, run


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
        (1e300 * I3, "matrix 0 is not a rotation: .* by inf; expected at most 0.1"),
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
