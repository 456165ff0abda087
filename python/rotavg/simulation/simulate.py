"""Measurement graphs with known ground truth, for tests, benchmarks and first steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.arrays import Brief, as_floats
from rotavg.base.errors import GraphError
from rotavg.base.memory import check_memory
from rotavg.graph.conventions import matrices_from_quaternions, matrices_from_rotvecs
from rotavg.graph.known_rotations import KnownRotations
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.translations import RelativeTranslations
from rotavg.simulation import topology

_MOST_NOISE = 1e6  # radians; beyond, the angles lose what they are modulo a turn
# As measured, at most at a time: rotations, noise and their products, the graph; positions.
_BYTES_PER_EDGE = 350
_BYTES_PER_NODE = 400

KINDS = ("complete", "erdos_renyi", "cycle", "grid", "sphere", "band")

Noise = Union[float, Callable[[np.random.Generator, int], ArrayLike]]


@dataclass(frozen=True, eq=False)
class Simulation(Brief):
    """A simulated measurement graph and what is true about it.

    Attributes:
        graph: nodes 0 ... n - 1, weights 1; with the true translations where there are positions.
        ground_truth: (n, 3, 3) world_from_node. Compare up to one rotation from the left.
        is_outlier: (m,) whether the edge's rotation is a wrong one.
        positions: (n, 3) of the nodes in the world; None for kinds without geometry.
    """

    graph: MeasurementGraph
    ground_truth: NDArray[np.float64]
    is_outlier: NDArray[np.bool_]
    positions: NDArray[np.float64] | None

    @property
    def truth(self) -> KnownRotations:
        """The ground truth, for `rotavg.write`."""
        return KnownRotations(self.graph, self.ground_truth)


def simulate(
    kind: str | ArrayLike,
    n: int,
    *,
    noise: Noise = 0.0,
    drop: float = 0.0,
    density: float = 0.1,
    outliers: float = 0.0,
    outlier_clusters: int = 0,
    loop_closures: float = 0.01,
    seed: int = 0,
) -> Simulation:
    """Simulate a connected measurement graph; the same arguments give the same graph.

    The noise is the paper's (Dong, Xie, Shi 2021, section 6): R_ij = R_i^T R_j exp(angle * axis)
    with a uniformly random axis and angle ~ N(0, noise^2). Translations have neither noise nor
    outliers.

    Args:
        kind: "complete", "erdos_renyi", "cycle": uniformly random ground truth;
            "grid": a cubic lattice walked to and fro, like smallGrid3D;
            "sphere": a spiral from pole to pole with closures to the next turn, like sphere2500;
            "band": each node joined to the next 9, with random loop closures instead of some;
            or edges (m, 2) of your own, between nodes 0 ... n - 1, on uniformly random ground
            truth. Such a graph need not be connected.
        n: number of nodes, at least 2 (3 for a cycle).
        noise: standard deviation of the angle, radians; or a function of a generator and m, which
            returns rotation vectors e (m, 3), radians: then R_ij = R_i^T R_j exp([e]).
        drop: fraction of the edges to leave out, drawn uniformly from those that a random
            spanning tree can spare: the graph stays connected.
        density: of "erdos_renyi": the probability of each pair to be joined, plus the few random
            edges that connect the graph.
        outliers: fraction of the edges whose rotation is replaced by a uniformly random one.
        outlier_clusters: with it, outliers are coherent, as a repeated facade makes them: the
            nodes belong to so many random clusters, each of two clusters is mistaken for one that
            is turned by a rotation of their own, and an outlier between them measures, with the
            noise, this wrong rotation. Only edges between clusters become outliers.
        loop_closures: of "band": fraction of the edges that join random nodes instead.
        seed: of NumPy's PCG64.

    Raises:
        GraphError: an argument out of range, more edges to drop than can be spared, or more nodes
            and edges than this machine's memory holds.
    """
    own = None if isinstance(kind, str) else _own_edges(kind, n)
    _check(kind if isinstance(kind, str) else "edges", n, noise, seed)
    for name, fraction in (
        ("drop", drop),
        ("density", density),
        ("outliers", outliers),
        ("loop_closures", loop_closures),
    ):
        if not 0 <= fraction <= 1:
            raise GraphError(f"{name} is {fraction}, expected a fraction in [0, 1]")
    if not isinstance(outlier_clusters, (int, np.integer)) or outlier_clusters < 0:
        raise GraphError(f"outlier_clusters is {outlier_clusters!r}, expected an integer >= 0")
    count = topology.num_edges(str(kind), n, density) if own is None else float(len(own))
    check_memory(
        f"{n} nodes and {count:.3g} edges",
        _BYTES_PER_EDGE * count + _BYTES_PER_NODE * n,
        GraphError,
    )
    rng = np.random.Generator(np.random.PCG64(seed))

    positions = frames = None
    if own is not None:
        edges = own
    elif kind == "complete":
        edges = topology.complete(n)
    elif kind == "erdos_renyi":
        edges = topology.erdos_renyi(n, density, rng)
    elif kind == "cycle":
        edges = topology.cycle(n)
    elif kind == "band":
        edges = topology.band(n, loop_closures, rng)
    elif kind == "grid":
        edges, positions, frames = topology.grid(n)
    else:
        edges, positions, frames = topology.sphere(n)

    ground_truth = _random_rotations(n, rng) if frames is None else frames
    if drop > 0:
        edges = _dropped(n, edges, drop, rng)
    m = len(edges)
    rotations = np.swapaxes(ground_truth, 1, 2)[edges[:, 0]] @ ground_truth[edges[:, 1]]
    if callable(noise):
        rotations = rotations @ matrices_from_rotvecs(as_floats(noise(rng, m), (m, 3), "noise"))
    elif noise > 0:
        rotations = rotations @ _random_noise(m, noise, rng)
    is_outlier = np.zeros(m, dtype=np.bool_)
    if outlier_clusters > 0 and outliers > 0:
        is_outlier = _mistake_clusters(
            edges, ground_truth, rotations, outliers, outlier_clusters, rng
        )
    else:
        is_outlier[rng.choice(m, size=round(outliers * m), replace=False)] = True
        rotations[is_outlier] = _random_rotations(int(is_outlier.sum()), rng)
    translations = None
    if positions is not None:
        steps = np.diff(positions[edges], axis=1)  # (m, 1, 3): as rows, turned by R_i^T
        translations = RelativeTranslations((steps @ ground_truth[edges[:, 0]])[:, 0])
    graph = MeasurementGraph(edges, rotations, nodes=np.arange(n), translations=translations)
    return Simulation(graph, ground_truth, is_outlier, positions)


def _own_edges(edges: ArrayLike, n: int) -> NDArray[np.int64]:
    try:
        pairs = np.asarray(edges)
    except ValueError as error:
        raise GraphError(f"the edges are no array of pairs: {error}") from None
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu" or not len(pairs):
        found = f"shape {pairs.shape} and type {pairs.dtype}"
        raise GraphError(f"the edges have {found}, expected integers (m, 2)")
    bad = ((pairs < 0) | (pairs >= n)).any(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise GraphError(f"edge {row} is {tuple(pairs[row].tolist())}, expected nodes 0 to {n - 1}")
    return pairs.astype(np.int64)


def _check(kind: str, n: int, noise: Noise, seed: int) -> None:
    if kind not in (*KINDS, "edges"):
        raise GraphError(f"unknown kind {kind!r}, expected one of {', '.join(KINDS)}")
    smallest = 3 if kind == "cycle" else 2
    if not isinstance(n, (int, np.integer)) or n < smallest:
        raise GraphError(f"n is {n!r}, expected an integer of at least {smallest} for {kind!r}")
    if not (callable(noise) or 0 <= noise <= _MOST_NOISE):
        expected = f"a standard deviation in radians, from 0 to {_MOST_NOISE:g}"
        raise GraphError(f"noise is {noise}, expected {expected}")
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise GraphError(f"seed is {seed!r}, expected an integer >= 0")


def _dropped(
    n: int, edges: NDArray[np.int64], drop: float, rng: np.random.Generator
) -> NDArray[np.int64]:
    spare = np.flatnonzero(~topology.spanning_forest(n, edges, rng)[0])
    count = round(drop * len(edges))
    if count > len(spare):
        raise GraphError(
            f"drop is {drop}, which is {count} of {len(edges)} edges, "
            f"expected at most the {len(spare)} that can go without disconnecting the graph"
        )
    return np.delete(edges, rng.choice(spare, size=count, replace=False), axis=0)


def _mistake_clusters(
    edges: NDArray[np.int64],
    ground_truth: NDArray[np.float64],
    rotations: NDArray[np.float64],
    share: float,
    num_clusters: int,
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    """Replace a share of the rotations (m, 3, 3) by coherent mistakes; returns which (m,)."""
    cluster = rng.integers(num_clusters, size=len(ground_truth))[edges]
    between = np.flatnonzero(cluster[:, 0] != cluster[:, 1])
    count = round(share * len(edges))
    if count > len(between):
        raise GraphError(
            f"outliers is {share}, which is {count} of {len(edges)} edges, expected at most the "
            f"{len(between)} between clusters"
        )
    wrong = rng.choice(between, size=count, replace=False)
    low, high = cluster[wrong].min(axis=1), cluster[wrong].max(axis=1)
    turn = _random_rotations(num_clusters**2, rng)[low * num_clusters + high]
    forward = (cluster[wrong, 0] < cluster[wrong, 1])[:, None, None]
    turn = np.where(forward, turn, np.swapaxes(turn, 1, 2))
    i_from_world = np.swapaxes(ground_truth[edges[wrong, 0]], 1, 2)
    world_from_j = ground_truth[edges[wrong, 1]]
    noise = np.swapaxes(i_from_world @ world_from_j, 1, 2) @ rotations[wrong]
    rotations[wrong] = i_from_world @ turn @ world_from_j @ noise
    is_outlier = np.zeros(len(edges), dtype=np.bool_)
    is_outlier[wrong] = True
    return is_outlier


def _random_rotations(count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Uniform (Haar) on SO(3): the direction of a Gaussian quaternion is uniform."""
    return matrices_from_quaternions(rng.standard_normal((count, 4)))


def _random_noise(count: int, angle: float, rng: np.random.Generator) -> NDArray[np.float64]:
    axes = rng.standard_normal((count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return matrices_from_rotvecs(rng.normal(0.0, angle, size=(count, 1)) * axes)
