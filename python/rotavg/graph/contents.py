"""What a measurement graph is made of: as it is given, checked, without the edges not used."""

from __future__ import annotations

import warnings
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg import _core
from rotavg.base.arrays import as_floats, read_only
from rotavg.base.errors import GraphError
from rotavg.graph import conventions
from rotavg.graph.conventions import Convention, QuaternionOrder
from rotavg.graph.covariances import first_bad_covariance, isotropic_weights, pose_family
from rotavg.graph.ids import IdArray, as_edges, as_nodes, edge_error, rows_of, unique_ids
from rotavg.graph.nearest import TOLERANCE, projected
from rotavg.graph.translations import RelativeTranslations
from rotavg.graph.units import note_of_degrees
from rotavg.graph.unused import not_used


class Source(Protocol):
    """What a reader keeps of its file, so that a writer can put back what is not a rotation."""

    def select(self, edges: NDArray[np.bool_]) -> Source:
        """The source of the graph that keeps the edges (m,) marked True."""
        ...


class Quaternions(NamedTuple):
    """Relative rotations as Hamilton quaternions xyzw (m, 4), finite, of any length but zero."""

    xyzw: NDArray[np.float64]


class Contents(NamedTuple):
    """What a graph holds, see `MeasurementGraph`; `core` has the edges and their rotations."""

    core: _core.MeasurementGraph
    nodes: IdArray
    covariances: NDArray[np.float64] | None
    translations: RelativeTranslations | None
    source: Source | None
    notes: tuple[str, ...]


def contents_of(
    edges: ArrayLike,
    rotations: ArrayLike | Quaternions,
    weights: ArrayLike | None,
    nodes: ArrayLike | None,
    convention: Convention,
    covariances: ArrayLike | None,
    translations: RelativeTranslations | None,
    source: Source | None,
    notes: tuple[str, ...],
    tolerance: float,
    skip_self_edges: bool,
) -> Contents:
    """All that `MeasurementGraph` is given, checked; GraphError as said there."""
    ids = as_edges(edges)
    m = len(ids)
    all_nodes = read_only(unique_ids(ids) if nodes is None else as_nodes(nodes))
    rows = _indices(ids, all_nodes)
    conventions.check_family(convention)
    inverted = convention == "vision"
    if isinstance(rotations, Quaternions):
        given = as_floats(rotations.xyzw, (m, 4), "quaternions", copy=False)
    else:
        given = as_floats(rotations, (m, 3, 3), "rotations", copy=False)
    spread = None if covariances is None else as_floats(covariances, (m, 3, 3), "covariances")
    if spread is not None and (bad := first_bad_covariance(spread)) is not None:
        raise edge_error(ids, *bad)
    if weights is None:
        weights = np.ones(m) if spread is None else isotropic_weights(spread)
    given_weights = as_floats(weights, (m,), "weights", copy=False)
    if translations is not None and len(translations) != m:
        raise GraphError(f"there are {len(translations)} translations, expected {m}")
    used = given_weights != 0
    if skip_self_edges:
        used &= rows[:, 0] != rows[:, 1]
    if not used.all():
        notes += not_used(ids, given_weights, used)
        rows, given, given_weights = rows[used], given[used], given_weights[used]
        spread = None if spread is None else spread[used]
        translations = None if translations is None else translations.select(used)
        source = None if source is None else source.select(used)
    if tolerance > TOLERANCE and given.ndim == 3:
        given = conventions.convert_family(given, convention)
        inverted = False
        given = projected(ids, given, np.flatnonzero(used), tolerance)
    try:
        core = _core.MeasurementGraph(len(all_nodes), rows, given, given_weights, inverted)
    except _core.InvalidEdge as error:
        edge, reason = error.args
        number = np.flatnonzero(used)[edge]  # of the edge as it was given
        raise edge_error(ids, int(number), reason) from None
    except ValueError as error:
        raise GraphError(str(error)) from None
    if spread is not None and convention == "vision":
        spread = pose_family(spread, core.rotations)
    spread = None if spread is None else read_only(spread)
    return Contents(core, all_nodes, spread, translations, source, notes)


def given_quaternions(
    edges: IdArray, quaternions: ArrayLike, order: QuaternionOrder
) -> Quaternions:
    """Quaternions (m, 4) in this order; GraphError for one that gives no rotation."""
    if order not in ("xyzw", "wxyz"):
        raise GraphError(f"order is {order!r}, expected 'xyzw' or 'wxyz'")
    given = as_floats(quaternions, (len(edges), 4), "quaternions", copy=False)
    xyzw = given if order == "xyzw" else conventions.xyzw_from_wxyz(given)
    bad = conventions.first_bad_quaternion(xyzw)
    if bad is not None:
        raise edge_error(edges, *bad)
    return Quaternions(xyzw)


def quaternions_of(rotations: object) -> NDArray[np.float64]:
    """(m, 4) xyzw of a `scipy.spatial.transform.Rotation`; GraphError for anything else."""
    if not hasattr(rotations, "as_quat"):
        found = f"found a {type(rotations).__name__}"
        raise GraphError(f"{found}, expected a scipy.spatial.transform.Rotation of m rotations")
    return np.asarray(rotations.as_quat(), dtype=np.float64)


def given_rotvecs(
    edges: IdArray, rotvecs: ArrayLike, *, degrees: bool
) -> tuple[Quaternions, tuple[str, ...]]:
    """Rotation vectors (m, 3), and what to ask about their unit; GraphError for NaN, infinity.

    A UserWarning asks, too, where most are longer than a turn.
    """
    given = as_floats(rotvecs, (len(edges), 3), "rotvecs", copy=False)
    finite = np.isfinite(given).all(axis=1)
    if not finite.all():
        k = int(np.argmin(finite))
        reason = f"the rotation vector is {given[k].tolist()}, expected finite numbers"
        raise edge_error(edges, k, reason)
    asked = () if degrees else note_of_degrees(edges, given)
    if asked and np.median(np.linalg.norm(given, axis=1)) > 2 * np.pi:
        warnings.warn(asked[0], UserWarning, stacklevel=3)  # where the graph is made
    radians = np.radians(given) if degrees else given
    return Quaternions(conventions.quaternions_from_rotvecs(radians)), asked


def _indices(edges: IdArray, nodes: IdArray) -> NDArray[np.int32]:
    """Edges (m, 2) as rows of the nodes; GraphError for a node that is not among them."""
    rows = rows_of(edges, nodes)
    if (rows < 0).any():
        k, side = divmod(int(np.argmin(rows)), 2)
        raise edge_error(edges, k, f"node {edges[k, side].item()!r} is not among the given nodes")
    return rows.astype(np.int32)
