"""COLMAP databases without relative poses: these are computed, or it is told why not."""

from __future__ import annotations

import itertools
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rotavg
from rotavg.base.errors import FormatError, MissingExtraError
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.io import colmap_poses, read

FOCAL, CENTRE = 700.0, (320.0, 240.0)
K = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
NAMES = ["a.jpg", "b.jpg", "c.jpg"]
R = matrices_from_rotvecs([[0, 0, 0], [0.1, -0.2, 0.1], [-0.1, 0.15, 0.3]])  # camera_from_world
T = np.array([[0, 0, 0], [-1, 0.1, 0.2], [0.5, -0.6, 0.1]])
ZEROS, IDENTITY = np.zeros(4).tobytes(), np.array([1.0, 0, 0, 0]).tobytes()


def database(
    path: Path, kind: str, *, poses: bool = True, qvec: Any = None, tvec: Any = None, **changes: Any
) -> Path:
    """Three images of 40 points; pairs as COLMAP stores them, with E, F or H and without a pose."""
    rng = np.random.default_rng(7)
    X = np.column_stack([rng.uniform(-2, 2, (40, 2)), rng.uniform(4, 8, 40)])
    if kind == "H":
        X[:, 2] = 6 + 0.1 * X[:, 0] - 0.2 * X[:, 1]
    with closing(sqlite3.connect(path)) as c:
        c.execute("CREATE TABLE cameras (camera_id INTEGER, model INTEGER, width INTEGER, "
                  "height INTEGER, params BLOB, prior_focal_length INTEGER)")  # fmt: skip
        c.execute("CREATE TABLE images (image_id INTEGER, name TEXT, camera_id INTEGER)")
        c.execute(
            "CREATE TABLE keypoints (image_id INTEGER, rows INTEGER, cols INTEGER, data BLOB)"
        )
        c.execute("CREATE TABLE two_view_geometries (pair_id INTEGER, rows INTEGER, cols INTEGER, "
                  "data BLOB, config INTEGER, F BLOB, E BLOB, H BLOB"
                  + (", qvec BLOB, tvec BLOB)" if poses else ")"))  # fmt: skip
        params = np.array([FOCAL, *CENTRE]).tobytes()
        c.execute("INSERT INTO cameras VALUES (4, ?, 640, 480, ?, 1)",
                  (changes.get("model", 0), params))  # fmt: skip
        for k, name in enumerate(NAMES):
            x = (X @ R[k].T + T[k]) @ K.T
            points = np.column_stack([x[:, :2] / x[:, 2:], np.ones((40, 4))]).astype("<f4")
            c.execute("INSERT INTO images VALUES (?, ?, 4)", (k + 1, name))
            c.execute("INSERT INTO keypoints VALUES (?, 40, 6, ?)", (k + 1, points.tobytes()))
        matches = np.repeat(np.arange(40, dtype="<u4"), 2).tobytes()
        for i, j in itertools.combinations(range(3), 2):
            Q = R[j] @ R[i].T
            t = T[j] - Q @ T[i]
            E = np.cross(np.eye(3), t / np.linalg.norm(t)).T @ Q
            F = np.linalg.inv(K).T @ E @ np.linalg.inv(K)
            n = R[i] @ np.array([-0.1, 0.2, 1.0])
            d = 6.0 + n @ T[i]
            H = K @ (Q + np.outer(t, n) / d) @ np.linalg.inv(K)
            given = {"E": E, "F": F, "H": H}
            blobs = [given[name].tobytes() if name in kind else None for name in "FEH"]
            config = {"E": 2, "F": 3, "H": 4, "EF": 2}[kind]
            row = [
                2147483647 * (i + 1) + j + 1,
                40,
                2,
                changes.get("data", matches),
                config,
                *blobs,
            ]
            row += [qvec, tvec] if poses else []
            c.execute(f"INSERT INTO two_view_geometries VALUES ({', '.join('?' * len(row))})", row)
        c.commit()
    return path


