"""Whether the measurements fit together, or would if they were read in another way.

A file may be in the other family, or have the w of quaternions first, and nothing in it tells. But
then the measurements around cycles do not come back to the identity, and in the right way they do:
all but exactly where there is little noise, and nearer to it in most cycles where there is much.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg import _core
from rotavg.evaluation.paired import (
    FACTOR,
    LEAST_FEW,
    LEAST_SEPARATE,
    NOISE_WORTH_A_LOOK,
    ROUNDED,
    is_better_on_average,
    standard_error,
)
from rotavg.evaluation.separate_cycles import in_degrees, separate_cycles
from rotavg.graph.conventions import (
    Convention,
    matrices_from_quaternions,
    quaternions_from_matrices,
)
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.formats import TABLES, input_of, read, words_of
from rotavg.io.other_columns import degree_columns, w_first_columns

# Outliers may break most cycles: the best tell, where there are enough of them.
_SHARE = 0.1
_MANY_CYCLES = 30
_MAX_CYCLES = 20000
_ENOUGH_EDGES, _DENSE = 200_000, 50  # edges, of which a node has at least so many on average
_MORE_ERRORS = 2  # standard ones, by which one other reading must be better than a simpler one


@dataclass(frozen=True)
class OtherReading:
    """Another way to read a graph's rotations, in which its cycles close better.

    Attributes:
        other_family: whether the rotations are the transposes of what they were read as.
        w_first: whether quaternions are (w, x, y, z) that were read as (x, y, z, w).
        noise: rough noise angle of one edge in this reading, radians: the median of cycle error /
            sqrt(edges), wrong edges or not.
        noise_as_read: the same of the graph as it is.
        cycles: where the noise is large, the number of cycles without a common edge that were
            looked at; else 0.
        better: how many of these close better.
    """

    other_family: bool
    w_first: bool
    noise: float
    noise_as_read: float
    cycles: int = 0
    better: int = 0

    @property
    def finding(self) -> str:
        """What the cycles say."""
        before, after = np.degrees([self.noise_as_read, self.noise])
        if self.cycles:
            return (
                f"{self.better} of {self.cycles} cycles without a common edge close better "
                f"(median {after:.2g} deg an edge, as read {before:.2g})"
            )
        return (
            f"the cycles do not close (about {before:.3g} deg an edge); they do far better "
            f"({after:.2g} deg)"
        )


@dataclass(frozen=True)
class SuggestedReading:
    """In what other way a file, or arrays, should be read.

    Attributes:
        options: what to pass for it, and what was passed already: of a file to `rotavg.read`
            (`convention`, `columns`), of a graph to `MeasurementGraph` (`convention`), or
            `MeasurementGraph.from_quaternions` (`order`), in place of what was passed.
        noise: rough noise angle of one edge in this reading, radians.
        noise_as_read: the same as it was read.
        finding: what the cycles say, in words.
    """

    options: dict[str, str]
    noise: float
    noise_as_read: float
    finding: str = field(repr=False)

    def __str__(self) -> str:
        ways = ", ".join(f"{name}={value!r}" for name, value in self.options.items())
        return f"{self.finding} with {ways}"


def suggest_reading(
    source: str | os.PathLike[str] | MeasurementGraph,
    *,
    format: str | None = None,
    convention: Convention | None = None,
    columns: str | Sequence[str] | None = None,
    graph: MeasurementGraph | None = None,
) -> SuggestedReading | None:
    """The way to read a file, or arrays, in which the cycles close, if that is another.

    Of text and CSV with rotation vectors also degrees: where cycles of what was read miss the
    identity by anything, and of the vectors in degrees by little of what their edges turn.

    That is tried where the measurements around cycles miss the identity by more than half a degree
    an edge: the other family of conventions, and w first in quaternions. One in which they miss it
    by a quarter at most is suggested; or, where noise and outliers hide that, one in which cycles
    without a common edge close better on the average, by a tenth at least and beyond doubt (five
    standard errors). Where readings are alike, as for rotations about one axis, none is. Look at
    this before a robust loss.

    Args:
        source: a file, or a graph made of arrays.
        format: how the file is read, as in `rotavg.read`.
        convention: the same; of a graph, that of its arrays.
        columns: the same.
        graph: what `rotavg.read` made of the file so, if that is at hand.

    Returns:
        None where it is right as it is, where nothing is better, and where the format leaves
        nothing open.

    Raises what `rotavg.read` does.
    """
    if isinstance(source, MeasurementGraph):
        found = other_reading(source)
        return None if found is None else _suggestion(found, convention, "order", "wxyz")
    if graph is None:
        graph = read(source, format=format, convention=convention, columns=columns)
    found = other_reading(graph)
    if graph.source is not None:  # of a format that leaves nothing open
        return None
    words = None if columns is None else words_of(columns)
    path, data, form = input_of(source, format, words)
    degrees = degree_columns(data, words) if form in TABLES else None
    if degrees is not None:
        suggested = _in_degrees(graph, path, degrees, format, convention)
        if suggested is not None:
            return suggested
    if found is None or not form.any_convention:
        return None
    last = w_first_columns(data, words) if form in TABLES else None
    if last is None and found.w_first:
        found = other_reading(graph, w_first=False)
    return None if found is None else _suggestion(found, convention, "columns", last)


def _in_degrees(
    graph: MeasurementGraph,
    path: Path,
    columns: str,
    format: str | None,
    convention: Convention | None,
) -> SuggestedReading | None:
    errors = in_degrees(
        graph, lambda: read(path, format=format, convention=convention, columns=columns)
    )
    if errors is None:
        return None
    before, after = errors
    finding = (
        f"the cycles do not close (median {np.degrees(before):.3g} deg); of rotation vectors in "
        f"degrees they do ({np.degrees(after):.2g} deg)"
    )
    options = {"columns": columns, **({} if convention is None else {"convention": convention})}
    return SuggestedReading(options, after, before, finding)


def _suggestion(
    found: OtherReading, convention: str | None, name: str, w_first: str | None
) -> SuggestedReading:
    options = {name: w_first} if found.w_first and w_first is not None else {}
    if found.other_family:
        options["convention"] = "pose" if convention == "vision" else "vision"
    elif convention is not None and options:
        options["convention"] = convention
    return SuggestedReading(options, found.noise, found.noise_as_read, found.finding)


def other_reading(graph: MeasurementGraph, *, w_first: bool = True) -> OtherReading | None:
    """The reading in which the cycles close best, if that is much better than the present one.

    Args:
        graph: the measurements; cycles are those that edges close with a breadth-first tree.
        w_first: whether they may be quaternions with w first that were read as with w last.
    """
    graph = _of_some_nodes(graph)
    lengths = _core.cycle_lengths(graph._core, _sample(graph))
    edges = _sample(graph)[lengths > 1]
    lengths = lengths[lengths > 1]
    if len(edges) < LEAST_FEW:
        return None
    read = _errors(graph, np.asarray(graph.rotations), edges, lengths)
    if float(np.median(read)) < NOISE_WORTH_A_LOOK:
        return None
    best: OtherReading | None = None
    least = _typical(read) / FACTOR if _typical(read) > NOISE_WORTH_A_LOOK else 0.0
    ways = _other_ways(graph, w_first)
    for (other, first), rotations in ways.items():
        errors = _errors(graph, rotations, edges, lengths)
        if _typical(errors) < least:
            least = _typical(errors)
            noise = float(np.median(errors)), float(np.median(read))
            best = OtherReading(other, first, *noise)
    return best or _better_on_average(graph, ways)


def _other_ways(
    graph: MeasurementGraph, w_first: bool
) -> dict[tuple[bool, bool], NDArray[np.float64]]:
    """Rotations (m, 3, 3) as they would be read otherwise: in the other family, with w first."""
    R = np.asarray(graph.rotations)
    ways = {(True, False): np.swapaxes(R, 1, 2)}
    if w_first:
        turned = matrices_from_quaternions(np.roll(quaternions_from_matrices(R), -1, axis=1))
        ways.update({(False, True): turned, (True, True): np.swapaxes(turned, 1, 2)})
    return ways


def _better_on_average(
    graph: MeasurementGraph, ways: dict[tuple[bool, bool], NDArray[np.float64]]
) -> OtherReading | None:
    """The reading in which cycles that share no edge close best, if that is beyond doubt."""
    cycles = separate_cycles(graph.indices)
    lengths = cycles.lengths
    if len(lengths) < LEAST_SEPARATE:
        return None
    read = np.maximum(cycles.errors(np.asarray(graph.rotations)), ROUNDED)
    if np.median(read / np.sqrt(lengths)) < NOISE_WORTH_A_LOOK:
        return None
    best: OtherReading | None = None
    least = read
    for (other, first), rotations in ways.items():  # the simpler ones first
        errors = np.maximum(cycles.errors(rotations), ROUNDED)
        more = np.log(least / errors)
        if (
            is_better_on_average(read, errors)
            and more.mean() > _MORE_ERRORS * standard_error(more)
        ):  # fmt: skip
            least = errors
            after, before = (float(np.median(e / np.sqrt(lengths))) for e in (errors, read))
            count = int((errors < read).sum())
            best = OtherReading(other, first, after, before, len(read), count)
    return best


def _typical(errors: NDArray[np.float64]) -> float:
    """The error of a cycle without an outlier."""
    return float(np.quantile(errors, _SHARE if len(errors) >= _MANY_CYCLES else 0.5))


def _of_some_nodes(graph: MeasurementGraph) -> MeasurementGraph:
    """Of a large dense graph as many nodes, evenly spread, as have enough edges between them."""
    dense = graph.num_edges > _DENSE * graph.num_nodes
    if graph.num_edges <= _ENOUGH_EDGES or not dense:
        return graph
    count = round(graph.num_nodes * np.sqrt(_ENOUGH_EDGES / graph.num_edges))
    rows = np.linspace(0, graph.num_nodes - 1, count).astype(np.int64)
    label = np.full(graph.num_nodes, -1)
    label[rows] = np.arange(count)
    inside = (label[graph.indices] >= 0).all(axis=1)
    if not inside.any():
        return graph
    return MeasurementGraph(
        label[graph.indices[inside]],
        graph.rotations[inside],
        graph.weights[inside],
        np.arange(count),
    )


def _sample(graph: MeasurementGraph) -> NDArray[np.int32]:
    """At most so many edges, evenly spread."""
    count = min(graph.num_edges, _MAX_CYCLES)
    return np.linspace(0, graph.num_edges - 1, count).astype(np.int32)


def _errors(
    graph: MeasurementGraph,
    rotations: NDArray[np.float64],
    edges: NDArray[np.int32],
    lengths: NDArray[np.int32],
) -> NDArray[np.float64]:
    """What the cycles of these edges miss the identity by, over the root of their lengths."""
    core = _core.MeasurementGraph(
        graph.num_nodes, graph.indices, np.ascontiguousarray(rotations), graph.weights
    )
    angles = _core.residual_angles(core, _core.shortest_path_init(core))
    return np.asarray(angles[edges] / np.sqrt(lengths))
