"""Focal lengths in pixels from what cameras write into their photographs (EXIF 2.3)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rotavg.base.errors import FormatError

# Tags of the EXIF standard.
_EXIF_IFD = 0x8769
_FOCAL_LENGTH_MM = 0x920A
_WIDTH, _HEIGHT = 0xA002, 0xA003
_FOCAL_PLANE_X_RESOLUTION, _FOCAL_PLANE_RESOLUTION_UNIT = 0xA20E, 0xA210
_FOCAL_LENGTH_35MM = 0xA405

_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}  # inch, centimetre, millimetre, micrometre
_DIAGONAL_35MM = math.hypot(36.0, 24.0)  # 35 mm equivalents compare diagonals (CIPA DCG-001)
# In units of the longer side; a fish-eye has about 0.3, a long telephoto lens 20.
_PLAUSIBLE = (0.1, 50.0)


def focal_from_exif(image: Any, path: str) -> float:
    """Focal length in pixels of a `PIL.Image`, for the pixels as it holds them.

    From the 35 mm equivalent or, without one, from the focal length in millimetres and the pixels
    per millimetre of the sensor. Raises FormatError where neither is there or plausible.
    """
    tags = image.getexif().get_ifd(_EXIF_IFD)
    width, height = image.size
    candidates = (_from_35mm(tags, width, height), _from_sensor(tags, width, height))
    low, high = (bound * max(width, height) for bound in _PLAUSIBLE)
    for focal in candidates:
        if focal is not None and low <= focal <= high:
            return focal
    found = ", ".join(f"{focal:.4g} pixels" for focal in candidates if focal is not None)
    raise FormatError(
        f"found no {'plausible ' if found else ''}focal length in the photograph's EXIF data"
        f"{f' ({found})' if found else ''}, expected a 35 mm equivalent, or millimetres with the "
        "sensor's resolution; give it in pixels (focal, --focal)",
        path=path,
    )


def _from_35mm(tags: Mapping[int, Any], width: int, height: int) -> float | None:
    equivalent = _number(tags, _FOCAL_LENGTH_35MM)
    return None if equivalent is None else equivalent / _DIAGONAL_35MM * math.hypot(width, height)


def _from_sensor(tags: Mapping[int, Any], width: int, height: int) -> float | None:
    millimetres = _number(tags, _FOCAL_LENGTH_MM)
    resolution = _number(tags, _FOCAL_PLANE_X_RESOLUTION)
    unit = _UNIT_MM.get(int(_number(tags, _FOCAL_PLANE_RESOLUTION_UNIT) or 2))
    if millimetres is None or resolution is None or unit is None:
        return None
    # The resolution is that of the pixels that were taken; the photograph may have been reduced.
    taken = max(_number(tags, _WIDTH) or width, _number(tags, _HEIGHT) or height)
    return millimetres * resolution / unit * max(width, height) / taken


def _number(tags: Mapping[int, Any], tag: int) -> float | None:
    """A positive, finite number, or None: cameras write zeros and 0/0 for what they don't know."""
    try:
        value = float(tags[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return value if math.isfinite(value) and value > 0 else None
