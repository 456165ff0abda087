"""COLMAP's database, read only: relative poses of verified image pairs; vision family.

A row of `two_view_geometries` has a pair id (`colmap_sqlite`), the number of inliers, a
configuration and, where they were computed, qvec (w x y z) and tvec: camera 2 from 1.
Where they were not, they are computed here (`colmap_poses`), if pycolmap is installed.
Nodes are the images' names, weights the numbers of inliers; covariances, where they are asked for,
are estimated from the inliers (`colmap_covariances`); what the database knows beside the pairs is
read by `colmap_priors`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.colmap_covariances import PairPose, covariances_of_pairs
from rotavg.io.colmap_poses import poses_of_pairs
from rotavg.io.colmap_priors import count_gravity, rigs_in
from rotavg.io.colmap_sqlite import doubles, opened, pair_of
from rotavg.io.colmap_tables import ColmapTables, tables_in
from rotavg.io.registry import Format, ReadOptions, blame_line, how_used
from rotavg.io.rounding import is_unit
from rotavg.priors.priors import Rigs

if TYPE_CHECKING:
    import sqlite3

CONFIGURATIONS = (
    "undefined", "degenerate", "calibrated", "uncalibrated", "planar", "panoramic",
    "planar or panoramic", "watermark", "multiple", "calibrated rig",
)  # fmt: skip
# Whose relative pose is that of two cameras that see one rigid scene.
_USABLE = frozenset({2, 3, 4, 5, 6, 9})
_NO_POSE = "no relative pose computed"
_IDENTITY = np.array([1.0, 0, 0, 0]).tobytes()
_Pose = tuple[NDArray[np.float64], NDArray[np.float64]]  # wxyz, translation
_MAGIC = b"SQLite format 3\0"


@dataclass(frozen=True, eq=False)
class ColmapImages:
    """Ids (n,) of the images and of their cameras in the database, by name.

    Also of each edge (m,) the configuration, by its number in `CONFIGURATIONS`, and the rigs of
    several cameras, where there are any: frames by their ids, sensors by those of their cameras.
    What a model is made of are `tables` (`colmap_model`).
    """

    image_ids: dict[str, int]
    camera_ids: dict[str, int]
    configurations: NDArray[np.int64]
    rigs: Rigs | None = None
    tables: ColmapTables | None = None

    @property
    def knows(self) -> str:
        """What the database knows beside the measurements; "" for nothing."""
        if self.rigs is None:
            return ""
        return f"rigs of {len({frame for frame, _ in self.rigs.images.values()})} frames"

    def select(self, edges: NDArray[np.bool_]) -> ColmapImages:
        """The source of the graph that keeps the edges (m,) marked True."""
        return replace(self, configurations=self.configurations[edges])


def read_database(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the pairs that have a relative pose, or one that can be computed; tell of the others."""
    del data  # only its beginning, to tell what it is
    with opened(path) as connection:
        images = connection.execute("SELECT image_id, name, camera_id FROM images").fetchall()
        has_poses = _has_poses(connection)
        columns = "qvec, tvec" if has_poses else "NULL, NULL"
        rows = connection.execute(
            f"SELECT pair_id, rows, config, {columns} FROM two_view_geometries ORDER BY pair_id"
        ).fetchall()
        names = {image: name for image, name, _ in images}
        rigs = rigs_in(path, connection)
        tables = tables_in(connection)
        gravity = count_gravity(connection)
        stored, without, skipped = _sorted_out(path, rows, names)
        computed = (
            poses_of_pairs(connection, [(pair, *pair_of(pair)) for pair in without])
            if without
            else {}
        )
        poses = {**stored, **(computed or {})}
        used = [row for row in rows if row[0] in poses]
        covariances, guessed = None, 0
        if options.covariances and used:
            covariances, guessed = covariances_of_pairs(
                connection, [PairPose(pair, *pair_of(pair), *poses[pair]) for pair, *_ in used]
            )
    skipped[_NO_POSE] = len(without) - len(computed or {})
    notes = _notes(has_poses, computed, skipped)
    if guessed:
        notes += (f"{guessed} pairs whose inliers do not tell a covariance got a usual one",)
    if rigs is not None:
        notes += (f"{_note_of_rigs(rigs)}{how_used(path)}",)
    if gravity:
        notes += (
            f"{gravity} images have gravity, which --gravity takes from the database, in Python "
            f"rotavg.read_priors({str(path)!r}, graph, gravity=True)",
        )
    if not used:
        raise FormatError(_nothing(len(rows), skipped, notes), path=path)
    with blame_line(path):
        return MeasurementGraph.from_quaternions(
            [[names[image] for image in pair_of(pair_id)] for pair_id, *_ in used],
            [poses[pair_id][0] for pair_id, *_ in used],
            np.ones(len(used)) if options.unit_weights else [float(n) for _, n, *_ in used],
            [name for _, name, _ in sorted(images)],
            order="wxyz",
            covariances=covariances,
            **options.of_graph,
            source=ColmapImages(
                {name: image for image, name, _ in images},
                {name: camera for _, name, camera in images},
                np.array([kind for _, _, kind, *_ in used]),
                rigs,
                tables,
            ),
            notes=notes,
        )


