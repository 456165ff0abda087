"""Pose graphs as lines of text, g2o's and TORO's: see `dialects`; pose family.

An edge's rotation is R_ij = i_from_j as it stands. Its weight is SE-Sync's concentration
kappa = 3 / (2 tr(Omega^-1)), Omega the rotation's block of the information (Rosen et al. 2019);
of SE3 edges Omega^-1 becomes the covariance of the measured rotation.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.contents import Quaternions
from rotavg.graph.conventions import first_bad_quaternion
from rotavg.graph.covariances import not_used, of_information
from rotavg.graph.ids import as_edges, as_ids, edge_error, unique_ids
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.translations import RelativeTranslations, first_not_positive_definite
from rotavg.io import g2o_priors, g2o_write
from rotavg.io.absolute import (
    AbsoluteRotations,
    RotationReader,
    check_quaternions,
    distinct,
)
from rotavg.io.angles import angle_notes
from rotavg.io.dialects import DIALECTS, G2O_3D, Dialect
from rotavg.io.g2o_lines import Lines, check_fixed, edge_table, integers, read_at_once
from rotavg.io.lines import (
    BYTE_ORDER_MARK,
    check_finite,
    content_lines,
    is_number,
    shown,
)
from rotavg.io.pose_priors import PriorsOfFile
from rotavg.io.registry import Format, ReadOptions, blame_line, how_used
from rotavg.io.rounding import quaternion_notes

_EDGES = {dialect.edge: dialect for dialect in DIALECTS}
_VERTICES = {dialect.vertex: dialect for dialect in DIALECTS}
# Tags of applications and tutorials, too, of which an error lists what was found; after those an id
# stands, as a name may look like one.
_G2O_TAG = re.compile(
    rb"^[ \t]*((VERTEX|EDGE)_SE[23](:QUAT)?[ \t]|\w*(VERTEX|EDGE)_\w+(:\w+)?[ \t]+-?\d+[ \t])",
    re.MULTILINE | re.IGNORECASE,
)
_TORO_TAG = re.compile(rb"^[ \t]*(VERTEX|EDGE)[23][ \t]", re.MULTILINE)


def read_g2o(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read a pose graph; lines with other tags are skipped, counted and told."""
    edges: dict[Dialect, Lines] = defaultdict(Lines)
    vertices: dict[Dialect, Lines] = defaultdict(Lines)
    unknown: Counter[bytes] = Counter()
    fixed: dict[int, int] = {}
    of_priors: list[tuple[int, bytes]] = []
    kinds = [(d.edge, 2, d.num_pose + len(d.order)) for d in DIALECTS]
    kinds += [(d.vertex, 1, d.num_pose) for d in DIALECTS]
    found = read_at_once(data, kinds)
    if found is None:
        rest = content_lines(path, data)
    else:
        tables, rest = found[0], iter(found[1])
        edges.update((d, t) for d, t in zip(DIALECTS, tables) if t.lines)
        vertices.update((d, t) for d, t in zip(DIALECTS, tables[len(DIALECTS) :]) if t.lines)
    for line, text in rest:
        fields = text.split(None, 3)
        tag = fields[0]
        if tag in _EDGES:
            edges[_EDGES[tag]].add(path, line, fields, num_ids=2)
        elif tag in _VERTICES:
            vertices[_VERTICES[tag]].add(path, line, text.split(None, 2), num_ids=1)
        elif tag == g2o_write.FIX:
            fixed.update(dict.fromkeys(integers(path, line, text.split()[1:]), line))
        elif tag in g2o_priors.TAGS:
            of_priors.append((line, text))
        else:
            unknown[tag] += 1
    if not edges:
        unknown += g2o_priors.priors_in_lines(path, None, of_priors)[1]
        raise FormatError(f"the file has no edges: {_no_line(vertices, unknown)}", path=path)
    dialect = max((d for d in DIALECTS if d in edges), key=lambda d: len(edges[d].lines))
    unknown += Counter({d.edge: len(e.lines) for d, e in edges.items() if d is not dialect})
    unknown += Counter({d.vertex: len(v.lines) for d, v in vertices.items() if d is not dialect})
    priors, useless = g2o_priors.priors_in_lines(path, dialect, of_priors)
    return _graph(
        path, data, options, dialect, edges[dialect], vertices[dialect], fixed, priors,
        unknown + useless,
    )  # fmt: skip


