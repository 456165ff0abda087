"""SIFT features of photographs (Lowe 2004), compared by Hellinger distance (RootSIFT)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError, require
from rotavg.images.focal import focal_from_exif

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")
# Half of OpenCV's default finds the faint features of small photographs.
_CONTRAST_THRESHOLD = 0.02


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph and its features; pixels as they are stored, whatever the orientation tag says.

    Attributes:
        name: file name, the node of the graph.
        width, height: in pixels.
        focal: focal length in pixels; the principal point is the middle, lens distortion is zero.
        points: (k, 2) x to the right and y down, in pixels; the middle of the first is (.5, .5).
        descriptors: (k, 128) uint8, square roots of SIFT's.
        scale: size of the image in which the features were found, relative to the photograph.
    """

    name: str
    width: int
    height: int
    focal: float
    points: NDArray[np.float64]
    descriptors: NDArray[np.uint8]
    scale: float = 1.0

    @property
    def rays(self) -> NDArray[np.float64]:
        """(k, 3) directions of the features in the camera's frame (x right, y down, z ahead)."""
        middle = np.array([self.width, self.height]) / 2
        rays = (self.points - middle) / self.focal
        return np.column_stack([rays, np.ones(len(rays))])


def find_photographs(folder: Path) -> list[Path]:
    """The photographs in a folder, by name; FormatError where there are fewer than two."""
    try:
        found = sorted(path for path in folder.iterdir() if _is_photograph(path))
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=folder) from error
    if len(found) < 2:
        known = " ".join(SUFFIXES)
        reason = f"found {len(found)} photographs in the folder, expected two or more ({known})"
        raise FormatError(reason, path=folder)
    return found


def _is_photograph(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and path.is_file()


def focal_length(path: Path) -> float:
    """Focal length in pixels from the EXIF data; FormatError if there is none or no photograph."""
    with _opened(path) as image:
        return focal_from_exif(image, str(path))


def extract(
    path: Path, focal: float, *, max_size: int = 1600, max_features: int = 8192
) -> Photograph:
    """Find the features of a photograph, reduced to `max_size` pixels on its longer side."""
    cv2 = require("cv2", "images")
    with _opened(path) as image:
        width, height = image.size
        scale = min(1.0, max_size / max(width, height))
        try:
            gray = _gray(image)
        except (OSError, SyntaxError, ValueError) as error:
            raise FormatError(f"found a broken photograph: {error}", path=path) from error
    if scale < 1:
        gray = gray.resize((max(1, round(width * scale)), max(1, round(height * scale))), 3)
    sift = cv2.SIFT_create(nfeatures=max_features, contrastThreshold=_CONTRAST_THRESHOLD)
    keypoints, descriptors = sift.detectAndCompute(np.asarray(gray), None)
    # OpenCV counts from the middle of the first pixel.
    points = np.array([keypoint.pt for keypoint in keypoints]).reshape(-1, 2) + 0.5
    if descriptors is None:
        descriptors = np.empty((0, 128))
    return Photograph(
        name=path.name,
        width=width,
        height=height,
        focal=focal,
        points=points * (np.array([width, height]) / gray.size),
        descriptors=_root(descriptors),
        scale=scale,
    )


def _gray(image: Any) -> Any:
    """The photograph in 8 bits; Pillow would cut 16 bits off, not divide them."""
    if not image.mode.startswith("I"):
        return image.convert("L")
    pil = require("PIL.Image", "images")
    return pil.fromarray((np.asarray(image) // 256).astype(np.uint8))


def _root(descriptors: NDArray[Any]) -> NDArray[np.uint8]:
    """Euclidean distance of the square roots is the Hellinger distance (Arandjelovic 2012)."""
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-12)
    roots = np.round(512 * np.sqrt(descriptors / total))
    return np.asarray(np.minimum(roots, 255), dtype=np.uint8)


def _opened(path: Path) -> Any:
    """The photograph as a `PIL.Image`, its pixels not read yet."""
    pil = require("PIL.Image", "images")
    try:
        return pil.open(path)
    except pil.UnidentifiedImageError as error:
        raise FormatError("found no photograph that can be read", path=path) from error
    except pil.DecompressionBombError as error:
        raise FormatError(f"found a photograph that is too large: {error}", path=path) from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=path) from error
