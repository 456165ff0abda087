"""Rotations of COLMAP's models as others make them: images.bin, and pycolmap's `Reconstruction`.

    uint64 number of images, and of each
    uint32 IMAGE_ID, 7 doubles qw qx qy qz tx ty tz, uint32 CAMERA_ID, NAME and a zero byte,
    uint64 number of points, and of each two doubles and an uint64

Little-endian, camera_from_world; only images that have a pose are in it.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotavg.base.errors import FormatError, GraphError
from rotavg.graph.conventions import convert_family, matrices_from_quaternions, xyzw_from_wxyz
from rotavg.graph.ids import as_nodes
from rotavg.io.absolute import AbsoluteRotations, RotationReader
from rotavg.io.registry import Format
from rotavg.io.rounding import is_unit

_COUNT = struct.Struct("<Q")
_POSE = struct.Struct("<I7dI")
_POINT = 24  # bytes


def read_images_binary(path: Path, data: bytes) -> AbsoluteRotations:
    """Read camera_from_world of every image."""
    if len(data) < _COUNT.size:
        raise FormatError(f"found {len(data)} bytes (the file is damaged)", path=path)
    (count,) = _COUNT.unpack_from(data)
    at = _COUNT.size
    names, numbers, quaternions = [], [], []
    try:
        for _ in range(count):
            number, *pose, _camera = _POSE.unpack_from(data, at)
            at += _POSE.size
            end = data.index(b"\0", at)
            names.append(data[at:end].decode())
            numbers.append(number)
            quaternions.append(pose[:4])
            at = end + 1 + _COUNT.size + _POINT * _COUNT.unpack_from(data, end + 1)[0]
            if at > len(data):
                raise ValueError("it ends among the points of an image")
    except (struct.error, ValueError) as error:  # UnicodeDecodeError among them
        message = f"found no images of COLMAP after the first {len(names)}, expected {count}"
        raise FormatError(f"{message} (the file is damaged)", path=path) from error
    if at < len(data):
        found = f"found {len(data) - at} bytes after the last of {count} images"
        raise FormatError(f"{found}, expected none (the file is damaged)", path=path)
    if not names:
        raise FormatError("the model has no image with a pose", path=path)
    for name, q in zip(names, quaternions):
        if not is_unit(np.array(q)):
            found = f"the rotation of {name!r} is {q}"
            raise FormatError(f"{found}, expected a unit quaternion w x y z", path=path)
    try:
        nodes, ids = as_nodes(names), as_nodes(numbers)
    except GraphError as error:
        raise FormatError(str(error), path=path) from None
    R = matrices_from_quaternions(xyzw_from_wxyz(np.array(quaternions)))
    return AbsoluteRotations(nodes, R, image_ids=ids)


def is_reconstruction(value: Any) -> bool:
    """Whether this is a `pycolmap.Reconstruction`."""
    return type(value).__name__ == "Reconstruction" and hasattr(value, "reg_image_ids")


def of_reconstruction(reconstruction: Any) -> AbsoluteRotations:
    """World_from_image of the images with a pose; GraphError where none has one."""
    images = [image for _, image in sorted(reconstruction.images.items()) if image.has_pose]
    if not images:
        raise GraphError("the reconstruction has no image with a pose")
    R = np.array([image.cam_from_world().rotation.matrix() for image in images])
    found = AbsoluteRotations(as_nodes([image.name for image in images]), R)
    ids = as_nodes([int(image.image_id) for image in images])
    return replace(found, rotations=convert_family(R, "vision"), image_ids=ids)


COLMAP_BINARY = Format(
    name="colmap_binary",
    suffixes=("images.bin",),
    recognises=lambda head: False,
    read=None,
    has_graphs=False,
    has_solutions=False,
    write=None,
    convention="vision",
    main_file="images.bin",
    rotations=RotationReader((), read_images_binary, suffixes=("images.bin",)),
)
