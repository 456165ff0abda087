"""Angles in degrees where radians are meant: refused or told, and read where that is said."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import rotavg
from rotavg.cli.main import commands

EDGES = [(i, j) for i in range(12) for j in range(i)]


def run(*arguments: Any) -> str:
    result = CliRunner().invoke(commands, [str(a) for a in arguments])
    assert result.exit_code in (0, 1), result.output + repr(result.exception)
    return result.output


def measured(size: float, noise: float, seed: int = 0) -> NDArray[np.float64]:
    """Rotation vectors, radians, between frames turned about so much."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    X = Rotation.from_rotvec(size * rng.standard_normal((12, 3)))
    R = [X[i].inv() * X[j] * Rotation.from_rotvec(noise * rng.standard_normal(3)) for i, j in EDGES]
    return np.array([r.as_rotvec() for r in R])


def written(path: Path, vectors: NDArray[np.float64], header: str = "i,j,rx,ry,rz") -> Path:
    rows = [f"{i},{j},{x!r},{y!r},{z!r}" for (i, j), (x, y, z) in zip(EDGES, vectors.tolist())]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    "names", ["rx_deg,ry_deg,rz_deg", "rotvec_x_degrees,rotvec_y_degrees,rotvec_z_degrees",
              "rx[deg],ry[deg],rz[deg]", "wx_deg,wy_deg,wz_deg"],
)  # fmt: skip
def test_a_header_says_degrees(tmp_path: Path, names: str) -> None:
    v = measured(1.0, 0.0)
    path = written(tmp_path / "g.csv", np.degrees(v), f"i,j,{names}")
    expected = rotavg.MeasurementGraph.from_rotvecs(EDGES, v)
    np.testing.assert_allclose(rotavg.read(path).rotations, expected.rotations, atol=1e-12)
    in_degrees = rotavg.MeasurementGraph.from_rotvecs(EDGES, np.degrees(v), degrees=True)
    np.testing.assert_allclose(in_degrees.rotations, expected.rotations, atol=1e-12)
    assert expected.notes == in_degrees.notes == ()
    mixed = written(tmp_path / "m.csv", np.degrees(v), "i,j,rx_deg,ry,rz_deg")
    with pytest.raises(rotavg.FormatError, match="found the header"):
        rotavg.read(mixed)
    path = written(tmp_path / "far.csv", np.degrees(v) * 8, f"i,j,{names}")
    with pytest.raises(rotavg.FormatError, match="expected degrees, at most 360"):
        rotavg.read(path)


def test_vectors_longer_than_a_turn_are_refused_with_the_way_out(tmp_path: Path) -> None:
    v = np.degrees(measured(1.0, 0.0))
    count = int((np.linalg.norm(v, axis=1) > 2 * np.pi + 0.01).sum())
    path = written(tmp_path / "g.csv", v)
    told = f"{count} of 66 rotation vectors are larger than a full turn"
    with pytest.raises(rotavg.FormatError, match=r"g\.csv:2: found a rotation vector of") as caught:
        rotavg.read(path)
    assert told in str(caught.value)
    assert "of degrees name the columns rx_deg, ry_deg, rz_deg" in str(caught.value)
    assert rotavg.read(path, columns="i,j,rx_deg,ry_deg,rz_deg").num_edges == 66
    with pytest.warns(UserWarning, match="are they degrees"):
        (note,) = rotavg.MeasurementGraph.from_rotvecs(EDGES, v).notes
    assert note.startswith(told)
    assert "are they degrees? radians are expected" in note
    assert "edge (1, 0)" in note
    whole = np.array([[4, 0, 0], [0, 1, 0], [0, 0, 5]])
    (note,) = rotavg.MeasurementGraph.from_rotvecs(EDGES[:3], whole).notes
    assert "2 of 3 rotation vectors are larger than half a turn, and all are whole numbers" in note
    path.write_text("i,j,rx,ry,rz\n0,1,4,0,0\n1,2,0,1,0\n2,0,0,0,5\n")
    (note,) = rotavg.read(path).notes
    assert "whole numbers (5 at most), first in line 2: of degrees name the columns" in note