def read_vertices(path: Path, data: bytes) -> AbsoluteRotations:
    """Read the rotations of the vertices."""
    vertices: dict[Dialect, Lines] = defaultdict(Lines)
    others: Counter[bytes] = Counter()
    for line, text in content_lines(path, data):
        fields = text.split(None, 2)
        if fields[0] in _VERTICES:
            vertices[_VERTICES[fields[0]]].add(path, line, fields, num_ids=1)
        else:
            others[fields[0]] += 1
    if not vertices:
        known = ", ".join(tag.decode() for tag in _VERTICES)
        found = f"the file has no vertices, no line {known}; found {_listed(others)}"
        raise FormatError(found, path=path)
    ids: list[int] = []
    lines: list[int] = []
    rotations = []
    notes: tuple[str, ...] = ()
    for dialect, found_here in vertices.items():
        table = found_here.numbers(path, dialect.num_pose)
        turns = table[:, dialect.dimension :]
        check_finite(path, turns, found_here.lines, dialect.angles)
        if dialect is G2O_3D:
            notes += check_quaternions(path, turns, found_here.lines)
        ids += found_here.ids
        lines += found_here.lines
        rotations.append(dialect.rotations(turns))
    nodes = distinct(path, ids, lines)
    return AbsoluteRotations(nodes, np.concatenate(rotations), notes=notes)


def _graph(
    path: Path,
    data: bytes,
    options: ReadOptions,
    dialect: Dialect,
    edges: Lines,
    vertices: Lines,
    fixed: dict[int, int],
    priors: PriorsOfFile | None,
    unknown: Counter[bytes],
) -> MeasurementGraph:
    lines = edges.lines
    given = np.empty((0, dialect.num_pose))
    if vertices.lines:
        given = vertices.numbers(path, dialect.num_pose)
    check_fixed(path, dialect, vertices, given, fixed)
    table = edge_table(path, dialect, edges, options.unit_weights)
    poses = table[:, : dialect.num_pose]
    turns = poses[:, dialect.dimension :]
    notes = _unknown_notes(unknown)
    if priors is not None:
        notes += (f"{priors.knows}{how_used(path)}",)
    if dialect is G2O_3D:
        notes += quaternion_notes(path, turns, lines)
    else:
        notes += angle_notes(turns, lines)
    told = table.shape[1] > dialect.num_pose
    information = table[:, dialect.num_pose :] if told else None  # the values of it
    if not told:
        notes += ("the edges have no information: every edge weighs 1",)
    weights = np.ones(len(lines))
    covariances: NDArray[np.float64] | None = None
    if information is not None and not options.unit_weights:
        omega = dialect.rotation_information(information)
        weights = information_weights(path, omega, lines)
        if dialect.dimension == 3:
            covariances, bad_row = of_information(omega, weights > 0)
            if bad_row is not None:
                notes += (not_used(f"in line {lines[bad_row]}"),)
    with blame_line(path, lines):
        ids = as_edges(edges.id_array().reshape(-1, 2))
        bad = first_bad_quaternion(turns) if dialect is G2O_3D else None
        if bad is not None:
            raise edge_error(ids, *bad)
        translations, further = _translations(dialect, poses, information)
        nodes = unique_ids(as_ids(np.append(edges.id_array(), vertices.id_array()), "nodes"))
        return MeasurementGraph(
            ids,
            Quaternions(turns) if dialect is G2O_3D else dialect.rotations(turns),
            weights,
            nodes,
            translations=translations,
            source=g2o_write.PoseFile(
                data.removeprefix(BYTE_ORDER_MARK),
                dialect,
                np.array(lines),
                weights,
                frozenset(nodes.tolist()),
                dict(zip(vertices.ids, given)),
                frozenset(fixed),
                priors,
            ),
            notes=notes + further,
            covariances=covariances,
            **options.of_graph,
        )