def _has_poses(connection: sqlite3.Connection) -> bool:
    columns = connection.execute("PRAGMA table_info(two_view_geometries)").fetchall()
    return not columns or "qvec" in {name for _, name, *_ in columns}


def _sorted_out(
    path: Path, rows: list[Any], names: dict[int, str]
) -> tuple[dict[int, _Pose], list[int], Counter[str]]:
    """Stored poses by pair id, pairs without one, and why how many others are skipped."""
    stored: dict[int, _Pose] = {}
    without = []
    skipped: Counter[str] = Counter()
    for pair_id, count, kind, qvec, tvec in rows:
        for name, value in (("rows", count), ("config", kind)):
            if not isinstance(value, int):
                found = f"pair_id {pair_id}: {name} is of type {type(value).__name__}"
                raise FormatError(f"{found}, expected an integer", path=path)
        reason = _reason_to_skip(path, pair_id, count, kind, qvec, tvec)
        if reason and reason != _NO_POSE:
            skipped[reason] += 1
            continue
        pair = pair_of(pair_id)
        if not all(image in names for image in pair):
            found = f"pair_id {pair_id} is images {pair[0]} and {pair[1]}"
            raise FormatError(f"{found}, expected ids in the table images", path=path)
        if reason:
            without.append(pair_id)
        else:
            stored[pair_id] = doubles(path, pair_id, qvec, 4), _translation(tvec)
    return stored, without, skipped


def _translation(tvec: Any) -> NDArray[np.float64]:
    """(3,); zero, as of a camera that turned, where none is stored."""
    if not isinstance(tvec, bytes) or len(tvec) != 24:
        return np.zeros(3)
    t = np.frombuffer(tvec, dtype="<f8").astype(np.float64)
    return t if np.isfinite(t).all() else np.zeros(3)


def _reason_to_skip(
    path: Path, pair_id: int, count: int, kind: int, qvec: bytes | None, tvec: bytes | None
) -> str:
    if kind not in _USABLE:
        known = 0 <= kind < len(CONFIGURATIONS)
        return f"configuration {CONFIGURATIONS[kind] if known else kind}"
    if count <= 0:
        return "no inliers"
    # COLMAP before 3.12 wrote the identity where it had computed nothing, or zeros.
    if qvec is None or (qvec == _IDENTITY and isinstance(tvec, bytes) and not any(tvec)):
        return _NO_POSE
    quaternion = doubles(path, pair_id, qvec, 4)
    if not quaternion.any():
        return _NO_POSE
    return "" if is_unit(quaternion) else "the stored pose is no rotation"


def _notes(
    has_poses: bool, computed: dict[int, _Pose] | None, skipped: Counter[str]
) -> tuple[str, ...]:
    notes = []
    if not has_poses:
        notes.append("the database is of a COLMAP too old to store relative poses")
    if computed:
        what = "1 relative pose is" if len(computed) == 1 else f"{len(computed)} relative poses are"
        notes.append(
            f"{what} computed from two-view geometry, inliers and cameras, as COLMAP stored none"
        )
    for why, n in sorted(skipped.items()):
        if n:
            notes.append(f"{n} pair{'s' * (n != 1)} skipped: {why}")
    if computed is None:
        notes.append('with pycolmap they are computed here: pip install "rotavg[colmap]"')
    return tuple(notes)


def _note_of_rigs(rigs: Rigs) -> str:
    sensors = {sensor for _, sensor in rigs.images.values()}
    known = len(sensors & rigs.rotations.keys())
    frames = len({frame for frame, _ in rigs.images.values()})
    return f"rigs: {len(sensors)} sensors, of which {known} are calibrated, in {frames} frames"


def _nothing(pairs: int, skipped: Counter[str], notes: tuple[str, ...]) -> str:
    if not pairs:
        return "the database has no verified image pairs: match the images first"
    why = ", ".join(f"{reason}: {count}" for reason, count in skipped.most_common() if count)
    further = [note for note in notes if "skipped" not in note]
    hint = "expected some (pycolmap computes them with compute_relative_pose = True)"
    return "; ".join(
        [f"none of the {pairs} image pairs has a relative pose ({why}), {hint}", *further]
    )


COLMAP_DATABASE = Format(
    name="colmap",
    suffixes=(".db",),
    recognises=lambda head: head.startswith(_MAGIC),
    read=read_database,
    write=None,
    convention="vision",
    magic=_MAGIC,
)
