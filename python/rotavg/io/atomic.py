"""Files that are either written whole or not touched."""

from __future__ import annotations

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rotavg.errors import FileAccessError


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to a temporary file beside `path`, then move it there in one step.

    Raises FileAccessError; then nothing is left behind and a file that was there is as it was.
    A pipe or a device (/dev/stdout) cannot be replaced and is written to directly.
    """
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)  # a directory fails here, too
            return
        target = Path(os.path.realpath(path))  # a link stays a link
        _replace(target, data)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be written: {reason}", path=path) from error


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """A place to write a file that is moved to `path` in the end, if nothing went wrong.

    For what other libraries write, SQLite's databases for one. Raises FileAccessError if there is
    a file at `path` already, or on what the operating system refuses.
    """
    if path.exists():
        raise FileAccessError("there is a file already", path=path)
    check_writable(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name[:100]}.") as folder:
            temporary = Path(folder) / path.name
            yield temporary
            temporary.replace(path)
    except FileAccessError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be written: {reason}", path=path) from error


def check_writable(path: Path) -> None:
    """FileAccessError if it can be told beforehand that `write_bytes` would fail."""
    folder = Path(os.path.realpath(path)).parent
    if path.is_dir():
        reason = "it is a folder"
    elif not folder.is_dir():
        reason = f"there is no folder {folder}"
    elif not os.access(path if path.exists() else folder, os.W_OK):
        reason = "permission denied"
    else:
        return
    raise FileAccessError(f"cannot be written: {reason}", path=path)


def _replace(target: Path, data: bytes) -> None:
    if target.exists() and not os.access(target, os.W_OK):
        target.open("ab").close()  # raises: replacing would get round the write protection
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as stream:
            stream.write(data)
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
