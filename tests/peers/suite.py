"""Equivalents of the tests in other libraries' suites: a name, their tolerance, what we get.

A case does what the peer's test does, by rotavg, and returns the figure that the peer's test bounds
(where it asserts that something holds, 0 for yes and 1 for no). Data are made as the peer makes
them, with generators of our own.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import rotavg
from rotavg.graph.conventions import matrices_from_rotvecs
from rotavg.graph.se3 import log_so3

Floats = NDArray[np.float64]
Pairs = Iterable["tuple[int, int]"]


@dataclass(frozen=True)
class Case:
    """One test, or several that ask for the same.

    Attributes:
        suite: the library.
        tests: the file and the names of its tests.
        tolerance: the largest figure that passes.
        unit: of the figure: "deg", "rad", "" ...
        figure: does it and returns the figure.
        needs: modules without which it cannot be done.
    """

    suite: str
    tests: str
    tolerance: float
    unit: str
    figure: Callable[[], float]
    needs: tuple[str, ...]

    @property
    def missing(self) -> list[str]:
        """The modules that are not installed."""
        return [name for name in self.needs if importlib.util.find_spec(name) is None]


CASES: list[Case] = []


def case(
    suite: str, tests: str, tolerance: float, unit: str = "", needs: tuple[str, ...] = ()
) -> Callable[[Callable[[], float]], Callable[[], float]]:
    """List a function that returns the figure of a test."""

    def listed(figure: Callable[[], float]) -> Callable[[], float]:
        CASES.append(Case(suite, tests, tolerance, unit, figure, needs))
        return figure

    return listed


def holds(condition: object) -> float:
    """The figure of what is or is not so."""
    return 0.0 if bool(condition) else 1.0


def degrees_between(found: Floats, truth: Floats) -> Floats:
    """(n,) angles in degrees after the rotation that turns all of `found` nearest to `truth`."""
    compared = rotavg.compare((np.arange(len(found)), found), (np.arange(len(truth)), truth))
    return np.degrees(compared.angles)


def relative_degrees(found: Floats, truth: Floats) -> float:
    """The largest angle in degrees between the relative rotations of two nodes, found and true."""
    worst = 0.0
    for R, T in zip(found, truth):
        gap = np.swapaxes(R.T @ found, 1, 2) @ (T.T @ truth)
        worst = max(worst, float(np.degrees(np.linalg.norm(log_so3(gap), axis=1).max())))
    return worst


def turns(rng: np.random.Generator, count: int, scale: float = 1.0) -> Floats:
    """Rotations by vectors that are uniform in a cube, as Theia's generator has them."""
    return matrices_from_rotvecs(scale * rng.uniform(-1, 1, size=(count, 3)))


def about(axis: int, radians: float) -> Floats:
    """The rotation about x, y or z."""
    return matrices_from_rotvecs(radians * np.eye(3)[None, axis])[0]


def noisy(rng: np.random.Generator, R: Floats, degrees: Floats) -> Floats:
    """Rotations (m, 3, 3) off by exactly so many degrees (m,), about random axes."""
    axes = rng.normal(size=(len(R), 3))
    axes *= np.radians(degrees)[:, None] / np.linalg.norm(axes, axis=1, keepdims=True)
    return np.asarray(matrices_from_rotvecs(axes) @ R)


def relative_of(R: Floats, pairs: Pairs) -> Floats:
    """R_j R_i^T of rotations camera_from_world."""
    i, j = np.array(list(pairs)).T
    return np.asarray(R[j] @ np.swapaxes(R[i], 1, 2))


def cameras_of(found: Floats) -> Floats:
    """world_from_camera, and back."""
    return np.swapaxes(found, 1, 2)


def random_pairs(rng: np.random.Generator, n: int, m: int) -> list[tuple[int, int]]:
    """A path, and random pairs besides."""
    pairs = [(k, k + 1) for k in range(n - 1)]
    seen = set(pairs)
    while len(pairs) < m:
        i, j = sorted(rng.integers(n, size=2).tolist())
        if i != j and (i, j) not in seen:
            pairs.append((i, j))
            seen.add((i, j))
    return pairs
