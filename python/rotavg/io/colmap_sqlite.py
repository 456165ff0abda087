"""COLMAP's database as a file of SQLite: opened read-only, its pair ids, and numbers in its blobs.

pair_id = 2147483647 * smaller_id + larger_id. Python's sqlite3 reads it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import FileAccessError, FormatError

if TYPE_CHECKING:
    import sqlite3

MAX_IMAGES = 2147483647


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
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        # SQLite's own messages quote a damaged schema, which need not be text.
        raise FormatError(f"found no readable database: {error}", path=path) from error


def doubles(path: Path, row: Any, blob: bytes, size: int) -> NDArray[np.float64]:
    """(size,) numbers of a blob; FormatError, which names the row, for another size."""
    if not isinstance(blob, bytes) or len(blob) != 8 * size:
        found = f"found {len(blob) if isinstance(blob, bytes) else type(blob).__name__}"
        raise FormatError(f"{row}: {found} bytes, expected {size} doubles", path=path)
    return np.frombuffer(blob, dtype="<f8").astype(np.float64)
