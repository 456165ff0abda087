"""Photographs of a room that is known: exact rotations to compare with, no file from outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("cv2", reason="needs rotavg[images]")
pytest.importorskip("PIL", reason="needs rotavg[images]")

import PIL.Image

from rotavg.graph.conventions import matrices_from_rotvecs

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
ROOM = np.array([4.0, 3.0, 5.0])  # half width, half height, half depth


def rotations(rotvecs_deg: list[list[float]]) -> NDArray[np.float64]:
    """world_from_camera (n, 3, 3) from rotation vectors in degrees."""
    return matrices_from_rotvecs(np.radians(rotvecs_deg))


def photograph(
    world_from_camera: NDArray[np.float64], centre: NDArray[np.float64], seed: int = 0
) -> PIL.Image.Image:
    """What a camera in the room sees: each ray meets one of six walls, all papered with noise."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([x, y, np.full_like(x, FOCAL)], axis=-1) @ world_from_camera.T
    with np.errstate(divide="ignore"):
        distances = (np.sign(rays) * ROOM - centre) / rays
    wall = np.argmin(distances, axis=-1)
    nearest = np.take_along_axis(distances, wall[..., None], axis=-1)
    points = centre + nearest * rays
    gray = np.zeros((HEIGHT, WIDTH))
    for axis in range(3):
        for side in (-1, 1):
            on = (wall == axis) & (np.sign(rays[..., axis]) == side)
            across = np.delete(points[on], axis, axis=-1)
            gray[on] = _paper(across, seed + 10 * axis + side)
    return PIL.Image.fromarray(np.clip(gray, 0, 255).astype(np.uint8))


def _paper(points: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Smooth noise of three sizes, by bilinear interpolation between random values."""
    total = np.full(len(points), 128.0)
    for size, contrast in ((0.8, 25.0), (0.3, 30.0), (0.12, 40.0)):
        grid = np.random.default_rng([seed + 100, int(100 * size)]).standard_normal((128, 128))
        place = points / size + 64
        low = np.floor(place).astype(int)
        u, v = (place - low).T
        i, j = low.T % 127
        total += contrast * (
            (1 - u) * (1 - v) * grid[i, j]
            + u * (1 - v) * grid[i + 1, j]
            + (1 - u) * v * grid[i, j + 1]
            + u * v * grid[i + 1, j + 1]
        )
    return total


# Towards a corner: two walls, and so no plane.
TURNS_DEG = [[0.0, 45, 0], [3, 52, 2], [-6, 38, 4], [5, 47, -15]]
CENTRES = np.array([[0.0, 0, 0], [-0.6, 0.1, 0.5], [0.5, -0.3, -0.4], [0.2, 0.5, 0.3]])


def room_folder(folder: Path, count: int = 4, suffix: str = ".png") -> NDArray[np.float64]:
    """Take photographs a.png, b.png, … in the room; returns world_from_camera (count, 3, 3)."""
    folder.mkdir(exist_ok=True)
    R = rotations(TURNS_DEG)[:count]
    for name, turn, centre in zip("abcd", R, CENTRES):
        photograph(turn, centre).save(folder / f"{name}{suffix}")
    return R
