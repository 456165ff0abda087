"""Focal lengths from EXIF data, against what the standard says."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("PIL", reason="needs rotavg[images]")

import PIL.Image

import rotavg
from rotavg.images.features import focal_length
from shared_data import shared_data

FOCAL_MM, PLANE_X, PLANE_UNIT, EQUIVALENT = 0x920A, 0xA20E, 0xA210, 0xA405
WIDTH, HEIGHT = 0xA002, 0xA003


def photograph(folder: Path, tags: dict[int, object], size: tuple[int, int] = (640, 480)) -> Path:
    image = PIL.Image.new("L", size)
    exif = image.getexif()
    exif.get_ifd(0x8769).update(tags)
    path = folder / "photo.jpg"
    image.save(path, exif=exif)
    return path


def test_35mm_equivalent_compares_diagonals(tmp_path: Path) -> None:
    # 35 mm film is 36 x 24; a photograph of that shape has its focal length in proportion.
    assert focal_length(photograph(tmp_path, {EQUIVALENT: 50}, (3600, 2400))) == pytest.approx(5000)
    path = photograph(tmp_path, {EQUIVALENT: 28, FOCAL_MM: 4.2}, (4000, 3000))
    assert focal_length(path) == pytest.approx(28 * 5000 / 43.2666153)


@pytest.mark.parametrize(("unit", "millimetres"), [(2, 25.4), (3, 10), (4, 1), (5, 0.001)])
def test_millimetres_and_the_sensors_resolution(
    tmp_path: Path, unit: int, millimetres: float
) -> None:
    tags = {FOCAL_MM: 5.5, PLANE_X: 120 * millimetres, PLANE_UNIT: unit, WIDTH: 1280, HEIGHT: 960}
    # 120 pixels a millimetre at 1280 pixels; the photograph was reduced to half of that.
    assert focal_length(photograph(tmp_path, tags)) == pytest.approx(5.5 * 120 / 2, rel=1e-4)


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {FOCAL_MM: 5.5},
        {EQUIVALENT: 0},
        {FOCAL_MM: 5.5, PLANE_X: 0, PLANE_UNIT: 2},
        {FOCAL_MM: 5.5, PLANE_X: 100, PLANE_UNIT: 9},
        {EQUIVALENT: 65000},
    ],
)
def test_without_a_plausible_one_the_error_names_the_file_and_the_option(
    tmp_path: Path, tags: dict[int, object]
) -> None:
    path = photograph(tmp_path, tags)
    with pytest.raises(rotavg.FormatError, match=r"photo\.jpg: found no .*--focal"):
        focal_length(path)


def test_a_zero_equivalent_falls_back_to_the_sensor(tmp_path: Path) -> None:
    tags = {EQUIVALENT: 0, FOCAL_MM: 5, PLANE_X: 1000, PLANE_UNIT: 3}
    assert focal_length(photograph(tmp_path, tags)) == pytest.approx(500)


def test_a_file_that_is_no_photograph(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_text("no photograph")
    with pytest.raises(rotavg.FormatError, match="no photograph that can be read"):
        focal_length(tmp_path / "a.jpg")


@pytest.mark.parametrize("name", ["ET/et000.jpg", "kermit/kermit010.jpg"])
def test_a_real_camera(name: str) -> None:
    # 5.40625 mm at 3106.796 pixels an inch
    assert focal_length(shared_data("images") / name) == pytest.approx(661.26, abs=0.01)