def test_a_frame_in_degrees() -> None:
    pandas = pytest.importorskip("pandas")
    v = measured(1.0, 0.0)
    ends = {"i": [i for i, _ in EDGES], "j": [j for _, j in EDGES]}

    def frame(vectors: NDArray[np.float64], names: Sequence[str]) -> Any:
        return pandas.DataFrame({**ends, **dict(zip(names, vectors.T))})

    expected = rotavg.MeasurementGraph.from_rotvecs(EDGES, v)
    told = rotavg.MeasurementGraph.from_dataframe(
        frame(np.degrees(v), ("rx_deg", "ry_deg", "rz_deg"))
    )
    np.testing.assert_allclose(told.rotations, expected.rotations, atol=1e-12)
    assert told.notes == ()
    (note,) = rotavg.MeasurementGraph.from_dataframe(frame(np.degrees(v), ("rx", "ry", "rz"))).notes
    assert "are they degrees?" in note


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.005])
def test_small_rotations_in_degrees_are_known_by_their_cycles(tmp_path: Path, noise: float) -> None:
    v = np.degrees(measured(0.015, noise, seed=4))  # some 1.5 degrees: no vector is too long
    path = written(tmp_path / "g.csv", v)
    found = rotavg.suggest_reading(path)
    assert found is not None
    assert found.options == {"columns": "i,j,rx_deg,ry_deg,rz_deg"}
    assert "of rotation vectors in degrees they do" in str(found)
    assert found.noise < found.noise_as_read
    assert rotavg.suggest_reading(path, **found.options) is None
    assert "with --columns i,j,rx_deg,ry_deg,rz_deg" in run("info", path)
    rows = path.read_text().splitlines()[1:]
    path.write_text("\n".join(rows) + "\n")
    found = rotavg.suggest_reading(path, columns="i,j,rx,ry,rz", convention="pose")
    assert found is not None
    assert found.options == {"columns": "i,j,rx_deg,ry_deg,rz_deg", "convention": "pose"}


@pytest.mark.parametrize("size", [0.01, 0.3, 3.0])
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.3, 1.0])
def test_radians_are_not_taken_for_degrees(tmp_path: Path, size: float, noise: float) -> None:
    for seed in range(5):
        v = measured(size, noise, seed)
        found = rotavg.suggest_reading(written(tmp_path / "g.csv", v))
        assert found is None or "_deg" not in str(found.options)
        assert rotavg.MeasurementGraph.from_rotvecs(EDGES, v).notes == ()


def test_headings_and_roll_pitch_yaw(tmp_path: Path) -> None:
    flat = "1 0 0 1 0 1"
    solid = " ".join(["1"] + ["0"] * 5 + ["1"] + ["0"] * 4 + ["1"] + ["0"] * 3 + ["1 0 0 1 0 1"])
    texts = {
        "se2.g2o": "EDGE_SE2 0 1 1 0 {} " + flat + "\nEDGE_SE2 1 2 1 0 {} " + flat + "\n",
        "e2.graph": "EDGE2 0 1 1 0 {} 1 0 1 1 0 0\nEDGE2 1 2 1 0 {} 1 0 1 1 0 0\n",
        "e3.graph": f"EDGE3 0 1 1 0 0 0 0 {{}} {solid}\nEDGE3 1 2 1 0 0 0 {{}} 0 {solid}\n",
        "p.pyfg": f"EDGE_SE2 0 A0 A1 1 0 {{}} {flat}\nEDGE_SE2 1 A1 A2 1 0 {{}} {flat}\n",
        "r.jrl": json.dumps(
            {
                "name": "r",
                "robots": ["a"],
                "measurements": {
                    "a": [
                        {
                            "stamp": k,
                            "measurements": [
                                {
                                    "type": "BetweenFactorPose2",
                                    "key1": k,
                                    "key2": k + 1,
                                    "covariance": np.eye(3).ravel().tolist(),
                                    "measurement": {"type": "Pose2", "x": 1, "y": 0, "theta": "@"},
                                }
                            ],
                        }
                        for k in range(2)
                    ]
                },
            }
        ).replace('"@"', "{}").replace("{}", "\0").replace("{", "{{").replace("}", "}}")
        .replace("\0", "{}"),
    }  # fmt: skip
    for name, text in texts.items():
        path = tmp_path / name
        for pair, told in (
            ((90.5, -12.0), "2 of 2 angles are larger than a full turn (90.5 at most), first in"),
            ((0.5, 90), "1 of 2 angles is larger than a full turn"),
            ((0.5, -3.1), ""),
            ((1, 4), "whole numbers" if not name.startswith("e3") else ""),
        ):
            path.write_text(text.format(*pair))
            notes = [note for note in rotavg.read(path).notes if "degrees" in note]
            if name.startswith("e3") and pair == (1, 4):
                told = "whole numbers"
            assert len(notes) == bool(told), (name, pair, notes)
            for note in notes:
                assert told in note
                assert "are they degrees? radians are expected" in note
