"""COLMAP's images.txt, written only: the poses of a reconstruction; vision family, wxyz.

    IMAGE_ID qw qx qy qz tx ty tz CAMERA_ID NAME
    (an empty line: no points are observed)

R and t are camera_from_world. Positions are solved for where the graph has translations, and are
zero where it has none. Ids are those of the database that the graph was read from; otherwise images
are numbered from 1 and share camera 1.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rotavg.conventions import convert_family, quaternions_from_matrices, wxyz_from_xyzw
from rotavg.errors import FormatError
from rotavg.graph import MeasurementGraph
from rotavg.io.colmap_database import ColmapImages
from rotavg.io.lines import exactly
from rotavg.io.registry import Format, Writable
from rotavg.positions import positions


def write_images(path: Path, item: Writable) -> bytes:
    """The content of images.txt."""
    assert not isinstance(item, MeasurementGraph)
    solution = item
    graph = solution.graph
    R = convert_family(np.asarray(solution.rotations), COLMAP_IMAGES.convention)
    t = np.zeros((graph.num_nodes, 3))
    if graph.translations is not None:
        t = -np.einsum("nab,nb->na", R, positions(graph, solution.rotations))
    rows = np.hstack([wxyz_from_xyzw(quaternions_from_matrices(R)), t + 0.0])
    names = [str(node) for node in graph.nodes.tolist()]
    known = graph.source if isinstance(graph.source, ColmapImages) else None
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] (none)"]
    for k, (name, row) in enumerate(zip(names, rows), start=1):
        if not name or len(name.splitlines()) > 1 or name != name.strip():
            found = f"found a node of the name {name!r}"
            raise FormatError(f"{found}, expected the name of an image", path=path)
        image = known.image_ids[name] if known else k
        camera = known.camera_ids[name] if known else 1
        lines += [" ".join([str(image), *exactly(row), str(camera), name]), ""]
    return "\n".join([*lines, ""]).encode()


COLMAP_IMAGES = Format(
    name="colmap_images",
    suffixes=("images.txt",),
    recognises=lambda head: re.search(rb"^#\s*IMAGE_ID, QW", head, re.MULTILINE) is not None,
    read=None,
    has_graphs=False,
    write=write_images,
    convention="vision",
)