def _translations(
    dialect: Dialect,
    poses: NDArray[np.float64],
    information: NDArray[np.float64] | None,
) -> tuple[RelativeTranslations | None, tuple[str, ...]]:
    """The edges' translations, if they say anything, and what the user should know."""
    vectors = dialect.translations(poses)
    if not vectors.any():
        return None, ()
    if information is None:
        return RelativeTranslations(vectors, dimension=dialect.dimension), ()
    omega = dialect.translation_information(information)
    bad = first_not_positive_definite(omega)
    if bad is not None:
        return None, (
            "translations not used: the information about them is not positive definite "
            f"(edge {bad})",
        )
    cross = dialect.cross_information(information)
    shared = cross if cross.any() and np.isfinite(cross).all() else None  # with unit weights
    return RelativeTranslations(vectors, omega, cross=shared, dimension=dialect.dimension), ()


def information_weights(
    path: Path, omega: NDArray[np.float64], lines: Sequence[int]
) -> NDArray[np.float64]:
    """What the information says of rotations; without any, 0: the edge is not used."""
    weights = np.where((omega == 0).all(axis=(1, 2)), 0.0, g2o_write.kappa(omega))
    bad = np.isnan(weights)
    if bad.any():
        found = "the rotation part of the information matrix is not positive definite"
        hint = "expected one that is (or read with unit weights, which ignore it)"
        raise FormatError(f"{found}, {hint}", path=path, line=lines[int(np.argmax(bad))])
    return weights


def _unknown_notes(unknown: Counter[bytes]) -> tuple[str, ...]:
    if not unknown:
        return ()
    count = sum(unknown.values())
    return (f"{count} line{'s' * (count > 1)} with unknown tags skipped ({_listed(unknown)})",)


def _no_line(vertices: dict[Dialect, Lines], unknown: Counter[bytes]) -> str:
    known = ", ".join(tag.decode() for tag in _EDGES)
    tags = unknown + Counter({d.vertex: len(v.lines) for d, v in vertices.items()})
    return f"no line {known}" + (f"; found {_listed(tags)}" if tags else "")


def _has_tag(head: bytes) -> bool:
    """Whether lines begin with a word: in a file of this name, a tag."""
    if b"\0" in head:
        return False
    for _, text in content_lines(Path(), head):
        return not is_number(text.split(None, 1)[0])
    return False


def _listed(tags: Counter[bytes]) -> str:
    listed = [f"{shown(tag)[1:-1]}: {count}" for tag, count in tags.most_common(5)]
    return ", ".join(listed + ["..."] * (len(tags) > 5))


G2O = Format(
    name="g2o",
    suffixes=(".g2o",),
    recognises=lambda head: _G2O_TAG.search(head) is not None,
    read=read_g2o,
    write=g2o_write.write_g2o,
    has_translations=True,
    has_covariances=True,
    puts_back=True,
    claims=_has_tag,
    rotations=RotationReader(
        (), read_vertices, lambda head: _G2O_TAG.search(head) is not None, (".g2o",)
    ),
    has_positions=True,
)
TORO = Format(
    name="toro",
    suffixes=(".graph", ".toro"),
    recognises=lambda head: _TORO_TAG.search(head) is not None,
    read=read_g2o,
    write=g2o_write.write_toro,
    has_translations=True,
    has_covariances=True,
    puts_back=True,
    claims=_has_tag,
    rotations=RotationReader(
        (),
        read_vertices,
        lambda head: _TORO_TAG.search(head) is not None,
        (".graph", ".toro"),
    ),
    has_positions=True,
)
