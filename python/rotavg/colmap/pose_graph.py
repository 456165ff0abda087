"""pycolmap's PoseGraph: relative poses cam2_from_cam1 of pairs of image ids; vision family."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from rotavg.base.errors import GraphError, require
from rotavg.graph.conventions import convert_family, wxyz_from_xyzw
from rotavg.graph.ids import IdArray
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_covariances import PairPose, covariances_of_pairs
from rotavg.io.colmap_database import ColmapImages
from rotavg.io.colmap_sqlite import MAX_IMAGES, opened, pair_of


def from_pose_graph(
    pose_graph: Any,
    *,
    unit_weights: bool = False,
    database: str | os.PathLike[str] | None = None,
) -> MeasurementGraph:
    """The valid edges of a `pycolmap.PoseGraph`.

    Nodes are image ids; an edge (i, j) has i < j and weighs its number of matches, or 1 where that
    is not known (0) and with `unit_weights`. Edges are in the order of COLMAP's pair ids. With a
    `database`, COLMAP's, they have covariances: from the inliers that it has of every pair
    (docs/covariances.md).

    Raises:
        GraphError: there is no such edge.
        FormatError, FileAccessError: the database is none, or not to be read.
    """
    # pycolmap hands out every object by itself, and that takes most of the time: once is enough.
    edges = {pair_id: edge for pair_id, edge in pose_graph.edges.items() if edge.valid}
    if not edges:
        raise GraphError("the pose graph has no valid edge")
    ids = sorted(edges)
    poses = [edges[pair_id].cam2_from_cam1 for pair_id in ids]
    quaternions = np.array([pose.rotation.quat for pose in poses])
    weights = np.ones(len(ids))
    if not unit_weights:
        weights = np.array([edges[pair_id].num_matches or 1 for pair_id in ids], dtype=np.float64)
    pairs = np.stack(np.divmod(np.array(ids, dtype=np.int64), MAX_IMAGES), axis=1)
    covariances = None
    if database is not None:
        translations = np.array([pose.translation for pose in poses], dtype=np.float64)
        translations[~np.isfinite(translations).all(axis=1)] = 0.0
        known = [
            PairPose(pair_id, *pair_of(pair_id), wxyz, translation)
            for pair_id, wxyz, translation in zip(ids, wxyz_from_xyzw(quaternions), translations)
        ]
        with opened(Path(database)) as connection:
            covariances, _ = covariances_of_pairs(connection, known)
    return MeasurementGraph.from_quaternions(
        pairs, quaternions, weights, convention="vision", covariances=covariances
    )


def to_pose_graph(graph: MeasurementGraph) -> Any:
    """The same as a `pycolmap.PoseGraph`, without translations; weights as numbers of matches.

    Node ids are image ids, or names that the graph brought along from a COLMAP database. Needs
    pycolmap, the extra [colmap].

    Raises:
        GraphError: other names, ids that are no image ids, or two edges between the same images.
        MissingExtraError: pycolmap is not installed.
    """
    pycolmap = require("pycolmap", "colmap")
    ids = _image_ids(graph)
    result = pycolmap.PoseGraph()
    R = convert_family(graph.rotations, "vision")
    for k, (i, j) in enumerate(graph.indices.tolist()):
        first, second = int(ids[i]), int(ids[j])
        if result.has_edge(first, second):
            found = f"edge {k} is a second one between the images {first} and {second}"
            raise GraphError(f"{found}: a pose graph of COLMAP has one at most", edge=k)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.ascontiguousarray(R[k])), np.zeros(3))
        count = max(1, round(float(graph.weights[k])))
        # Where the first id is the larger one, pycolmap turns the edge round.
        edge = pycolmap.PoseGraphEdge(cam2_from_cam1=pose, num_matches=count)
        result.add_edge(first, second, edge)
    return result


def _image_ids(graph: MeasurementGraph) -> IdArray:
    if isinstance(graph.source, ColmapImages):
        known = graph.source.image_ids
        return np.array([known[name] for name in graph.nodes.tolist()])
    if graph.nodes.dtype.kind == "U":
        found = f"nodes have names such as {graph.nodes[0].item()!r}"
        raise GraphError(f"{found}, expected the image ids of a COLMAP database")
    low, high = graph.nodes.min().item(), graph.nodes.max().item()
    if low < 0 or high >= 2**31 - 1:
        raise GraphError(f"nodes run from {low} to {high}, expected image ids below 2^31 - 1")
    return graph.nodes
