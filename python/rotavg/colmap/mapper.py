"""COLMAP's global mapper (GLOMAP) behind rotavg's rotations: positions, points, bundle adjustment.

The mapper runs in a process of its own (`python -m rotavg.colmap.mapper`): COLMAP logs to stderr,
ends the process where it finds its own state wrong, and does not listen to Ctrl-C.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import rotavg
from rotavg.base.errors import FileAccessError, FormatError, OptionError, SolverError, require
from rotavg.colmap.new_database import writing
from rotavg.colmap.two_views import (
    complete_poses,
    copy_database,
    write_rotations,
)
from rotavg.io.rigs import rigs_of
from rotavg.solving.robust import Loss


@dataclass(frozen=True)
class Model:
    """One connected model that the mapper wrote.

    Attributes:
        path: folder of cameras.bin, images.bin, points3D.bin and so on, for COLMAP.
        images: number of images with a pose.
        points: number of points.
        reprojection_error: mean, in pixels.
    """

    path: Path
    images: int
    points: int
    reprojection_error: float


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What came of a database.

    Attributes:
        models: the largest first.
        solution: the rotations that the mapper was given.
        dropped: pairs of images that contradicted them and were left out.
    """

    models: list[Model]
    solution: rotavg.Solution
    dropped: int


def reconstruct(
    database: str | os.PathLike[str],
    images: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    max_residual: float = np.radians(10.0),
    seed: int = 0,
    num_threads: int | None = None,
    loss: Loss = "auto",
    anisotropic: bool = False,
    **solve_options: Any,
) -> Reconstruction:
    """Reconstruct the scene: rotations by rotavg, the rest by COLMAP's global mapper.

    The rotations are solved for, with the rigs that the database has, and written into a copy of
    it, all relative rotations consistent; the mapper is told to take those as they are. The
    database itself is only read.

    Args:
        database: COLMAP's, with features, matches and two-view geometries.
        images: folder of the images, for the colours of the points.
        output: folder to make; gets the models 0, 1, … and the copy, database.db.
        max_residual: radians; pairs that contradict the rotations by more are left out.
        seed: of the mapper.
        num_threads: None for all processors; with 1 the mapper gives the same points each time.
        loss: of `rotavg.solve`: photographs have wrong pairs.
        anisotropic: whether to estimate the covariances of the relative rotations from the inliers
            of the pairs, and to honour them (docs/covariances.md).
        solve_options: further ones of `rotavg.solve`. `priors` stand instead of the database's
            rigs, None for none: `rotavg.read_priors(database, graph, gravity=True)` has both. The
            mapper takes the rotations relative to each other, and its world is its own.

    Raises:
        FileAccessError: `output` is there already and not empty, or a file cannot be read or
            written.
        FormatError: the database holds no relative rotations.
        SolverError: the mapper failed; the message has its last words.
        MissingExtraError: pycolmap is not there.
    """
    require("pycolmap", "colmap")
    images, output = Path(images), Path(os.path.realpath(output))
    if not 0 <= max_residual <= np.pi:
        expected = "expected radians from 0 to pi"
        raise OptionError(f"max_residual is {max_residual!r}; {expected}")
    if not images.is_dir():
        raise FileAccessError("cannot be read: there is no such folder", path=images)
    check_new_folder(output)
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=f".{output.name}.") as temporary:
        folder = Path(temporary)
        measured = folder / "measured.db"
        with writing(output):
            copy_database(Path(database), measured)
            complete_poses(measured)
        try:
            graph = rotavg.read(measured, format="colmap", covariances=anisotropic)
        except FormatError as error:  # of the copy, which is soon gone
            reason = str(error).removeprefix(f"{measured}: ")
            raise FormatError(reason, path=database) from error
        rigs = rigs_of(graph)
        if rigs is not None:
            solve_options.setdefault("priors", rotavg.Priors(rigs=rigs))
        solution = rotavg.solve(
            graph, loss=loss, num_threads=num_threads, anisotropic=anisotropic, **solve_options
        )
        result = folder / "result"
        result.mkdir()
        dropped = write_rotations(
            measured, solution, result / "database.db", max_residual=max_residual
        )
        found = _run_mapper(result, images, seed, num_threads)
        if not found:
            raise SolverError(
                f"COLMAP's mapper found no model of the {graph.num_nodes} images in {database}"
            )
        if output.exists():
            output.rmdir()  # it is empty
        result.replace(output)
    models = [Model(output / name, *figures) for name, figures in found]
    models.sort(key=lambda model: (-model.images, -model.points))
    return Reconstruction(models, solution, dropped)


def check_new_folder(output: Path) -> None:
    """FileAccessError unless `output` is an empty folder, or can be made."""
    if output.is_dir() and not any(output.iterdir()):
        return
    if output.exists():
        reason = "it is there already and not an empty folder"
    elif not output.parent.is_dir():
        reason = f"there is no folder {output.parent}"
    elif not os.access(output.parent, os.W_OK):
        reason = "permission denied"
    else:
        return
    raise FileAccessError(f"cannot be written: {reason}", path=output)


def _run_mapper(
    result: Path, images: Path, seed: int, num_threads: int | None
) -> list[tuple[str, tuple[int, int, float]]]:
    arguments = json.dumps([str(result), str(images.resolve()), seed, num_threads or -1])
    done = subprocess.run(
        [sys.executable, "-m", "rotavg.colmap.mapper", arguments],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if done.returncode != 0:
        last = "\n".join(done.stderr.strip().splitlines()[-5:])
        raise SolverError(f"COLMAP's mapper failed (exit status {done.returncode}):\n{last}")
    return [(name, tuple(figures)) for name, figures in json.loads(done.stdout.splitlines()[-1])]


def _main(arguments: str) -> None:
    """What the process does: map, then print the models as JSON."""
    result, images, seed, num_threads = json.loads(arguments)
    pycolmap = require("pycolmap", "colmap")
    pycolmap.logging.minloglevel = pycolmap.logging.WARNING.value
    options = pycolmap.GlobalPipelineOptions(
        decompose_relative_pose=False, random_seed=seed, num_threads=num_threads
    )
    database = Path(result) / "database.db"
    models = pycolmap.global_mapping(database, images, result, options)
    figures = [
        (model.num_reg_images(), model.num_points3D(), model.compute_mean_reprojection_error())
        for model in models.values()
    ]
    print(json.dumps(list(zip(map(str, models), figures))))


if __name__ == "__main__":
    _main(sys.argv[1])
