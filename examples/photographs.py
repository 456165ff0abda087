"""Photographs with COLMAP: relative rotations, robust averaging, and a reconstruction.

    python examples/photographs.py FOLDER [FOCAL_LENGTH_IN_PIXELS]

Needs the extras [images] and [colmap]. Writes graph.npz, photographs.db and the folder scene, whose
models COLMAP opens.
"""

from __future__ import annotations

import sys

import rotavg
from rotavg import colmap, images


def main(arguments: list[str]) -> int:
    focal = float(arguments[1]) if len(arguments) > 1 else None  # from the EXIF data
    measured = images.measure(arguments[0], focal=focal)
    for pair in measured.pairs:
        if pair.reason:
            print(f"{pair.i}, {pair.j}: {pair.reason}")
    solution = rotavg.solve(measured.graph, loss="auto")
    print(solution)
    rotavg.write("graph.npz", measured.graph)

    colmap.create_database("photographs.db", measured)
    scene = colmap.reconstruct("photographs.db", arguments[0], "scene", num_threads=1)
    for model in scene.models:
        print(f"{model.path}: {model.images} images, {model.points} points")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
