"""A COLMAP database that is there whole, or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rotavg.base.errors import FileAccessError
from rotavg.io.atomic import new_file


@contextmanager
def new_database(path: Path) -> Iterator[Path]:
    """A place for one that Python or pycolmap writes, moved to `path` in the end.

    Raises FileAccessError if there is a file at `path` already, and where SQLite or the operating
    system cannot write (a full disk), with nothing left behind.
    """
    with new_file(path) as temporary, writing(path):
        yield temporary


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """What goes wrong where databases are written, as FileAccessError that names the path."""
    import sqlite3  # not every Python has it

    try:
        yield
    except FileAccessError:
        raise
    except (sqlite3.Error, OSError) as error:
        raise FileAccessError(f"cannot be written: {error}", path=path) from error
    except RuntimeError as error:  # pycolmap's: "[database_sqlite.cc:1362] SQLite error: …"
        _, found, reason = str(error).partition("SQLite error: ")
        if not found:
            raise
        raise FileAccessError(f"cannot be written: {reason.strip()}", path=path) from error
