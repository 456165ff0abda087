"""What is known beside the rotations of a graph, held against them: priors, rigs, covariances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotavg.base.errors import expect
from rotavg.evaluation.paired import LEAST_FEW, LEAST_SEPARATE, is_clearly_better
from rotavg.evaluation.separate_cycles import separate_cycles
from rotavg.graph.ids import as_ids, rows_of
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.priors import Priors, Rigs, check_priors
from rotavg.solving.solve import solve

Floats = NDArray[np.float64]

_FEW_CYCLES = 10
# A standard deviation in degrees is 57 times that in radians: so much and half as much again.
_DEGREES = float(np.degrees(1.0))
_TIMES = 1.5
# Gravity is elsewhere than `down` by more than this, and by so many times what it scatters.
_TILT = float(np.radians(15.0))
_SCATTER = 3


def doubts(graph: MeasurementGraph, priors: Priors | None = None) -> tuple[str, ...]:
    """What of the noise and of prior knowledge contradicts a graph as if it was read wrongly.

    Covariances in degrees^2; fixed rotations, absolute priors and calibrated sensors that
    contradict the graph where their inverses agree with it (camera_from_world for
    world_from_camera, sensor_from_rig for rig_from_sensor); gravity that points up, or along
    another axis than `down`, in the world of the rotations that are known. In what other way the
    graph itself may be read is told by `suggest_reading`.

    Returns:
        Sentences with figures; none where nothing is clearly wrong, or nothing can be told.

    Raises what `solve` raises for these priors.
    """
    expect(graph, MeasurementGraph)
    found = [_of_covariances(graph)]
    if priors is not None:
        check_priors(priors)
        if isinstance(priors.rigs, Rigs) or priors.rigs:
            found.append(_of_rigs(graph, priors.rigs))
        known = {
            "fixed rotations": dict(priors.fixed),
            "absolute priors": {k: value[0] for k, value in priors.absolute.items()},
        }
        tree: Floats | None = None
        if any(known.values()):
            tree = solve(graph, init="spanning_tree", max_iterations=0, certify=False).rotations
            of_known = [_of_rotations(graph, what, R, tree) for what, R in known.items()]
            found += of_known
            if priors.gravity and not any(of_known):
                rotations = {**known["absolute priors"], **known["fixed rotations"]}
                found.append(_of_gravity(graph, rotations, priors, tree))
    return tuple(sentence for sentence in found if sentence)


def _of_covariances(graph: MeasurementGraph) -> str:
    """Degrees^2 where radians^2 are meant: 57 times what cycles show, or beyond half a turn.

    (Where cycles show something else, covariances may be known up to a common factor.)
    """
    if graph.covariances is None:
        return ""
    rms = np.sqrt(np.trace(graph.covariances, axis1=1, axis2=2))
    typical = float(np.median(rms))
    question = "are they degrees^2? radians^2 are expected"
    told = f"the covariances mean {np.degrees(typical):.4g} deg an edge (RMS, median)"
    cycles = separate_cycles(graph.indices)
    if len(cycles.lengths) < _FEW_CYCLES:
        return f"{told}, more than half a turn: {question}" if typical > np.pi else ""
    means = np.concatenate([np.sqrt((rms[rows] ** 2).sum(axis=1)) for rows in cycles.edges])
    share = float(np.median(cycles.errors(np.asarray(graph.rotations)) / means))
    if not 1 / _TIMES < share * _DEGREES < _TIMES:
        return ""
    return f"{told}, and cycles miss by 1/{1 / share:.0f} of what follows: {question}"


def _of_rotations(
    graph: MeasurementGraph, what: str, known: Mapping[Any, Any], tree: Floats
) -> str:
    """Rotations whose inverses agree with the graph, and they do not."""
    if len(known) < LEAST_FEW:
        return ""
    row, P = _rows_and_matrices(graph, known)
    of_row = np.full(graph.num_nodes, -1)
    of_row[row] = np.arange(len(row))
    ends = of_row[graph.indices]
    direct = (ends >= 0).all(axis=1)
    if int(direct.sum()) >= LEAST_SEPARATE:
        between, R = ends[direct], np.asarray(graph.rotations)[direct]
        where = f"in {len(between)} edges between them"
    else:  # along the tree of the edges that agree best
        order = np.lexsort((row, graph.components()[row]))
        a, b = order[:-1], order[1:]
        same = graph.components()[row[a]] == graph.components()[row[b]]
        between = np.stack([a[same], b[same]], axis=1)
        X = tree[row]
        R = np.swapaxes(X[between[:, 0]], 1, 2) @ X[between[:, 1]]
        where = f"between {len(between)} pairs of them"
    read, other = (_misfits(Q, between, R) for Q in (P, np.swapaxes(P, 1, 2)))
    if not is_clearly_better(read, other):
        return ""
    return (
        f"the {what} contradict the graph ({_median(read)}, {where}), and their inverses do not "
        f"({_median(other)}): world_from_node is expected, are they camera_from_world?"
    )


def _of_rigs(graph: MeasurementGraph, rigs: Rigs | Mapping[Any, tuple[Any, ArrayLike]]) -> str:
    """Calibrated sensors whose inverses agree with the graph, and they do not."""
    if isinstance(rigs, Rigs):
        known = {s: np.asarray(C, dtype=np.float64) for s, C in rigs.rotations.items()}
        images = {k: (f, known[s]) for k, (f, s) in rigs.images.items() if s in known}
    else:
        images = {k: (f, np.asarray(C, dtype=np.float64)) for k, (f, C) in rigs.items()}
    if not images or any(C.shape != (3, 3) for _, C in images.values()):
        return ""
    row, C = _rows_and_matrices(graph, {k: C for k, (_, C) in images.items()})
    number: dict[Any, int] = {}
    frame = np.full(graph.num_nodes, -1)
    frame[row] = [number.setdefault(f, len(number)) for f, _ in images.values()]
    of_row = np.tile(np.eye(3), (graph.num_nodes, 1, 1))
    of_row[row] = C
    i, j = graph.indices[(frame[graph.indices] >= 0).all(axis=1)].T
    R = np.asarray(graph.rotations)[(frame[graph.indices] >= 0).all(axis=1)]
    ends = np.stack([frame[i], frame[j]], axis=1)
    read, other = (
        _frame_misfits(ends, D[i] @ R @ np.swapaxes(D[j], 1, 2))
        for D in (of_row, np.swapaxes(of_row, 1, 2))
    )
    if not is_clearly_better(read, other):
        return ""
    return (
        f"the calibrated sensors contradict the graph ({_median(read)}, of {len(read)} cycles "
        f"through frames), and their inverses do not ({_median(other)}): rig_from_sensor is "
        "expected, are they sensor_from_rig?"
    )


def _frame_misfits(ends: NDArray[np.int64], between: Floats) -> Floats:
    """Angles by which edges (m, 3, 3) of frames (m, 2) miss: inside, in parallel, in cycles."""
    inside = ends[:, 0] == ends[:, 1]
    turned = ends[:, 0] > ends[:, 1]
    one_way = np.where(turned[:, None, None], np.swapaxes(between, 1, 2), between)
    pairs = np.sort(ends, axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    order = order[~inside[order]]
    parallel = (pairs[order[:-1]] == pairs[order[1:]]).all(axis=1)
    a, b = order[:-1][parallel], order[1:][parallel]
    cycles = separate_cycles(ends[~inside].astype(np.int32))
    return np.concatenate(
        [
            _angles(between[inside], np.broadcast_to(np.eye(3), between[inside].shape)),
            _angles(one_way[a], one_way[b]),
            cycles.errors(between[~inside]),
        ]
    )


def _of_gravity(
    graph: MeasurementGraph, known: Mapping[Any, Any], priors: Priors, tree: Floats
) -> str:
    """Gravity that is elsewhere than `down` in the world of the rotations that are known."""
    row, P = _rows_and_matrices(graph, known)
    label = graph.components()
    ids = list(priors.gravity)
    here, d = _rows_and_matrices(graph, {k: priors.gravity[k][0] for k in ids}, shape=(3,))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    component = label[row[0]]
    row, P = row[label[row] == component], P[label[row] == component]
    here, d = here[label[here] == component], d[label[here] == component]
    if len(here) < LEAST_FEW:
        return ""
    U, _, V = np.linalg.svd((P @ np.swapaxes(tree[row], 1, 2)).sum(axis=0))
    world = U @ np.diag([1, 1, np.sign(np.linalg.det(U @ V))]) @ V
    u = np.einsum("ab,nbc,nc->na", world, tree[here], d)
    mean = np.median(u, axis=0)
    length = float(np.linalg.norm(mean))
    if length < 0.5:  # they point anywhere
        return ""
    mean /= length
    down = np.asarray(priors.down, dtype=np.float64) / np.linalg.norm(priors.down)
    scatter = float(np.median(np.arccos(np.clip(u @ mean, -1, 1))))
    tilt = float(np.arccos(np.clip(mean @ down, -1, 1)))
    if tilt < max(_TILT, _SCATTER * scatter):
        return ""
    along = ", ".join(f"{x + 0.0:.2g}" for x in mean.round(2))
    expected = ", ".join(f"{x + 0.0:.2g}" for x in down.round(2))
    up = np.pi - tilt < 2 * _TILT
    return (
        f"gravity points along ({along}) in the world of the rotations that are known, "
        f"{np.degrees(tilt):.3g} deg from ({expected}), and scatters by {np.degrees(scatter):.2g}: "
        + ("are these directions up? down is expected" if up else "is down another axis there?")
    )


def _rows_and_matrices(
    graph: MeasurementGraph, known: Mapping[Any, Any], shape: tuple[int, ...] = (3, 3)
) -> tuple[NDArray[np.int64], Floats]:
    """Rows (k,) of the nodes, and what is known of them (k, *shape)."""
    keys = [key.item() if isinstance(key, np.generic) else key for key in known]
    values = [v.as_matrix() if hasattr(v, "as_matrix") else v for v in known.values()]
    rows = rows_of(as_ids(keys, "prior"), graph.nodes)
    matrices = np.array(values, dtype=np.float64).reshape(len(keys), *shape)
    return rows[rows >= 0], matrices[rows >= 0]


def _misfits(P: Floats, between: NDArray[Any], R: Floats) -> Floats:
    """(m,) angles between P_i R_ij and P_j."""
    i, j = between.T
    return _angles(P[i] @ R, P[j])


def _angles(A: Floats, B: Floats) -> Floats:
    """(m,) angles between rotations (m, 3, 3), exact where they are small."""
    chord = np.linalg.norm(A - B, axis=(1, 2)) / 8**0.5
    return np.asarray(2 * np.arcsin(np.minimum(1, chord)))


def _median(angles: Floats) -> str:
    return f"median {np.degrees(np.median(angles)).round(4):.3g} deg"
