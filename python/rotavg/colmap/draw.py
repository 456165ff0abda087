"""A reconstruction as a picture: its points, and the cameras that saw them (matplotlib)."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, require
from rotavg.graph.conventions import convert_family
from rotavg.io import atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CAMERA = "tab:red"
_KEPT = (5.0, 95.0)  # percentiles of the points: a few stray ones would shrink the rest


@dataclass(frozen=True, eq=False)
class Scene:
    """Points and cameras, in a frame with x to the right, y ahead of the cameras and z up.

    Attributes:
        points: (p, 3), without a length that means anything.
        colours: (p, 3) in [0, 1].
        names: of the n images.
        world_from_camera: (n, 3, 3), columns x right, y down, z ahead.
        centres: (n, 3).
        view: (2,) half width and half height of the first image at depth 1.
    """

    points: NDArray[np.float64]
    colours: NDArray[np.float64]
    names: list[str]
    world_from_camera: NDArray[np.float64]
    centres: NDArray[np.float64]
    view: NDArray[np.float64]


def read_scene(model: Path) -> Scene:
    """Read a model folder of COLMAP's (pycolmap); FileAccessError if there is none."""
    pycolmap = require("pycolmap", "colmap")
    if not (model / "images.bin").is_file() and not (model / "images.txt").is_file():
        raise FileAccessError("cannot be read: it is no folder of a COLMAP model", path=model)
    found = pycolmap.Reconstruction(model)
    images = sorted((i for i in found.images.values() if i.has_pose), key=lambda i: i.name)
    cameras_from_world = np.array([i.cam_from_world().rotation.matrix() for i in images])
    R = convert_family(cameras_from_world, "vision")
    centres = np.array([image.projection_center() for image in images])
    points = np.array([point.xyz for point in found.points3D.values()]).reshape(-1, 3)
    colours = np.array([point.color for point in found.points3D.values()]).reshape(-1, 3) / 255
    ours = _upright(R)
    camera = images[0].camera
    view = np.array([camera.width, camera.height]) / 2 / camera.mean_focal_length()
    return Scene(
        points @ ours.T, colours, [i.name for i in images], ours @ R, centres @ ours.T, view
    )


def draw(scene: Scene, ax: Axes, *, elevation: float = 15.0, turn: float = 15.0) -> None:
    """Draw points and cameras on axes as they are seen from far away.

    `elevation` and `turn` are the viewer's, in degrees: 0 and 0 look ahead as the cameras do, from
    behind them; 90 and 0 look down on them.
    """
    low, high = np.percentile(scene.points, _KEPT, axis=0)
    margin = 0.25 * (high - low)
    kept = ((scene.points >= low - margin) & (scene.points <= high + margin)).all(axis=1)
    screen = _screen(elevation, turn)
    x, y, depth = screen @ scene.points[kept].T
    far_first = np.argsort(-depth)
    ax.scatter(
        x[far_first], y[far_first], c=scene.colours[kept][far_first], s=7, linewidths=0, zorder=1
    )
    size = 0.07 * float(np.linalg.norm(np.ptp(np.vstack([scene.points[kept], scene.centres]), 0)))
    for R, centre in zip(scene.world_from_camera, scene.centres):
        corners = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) * [*scene.view, 1]
        corners = centre + size * corners @ R.T
        outline = [*corners, corners[0], centre, corners[1], corners[2], centre, corners[3]]
        x, y, _ = screen @ np.array(outline).T
        ax.plot(x, y, color=_CAMERA, linewidth=0.8, zorder=2)
    ax.set_aspect("equal")
    ax.set_axis_off()


def _screen(elevation: float, turn: float) -> NDArray[np.float64]:
    """Rotation (3, 3) to right, up and away as the viewer has them; angles in degrees."""
    e, t = np.radians([elevation, turn])
    right = np.array([np.cos(t), np.sin(t), 0])
    away = np.array([-np.sin(t) * np.cos(e), np.cos(t) * np.cos(e), -np.sin(e)])
    return np.array([right, np.cross(right, away), away])


VIEWS = {
    "from behind the cameras": {"elevation": 10.0, "turn": 15.0},
    "from above": {"elevation": 90.0, "turn": 0.0},
}


def save_picture(model: Path, output: Path) -> None:
    """Draw a model from behind the cameras and from above, to a .png, .pdf or .svg file.

    Raises FileAccessError if the file cannot be written; what was there before is untouched.
    """
    figures = require("matplotlib.figure", "plot")
    scene = read_scene(model)
    figure: Any = figures.Figure(figsize=(11, 5), layout="constrained")
    for ax, (title, angles) in zip(figure.subplots(1, len(VIEWS)), VIEWS.items()):
        draw(scene, ax, **angles)
        ax.set_title(title)
    figure.suptitle(f"{len(scene.names)} cameras, {len(scene.points)} points")
    stream = io.BytesIO()
    figure.savefig(stream, format=output.suffix[1:], dpi=150)
    atomic.write_files({output: stream.getvalue()})


def _upright(world_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation (3, 3) to the frame of a Scene: up and ahead are what they are to most cameras."""
    up = -world_from_camera[:, :, 1].mean(axis=0)
    ahead = world_from_camera[:, :, 2].mean(axis=0)
    up, ahead = (v if np.linalg.norm(v) > 1e-6 else e for v, e in zip((up, ahead), np.eye(3)))
    z = up / np.linalg.norm(up)
    x = np.cross(ahead, z)
    if np.linalg.norm(x) < 1e-6:  # all look down
        x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])
