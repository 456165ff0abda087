"""COLMAP's images.txt: the poses of a reconstruction; vision family, wxyz.

    IMAGE_ID qw qx qy qz tx ty tz CAMERA_ID NAME
    X Y POINT3D_ID ...                            the image's points; written empty

R and t are camera_from_world. Positions are solved for where the graph has translations, and are
zero where it has none. Ids are those of the database that the graph was read from; otherwise images
are numbered from 1 and share camera 1. Of what is read the names are the nodes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rotavg.base.errors import FormatError
from rotavg.graph.conventions import convert_family, quaternions_from_matrices, wxyz_from_xyzw
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.absolute import AbsoluteRotations, RotationReader, distinct, read_fields
from rotavg.io.colmap_database import ColmapImages
from rotavg.io.lines import BYTE_ORDER_MARK, exactly, ids_of, is_number, shown
from rotavg.io.placed import positions_of
from rotavg.io.registry import Format, Writable

_COLUMNS = ("IMAGE_ID", "qw", "qx", "qy", "qz", "tx", "ty", "tz", "CAMERA_ID", "NAME")
_TITLE = re.compile(rb"^#\s*IMAGE_ID, QW", re.MULTILINE)


def read_images(path: Path, data: bytes) -> AbsoluteRotations:
    """Read camera_from_world of every image."""
    rows = list(_poses(path, data))
    found = read_fields(path, rows, _COLUMNS, node="NAME")
    lines = [line for line, _ in rows]
    numbers = ids_of(path, [fields[0] for _, fields in rows], lines)
    return replace(found, image_ids=distinct(path, numbers, lines))


def _poses(path: Path, data: bytes) -> Iterator[tuple[int, list[bytes]]]:
    """(line number, fields) of the first line of every image; the second has its points."""
    lines = enumerate(data.removeprefix(BYTE_ORDER_MARK).splitlines(), start=1)
    for line, text in lines:
        if not text.strip() or text.lstrip().startswith(b"#"):
            continue
        yield line, text.strip().split(None, 9)  # a name may have blanks in it, and #
        line, points = next(lines, (line, b""))
        fields = points.split()
        if len(fields) % 3 or (fields and not is_number(fields[-1])):
            found = f"found {shown(points.strip())}"
            expected = "expected the image's points, or an empty line for none"
            raise FormatError(f"{found}, {expected}", path=path, line=line)


def write_images(path: Path, item: Writable) -> bytes:
    """The content of images.txt."""
    assert not isinstance(item, MeasurementGraph)
    solution = item
    graph = solution.graph
    R = convert_family(np.asarray(solution.rotations), COLMAP_IMAGES.convention)
    t = np.zeros((graph.num_nodes, 3))
    where = positions_of(solution)
    if where is not None:
        t = -np.einsum("nab,nb->na", R, where)
    names = [str(node) for node in graph.nodes.tolist()]
    known = graph.source if isinstance(graph.source, ColmapImages) else None
    images = [known.image_ids[name] if known else k for k, name in enumerate(names, start=1)]
    cameras = [known.camera_ids[name] if known else 1 for name in names]
    return "\n".join([*image_lines(path, images, R, t, cameras, names), ""]).encode()


def image_lines(
    path: Path,
    images: Sequence[int],
    R: ArrayLike,
    t: ArrayLike,
    cameras: Sequence[int],
    names: Sequence[str],
) -> list[str]:
    """The lines of images.txt: ids (n,), camera_from_world (n, 3, 3) and (n, 3), cameras, names."""
    quaternions = quaternions_from_matrices(np.asarray(R))
    rows = np.hstack([wxyz_from_xyzw(quaternions), np.asarray(t) + 0.0])
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] (none)"]
    for image, row, camera, name in zip(images, rows, cameras, names):
        if not name or len(name.splitlines()) > 1 or name != name.strip():
            found = f"found a node of the name {name!r}"
            raise FormatError(f"{found}, expected the name of an image", path=path)
        lines += [" ".join([str(image), *exactly(row), str(camera), name]), ""]
    return lines


COLMAP_IMAGES = Format(
    name="colmap_images",
    suffixes=("images.txt",),
    recognises=lambda head: _TITLE.search(head) is not None,
    read=None,
    has_graphs=False,
    write=write_images,
    convention="vision",
    rotations=RotationReader(
        _COLUMNS,
        read_images,
        recognises=lambda head: _TITLE.search(head) is not None,
        suffixes=("images.txt",),
    ),
    has_positions=True,
)
