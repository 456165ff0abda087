"""What the paper's experiments with photographs (Table 2, Fig. 4) have in common."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError, OptionError
from rotavg.graph.conventions import convert_family, matrices_from_quaternions, xyzw_from_wxyz
from rotavg.images.features import SUFFIXES
from rotavg.images.pipeline import Measurement, measure
from rotavg.reproduce.experiment import Experiment, Outcome, Settings


def experiment(name: str, title: str, run: Callable[..., Outcome]) -> Experiment:
    """One whose `run(folder, references=, seed=, progress=)` starts from photographs."""

    def run_with(settings: Settings) -> Outcome:
        if settings.photographs is None:
            raise OptionError(f"{name} starts from photographs, and none were given")
        return run(
            settings.photographs,
            references=settings.references,
            seed=settings.seed,
            progress=settings.progress,
        )

    return Experiment(name, title, run_with, from_photographs=True)


def data_sets(folder: str | os.PathLike[str]) -> dict[str, Path]:
    """Folders of photographs by name: the folder itself, or those in it. Raises FormatError."""
    folder = Path(folder)
    try:
        inside = sorted(folder.iterdir())
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be read: {reason}", path=folder) from error
    if _count(folder) >= 2:
        return {folder.resolve().name: folder}
    found = {path.name: path for path in inside if path.is_dir() and _count(path) >= 2}
    if not found:
        expected = "expected some, or folders of some (ET and kermit of the paper)"
        raise FormatError(f"found no photographs in the folder, {expected}", path=folder)
    return found


def measure_all(
    folder: str | os.PathLike[str], report: Callable[[str], None], **options: Any
) -> Iterator[tuple[str, Path, Measurement]]:
    """Name, folder and measurement of each data set; `options` are those of `images.measure`."""
    for name, path in data_sets(folder).items():

        def progress(what: str, done: int, total: int, name: str = name) -> None:
            report(f"{name}: {what} {done} of {total}")

        yield name, path, measure(path, progress=progress, **options)


def _count(folder: Path) -> int:
    return sum(path.suffix.lower() in SUFFIXES for path in folder.iterdir())


def reference_rotations(path: Path) -> dict[str, NDArray[np.float64]]:
    """world_from_camera by image name, of a text of GLOMAP's: NAME QW QX QY QZ on each line."""
    rotations = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        fields = line.split()
        if not fields:
            continue
        try:
            name, *wxyz = fields
            (camera_from_world,) = matrices_from_quaternions(
                xyzw_from_wxyz(np.array([wxyz], dtype=np.float64).reshape(1, 4))
            )
        except ValueError:
            found = f"found {line!r}, expected NAME QW QX QY QZ"
            raise FormatError(found, path=path, line=number) from None
        rotations[name] = convert_family(camera_from_world, "vision")
    return rotations


def find_references(
    folder: str | os.PathLike[str] | None, name: str
) -> dict[str, NDArray[np.float64]]:
    """The rotations of NAME_glomap_rotations.txt in a folder; empty where there is no such file."""
    path = None if folder is None else Path(folder) / f"{name}_glomap_rotations.txt"
    return reference_rotations(path) if path is not None and path.is_file() else {}


def angles_deg(R: NDArray[np.float64], Q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle (k,) in degrees between rotations (k, 3, 3); from the chord, exact near 0."""
    chord = np.linalg.norm(np.asarray(R) - np.asarray(Q), axis=(-2, -1))
    return np.asarray(np.degrees(2 * np.arcsin(np.minimum(1, chord / np.sqrt(8)))))


def errors_deg(
    rotations: dict[str, NDArray[np.float64]], references: dict[str, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Angle (k,) of each rotation to its reference, after the one that aligns all of them best."""
    names = [name for name in rotations if name in references]
    if not names:
        return np.empty(0)
    differences = np.array([references[name] @ rotations[name].T for name in names])
    U, _, Vt = np.linalg.svd(differences.sum(axis=0))
    mean = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return angles_deg(differences, np.broadcast_to(mean, differences.shape))
