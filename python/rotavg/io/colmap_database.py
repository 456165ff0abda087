"""COLMAP's database, read only: relative poses of verified image pairs; vision family.

A row of `two_view_geometries` has pair_id = 2147483647 * smaller_id + larger_id, the number of
inliers, a configuration and, where they were computed, qvec (w x y z) and tvec: camera 2 from 1.
Nodes are the images' names, weights the numbers of inliers. The file is opened read-only through
Python's sqlite3.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.io.registry import Format, ReadOptions, blame_line

if TYPE_CHECKING:
    import sqlite3

MAX_IMAGES = 2147483647
CONFIGURATIONS = (
    "undefined", "degenerate", "calibrated", "uncalibrated", "planar", "panoramic",
    "planar or panoramic", "watermark", "multiple", "calibrated rig",
)  # fmt: skip
# Whose relative pose is that of two cameras that see one rigid scene.
_USABLE = frozenset({2, 3, 4, 5, 6, 9})
_MAGIC = b"SQLite format 3\0"


@dataclass(frozen=True, eq=False)
class ColmapImages:
    """Ids (n,) of the images and of their cameras in the database, by name.

    Also of each edge (m,) the configuration, by its number in `CONFIGURATIONS`.
    """

    image_ids: dict[str, int]
    camera_ids: dict[str, int]
    configurations: NDArray[np.int64]

    def select(self, edges: NDArray[np.bool_]) -> ColmapImages:
        """The source of the graph that keeps the edges (m,) marked True."""
        return ColmapImages(self.image_ids, self.camera_ids, self.configurations[edges])


def pair_of(pair_id: int) -> tuple[int, int]:
    """Image ids, the smaller one first, of a pair id."""
    large = pair_id % MAX_IMAGES
    return (pair_id - large) // MAX_IMAGES, large


def pair_id_of(i: int, j: int) -> int:
    """Pair id of two image ids, in either order."""
    return MAX_IMAGES * min(i, j) + max(i, j)


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """A read-only connection; FormatError or FileAccessError where the file is no database."""
    import sqlite3  # not every Python has it

    uri = f"file:{quote(str(path.resolve()))}?mode=ro"
    if not path.with_name(path.name + "-wal").exists():
        uri += "&immutable=1"  # nobody writes: SQLite leaves no files of its own beside it
    try:
        with closing(sqlite3.connect(uri, uri=True)) as connection:
            yield connection
    except sqlite3.OperationalError as error:
        if "no such" in str(error):
            found = f"found no COLMAP database: {error}"
            raise FormatError(found, path=path) from error
        raise FileAccessError(f"cannot be read: {error}", path=path) from error
    except sqlite3.DatabaseError as error:
        raise FormatError(f"found no readable database: {error}", path=path) from error


def read_database(path: Path, data: bytes, options: ReadOptions) -> MeasurementGraph:
    """Read the pairs that have a relative pose; tell how many others there are and why."""
    del data  # only its beginning, to tell what it is
    with opened(path) as connection:
        images = connection.execute("SELECT image_id, name, camera_id FROM images").fetchall()
        rows = connection.execute(
            "SELECT pair_id, rows, config, qvec, tvec FROM two_view_geometries ORDER BY pair_id"
        ).fetchall()
    names = {image: name for image, name, _ in images}
    ids, quaternions, inliers, kinds = [], [], [], []
    skipped: Counter[str] = Counter()
    for pair_id, count, kind, qvec, tvec in rows:
        pair = pair_of(pair_id)
        reason = _reason_to_skip(count, kind, qvec, tvec)
        if reason:
            skipped[reason] += 1
            continue
        if not all(image in names for image in pair):
            found = f"pair_id {pair_id} is images {pair[0]} and {pair[1]}"
            raise FormatError(f"{found}, expected ids in the table images", path=path)
        ids.append([names[image] for image in pair])
        quaternions.append(_vector(path, pair_id, qvec, 4))
        inliers.append(float(count))
        kinds.append(kind)
    if not ids:
        raise FormatError(_nothing(len(rows), skipped), path=path)
    with blame_line(path):
        return MeasurementGraph.from_quaternions(
            ids,
            quaternions,
            None if options.unit_weights else inliers,
            [name for _, name, _ in sorted(images)],
            order="wxyz",
            convention=options.convention,
            source=ColmapImages(
                {name: image for image, name, _ in images},
                {name: camera for _, name, camera in images},
                np.array(kinds),
            ),
            notes=tuple(f"{n} pairs skipped: {why}" for why, n in sorted(skipped.items())),
        )


def read_gravity_of(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """Names of the images with a gravity prior, and it (k, 3), in the camera's frame."""
    with opened(path) as connection:
        rows = connection.execute(
            "SELECT name, gravity FROM pose_priors JOIN images ON corr_data_id = image_id "
            "WHERE corr_sensor_type = 0 AND gravity IS NOT NULL ORDER BY image_id"
        ).fetchall()
    vectors = [_vector(path, name, blob, 3) for name, blob in rows]
    known = [k for k, vector in enumerate(vectors) if np.isfinite(vector).all()]
    found = np.array([vectors[k] for k in known]).reshape(-1, 3)
    return [rows[k][0] for k in known], found


def _reason_to_skip(count: int, kind: int, qvec: bytes | None, tvec: bytes | None) -> str:
    if kind not in _USABLE:
        known = 0 <= kind < len(CONFIGURATIONS)
        return f"configuration {CONFIGURATIONS[kind] if known else kind}"
    if qvec is None:
        return "no relative pose computed"
    if count <= 0:
        return "no inliers"
    # COLMAP before 3.12 wrote the identity where it had computed nothing.
    if tvec is not None and not any(tvec) and qvec == np.array([1.0, 0, 0, 0]).tobytes():
        return "no relative pose computed"
    return ""


def _vector(path: Path, row: Any, blob: bytes, size: int) -> NDArray[np.float64]:
    if not isinstance(blob, bytes) or len(blob) != 8 * size:
        found = f"found {len(blob) if isinstance(blob, bytes) else type(blob).__name__}"
        raise FormatError(f"{row}: {found} bytes, expected {size} doubles", path=path)
    return np.frombuffer(blob, dtype="<f8").astype(np.float64)


def _nothing(pairs: int, skipped: Counter[str]) -> str:
    if not pairs:
        return "the database has no verified image pairs: match the images first"
    why = ", ".join(f"{reason}: {count}" for reason, count in skipped.most_common())
    hint = "expected some (pycolmap computes them with compute_relative_pose = True)"
    return f"none of the {pairs} image pairs has a relative pose ({why}), {hint}"


COLMAP_DATABASE = Format(
    name="colmap",
    suffixes=(".db",),
    recognises=lambda head: head.startswith(_MAGIC),
    read=read_database,
    write=None,
    convention="vision",
    magic=_MAGIC,
)