def worst_deg(graph: rotavg.MeasurementGraph) -> float:
    row = {name: k for k, name in enumerate(NAMES)}
    error = 0.0
    for (i, j), found in zip(graph.edges.tolist(), graph.rotations):
        left = found.T @ R[row[i]] @ R[row[j]].T
        error = max(error, float(np.arccos(np.clip((np.trace(left) - 1) / 2, -1, 1))))
    return float(np.degrees(error))


@pytest.mark.parametrize("kind", ["E", "F", "H", "EF"])
@pytest.mark.parametrize("missing", ["NULL", "zeros", "identity", "no column"])
def test_poses_are_computed(tmp_path: Path, kind: str, missing: str) -> None:
    pytest.importorskip("pycolmap")
    stored = {"NULL": None, "zeros": ZEROS, "identity": IDENTITY, "no column": None}[missing]
    tvec = np.zeros(3).tobytes() if stored else None
    path = database(tmp_path / "x.db", kind, poses=missing != "no column", qvec=stored, tvec=tvec)
    before = path.read_bytes()
    graph = read(path)
    assert graph.edges.tolist() == [["a.jpg", "b.jpg"], ["a.jpg", "c.jpg"], ["b.jpg", "c.jpg"]]
    assert graph.weights.tolist() == [40] * 3
    assert worst_deg(graph) < (0.1 if kind == "H" else 0.02)
    old = ("the database is of a COLMAP too old to store relative poses",)
    told = "3 relative poses are computed from two-view geometry, inliers and cameras, as COLMAP "
    assert graph.notes == (*(old if missing == "no column" else ()), told + "stored none")
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.db"]


@pytest.mark.parametrize(
    ("kind", "changes"),
    [("E", {"model": 99}), ("E", {"data": None}), ("E", {"data": b"1234567"}),
     ("E", {"data": np.full(80, 77, dtype="<u4").tobytes()})],
)  # fmt: skip
def test_what_cannot_be_computed_is_told(tmp_path: Path, kind: str, changes: Any) -> None:
    pytest.importorskip("pycolmap")
    path = database(tmp_path / "x.db", kind, **changes)
    with pytest.raises(FormatError, match=r"none of the 3 .*\(no relative pose computed: 3\)"):
        read(path)


def test_one_bad_pose_spoils_no_others(tmp_path: Path) -> None:
    path = database(tmp_path / "x.db", "E", qvec=IDENTITY, tvec=np.ones(3).tobytes())
    for bad, why in (
        (np.array([5.0, 0, 0, 0]), "the stored pose is no rotation"),
        (np.full(4, np.nan), "the stored pose is no rotation"),
    ):
        with closing(sqlite3.connect(path)) as c:
            c.execute("UPDATE two_view_geometries SET qvec = ? WHERE pair_id = 2147483649",
                      (bad.tobytes(),))  # fmt: skip
            c.commit()
        graph = read(path)
        assert graph.num_edges == 2
        assert graph.notes == (f"1 pair skipped: {why}",)


def test_without_pycolmap_it_is_told_how(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def without(module: str, extra: str) -> Any:
        raise MissingExtraError(f"{module} {extra}")

    monkeypatch.setattr(colmap_poses, "require", without)
    hint = r'with pycolmap they are computed here: pip install "rotavg\[colmap\]"'
    path = database(tmp_path / "x.db", "E", poses=False)
    with pytest.raises(FormatError, match=rf"too old to store relative poses; {hint}"):
        read(path)
    path = database(tmp_path / "y.db", "E", qvec=IDENTITY, tvec=np.ones(3).tobytes())
    assert read(path).notes == ()
    with closing(sqlite3.connect(path)) as c:
        c.execute("UPDATE two_view_geometries SET qvec = ? WHERE pair_id = 2147483649", (ZEROS,))
        c.commit()
    skipped, told = read(path).notes
    assert skipped == "1 pair skipped: no relative pose computed"
    assert told == hint.replace("\\", "")
