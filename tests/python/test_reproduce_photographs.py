"""Table 2 and Fig. 4 from photographs, on a simulated room; the real ones take a minute."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs rotavg[images]")

import rotavg
from photographs import FOCAL, TURNS_DEG, room_folder, rotations
from rotavg.graph.conventions import quaternions_from_matrices, wxyz_from_xyzw
from rotavg.reproduce import fig4, photographs, table2
from rotavg.reproduce.photographs import angles_deg, data_sets, errors_deg


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of a room, and its rotations as GLOMAP writes them: camera_from_world, wxyz."""
    folder = tmp_path_factory.mktemp("reproduce")
    R = room_folder(folder / "room")
    wxyz = wxyz_from_xyzw(quaternions_from_matrices(np.swapaxes(R, 1, 2)))
    lines = [f"{name}.png {' '.join(map(str, q))}" for name, q in zip("abcd", wxyz)]
    (folder / "room_glomap_rotations.txt").write_text("\n".join(lines) + "\n")
    return folder


def test_references_are_read_in_the_pose_family(folder: Path) -> None:
    read = photographs.find_references(folder, "room")
    np.testing.assert_allclose(list(read.values()), rotations(TURNS_DEG), atol=1e-15)
    assert photographs.find_references(folder, "other") == {}
    (folder / "bad.txt").write_text("a.png 1 0 0 0\nb.png 1 0 zero 0\n")
    with pytest.raises(rotavg.FormatError, match=r"bad\.txt:2: found 'b\.png"):
        photographs.reference_rotations(folder / "bad.txt")


def test_errors_do_not_depend_on_the_gauge() -> None:
    R = rotations([[10, 20, 30], [0, 50, 0], [-30, 0, 80], [5, 5, 5]])
    gauge, off = rotations([[70, -20, 10], [0, 0, 2]])
    names = "abcd"
    assert errors_deg(dict(zip(names, gauge @ R)), dict(zip(names, R))).max() < 1e-6
    moved = {**dict(zip(names, gauge @ R)), "a": gauge @ off @ R[0]}
    errors = errors_deg(moved, dict(zip(names, R)))
    assert errors[0] == pytest.approx(1.5, abs=0.01)  # 2 deg, of which the mean takes a quarter
    np.testing.assert_allclose(errors[1:], 0.5, atol=0.01)
    np.testing.assert_allclose(angles_deg(rotations([[0, 0, 120]])[0], np.eye(3)), 120)


def test_data_sets(folder: Path, tmp_path: Path) -> None:
    assert data_sets(folder) == {"room": folder / "room"}
    assert data_sets(folder / "room") == {"room": folder / "room"}
    with pytest.raises(rotavg.FormatError, match="no photographs"):
        data_sets(tmp_path)
    with pytest.raises(rotavg.FileAccessError, match="cannot be read"):
        data_sets(tmp_path / "missing")


def test_table2(folder: Path) -> None:
    told: list[str] = []
    outcome = table2.run(folder, references=folder, focal=FOCAL, progress=told.append)
    rows = outcome.data["rows"]
    assert [row["setting"] for row in rows] == list(table2.SETTINGS)
    cell = rows[0]["cells"]["SUM"]
    assert cell["verdict"] == "proved"
    assert cell["node_error_deg"] < 0.2
    assert 0 < cell["error"] < 0.02
    assert cell["error"] ** 2 <= cell["squared_error"] < 4e-4
    assert rows[0]["edge_error_deg"] < 0.2
    assert "| room | 4 | as by default | SUM |" in outcome.markdown
    assert told[-1] == "room: pairs 6 of 6"


def test_fig4(folder: Path) -> None:
    pytest.importorskip("pycolmap", reason="needs rotavg[colmap]")
    outcome = fig4.run(folder, references=folder, focal=FOCAL)
    (row,) = outcome.data["rows"]
    assert row["images_in_model"] == 4
    assert row["points"] > 100
    assert row["reprojection_error"] < 1
    assert row["rotavg_error_deg"] < 0.3
    assert row["final_error_deg"] < 0.3
    width, height = struct.unpack(">II", outcome.pictures["png"][16:24])
    assert width == 2000
    assert height > 500
    assert outcome.pictures["pdf"].startswith(b"%PDF")
