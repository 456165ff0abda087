"""A folder of photographs in, a measurement graph out."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError, OptionError
from rotavg.graph.covariances import first_bad_covariance, symmetric
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.images.features import Photograph, extract, find_photographs, focal_length
from rotavg.images.matching import match
from rotavg.images.two_view import NoGeometryError, TwoView, estimate

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Pair:
    """What came of two photographs.

    Attributes:
        i, j: file names.
        matches: (p, 2) rows of the two photographs' features.
        two_view: their relative pose; None if there is none to rely on.
        reason: why there is none; empty otherwise.
        covariance: (3, 3) radians^2 of its rotation, see `TwoView.covariance`; None if not known.
    """

    i: str
    j: str
    matches: NDArray[np.int64]
    two_view: TwoView | None
    reason: str = ""
    covariance: NDArray[np.float64] | None = None

    @property
    def num_inliers(self) -> int:
        """How many matches agree with the relative pose."""
        return 0 if self.two_view is None else int(self.two_view.inliers.sum())


@dataclass(frozen=True, eq=False)
class Measurement:
    """What was measured in a folder of photographs: all pairs, those that failed included."""

    photographs: list[Photograph]
    pairs: list[Pair]

    @property
    def used(self) -> list[Pair]:
        """The pairs with a relative pose."""
        return [pair for pair in self.pairs if pair.two_view is not None]

    @property
    def without_edge(self) -> list[str]:
        """The photographs that no pair connects to another."""
        joined = {name for pair in self.used for name in (pair.i, pair.j)}
        return [photo.name for photo in self.photographs if photo.name not in joined]

    @property
    def graph(self) -> MeasurementGraph:
        """The graph of the pairs with a relative pose; names are nodes, inliers are weights.

        The variance of a rotation falls as one over the number of matches that it was estimated
        from, so the number of inliers is the weight. Where those of all pairs are known, the graph
        has covariances, too. Raises GraphError where there is no pair.
        """
        used = self.used
        if not used:
            raise GraphError(
                f"none of the {len(self.pairs)} pairs of photographs has a relative rotation"
            )
        notes: tuple[str, ...] = ()
        if self.without_edge:
            notes = (f"photographs that match no other: {', '.join(self.without_edge)}",)
        return MeasurementGraph(
            [(pair.i, pair.j) for pair in used],
            np.array([pair.two_view.j_from_i for pair in used if pair.two_view is not None]),
            weights=[pair.num_inliers for pair in used],
            convention="vision",
            covariances=_covariances(used),
            notes=notes,
        )


def measure(
    folder: str | os.PathLike[str],
    *,
    focal: float | None = None,
    max_size: int = 1600,
    max_features: int = 8192,
    ratio: float = 0.8,
    max_error: float = 1.0,
    min_inliers: int = 15,
    seed: int = 0,
    progress: Progress | None = None,
) -> Measurement:
    """Measure the relative rotations of all pairs of photographs in a folder.

    Args:
        folder: holds the photographs; other files are ignored.
        focal: focal length of all photographs in pixels; from the EXIF data by default.
        max_size: pixels of the longer side; a larger photograph is reduced before features are
            looked for.
        max_features: of a photograph, the strongest.
        ratio: of the ratio test, see `matching.match`.
        max_error: of an inlier, distance to the epipolar line in pixels of the reduced photograph.
        min_inliers: a pair with fewer has no relative rotation; at least 6.
        seed: the same photographs, options and seed give the same bits.
        progress: called with (what, done, total) along the way.

    Raises:
        FormatError: fewer than two photographs, one that cannot be read, or no focal length.
        OptionError: an option out of range.
        MissingExtraError: OpenCV, Pillow or SciPy is not there.
    """
    _check(focal, max_size, max_features, ratio, max_error, min_inliers, seed)
    report = progress or (lambda what, done, total: None)
    paths = find_photographs(Path(folder))
    # All focal lengths before any work: one of them may be missing.
    focals = [focal_length(path) if focal is None else float(focal) for path in paths]
    photographs = []
    for k, (path, length) in enumerate(zip(paths, focals)):
        report("features", k, len(paths))
        photographs.append(extract(path, length, max_size=max_size, max_features=max_features))
    report("features", len(paths), len(paths))
    pairs = []
    total = len(paths) * (len(paths) - 1) // 2
    for k, (first, second) in enumerate(itertools.combinations(photographs, 2)):
        report("pairs", k, total)
        matches = match(first.descriptors, second.descriptors, ratio=ratio)
        error = max_error * (_pixel(first) + _pixel(second)) / 2
        rays = first.rays[matches[:, 0]], second.rays[matches[:, 1]]
        try:
            pose = estimate(*rays, max_error=error, min_inliers=min_inliers, seed=seed)
            spread = pose.covariance(*rays)
            pairs.append(Pair(first.name, second.name, matches, pose, covariance=spread))
        except NoGeometryError as failure:
            pairs.append(Pair(first.name, second.name, matches, None, str(failure)))
    report("pairs", total, total)
    return Measurement(photographs, pairs)


def _covariances(pairs: list[Pair]) -> NDArray[np.float64] | None:
    """(m, 3, 3) of all pairs; None where one is not known."""
    known = [pair.covariance for pair in pairs if pair.covariance is not None]
    if len(known) < len(pairs):
        return None
    covariances = np.array(known)
    covariances = symmetric(covariances)
    return None if first_bad_covariance(covariances) is not None else covariances


def _pixel(photograph: Photograph) -> float:
    """Size of a pixel of the image that was searched, in units of the focal length."""
    return 1 / (photograph.focal * photograph.scale)


def _check(
    focal: float | None,
    max_size: int,
    max_features: int,
    ratio: float,
    max_error: float,
    min_inliers: int,
    seed: int,
) -> None:
    rules = [
        ("focal", focal, focal is None or 0 < focal < np.inf, "a positive number of pixels"),
        ("max_size", max_size, max_size >= 16, "at least 16 pixels"),
        ("max_features", max_features, max_features >= 1, "at least 1"),
        ("ratio", ratio, 0 < ratio <= 1, "a number above 0, at most 1"),
        ("max_error", max_error, 0 < max_error < np.inf, "a positive number of pixels"),
        ("min_inliers", min_inliers, min_inliers >= 6, "at least 6"),
        ("seed", seed, 0 <= seed < 2**31, "a whole number from 0 to 2147483647"),
    ]
    for name, value, fine, expected in rules:
        if not fine:
            raise OptionError(f"{name} is {value!r}; expected {expected}")
