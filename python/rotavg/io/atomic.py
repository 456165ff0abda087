"""Files that are either written whole or not touched."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from rotavg.base.errors import FileAccessError
from rotavg.io.streams import STDOUT, is_closed, write_to_stdout


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write each file to a temporary one beside it, then move them all there, each in one step.

    Raises FileAccessError; then nothing is left behind, and files that were there are as they were
    (unless moving itself fails, after the writing has not). A folder is made for them where there
    is none but its parent. A pipe or a device cannot be replaced and is written to directly, as is
    standard output, after what is there.
    """
    temporary: dict[Path, Path] = {}
    made: list[Path] = []
    path = Path()
    try:
        for path, data in files.items():
            if len(files) > 1 and not path.parent.exists():
                path.parent.mkdir()
                made.append(path.parent)
            if path == STDOUT:
                write_to_stdout(data)
                continue
            if path.exists() and not path.is_file():
                path.write_bytes(data)  # a directory fails here, too
                continue
            temporary[path] = _beside(_target(path), data)
        for path, ready in temporary.items():
            ready.replace(_target(path))
        made.clear()
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be written: {reason}", path=path) from error
    finally:
        for undo in [*(ready.unlink for ready in temporary.values()), *(f.rmdir for f in made)]:
            with suppress(OSError):  # the error to tell is the first
                undo()


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """A place to write a file that is moved to `path` in the end, if nothing went wrong.

    For what other libraries write, SQLite's databases for one. Raises FileAccessError if there is
    a file at `path` already, or on what the operating system refuses.
    """
    import tempfile  # seldom needed, slow to import

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


def make_folder(path: Path) -> None:
    """A folder at `path`, and those above it, where there are none; FileAccessError otherwise."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileAccessError(f"cannot be made a folder: {reason}", path=path) from error


def check_writable(path: Path) -> None:
    """FileAccessError if it can be told beforehand that `write_files` would fail."""
    folder = Path(os.path.realpath(path)).parent
    if str(path) == "-":
        reason = "standard output is /dev/stdout"
    elif is_closed(path):
        reason = "it is closed"
    elif path.is_dir():
        reason = "it is a folder"
    elif not folder.is_dir():
        reason = f"{folder} is no folder" if folder.exists() else f"there is no folder {folder}"
    elif not os.access(path if path.exists() else folder, os.W_OK):
        reason = "permission denied"
    else:
        return
    raise FileAccessError(f"cannot be written: {reason}", path=path)


def check_distinct(outputs: Iterable[Path | None], inputs: Iterable[Path | None] = ()) -> None:
    """FileAccessError if an output would replace an input or another output; None is no file.

    Links count as what they lead to. Pipes and devices may be named more than once.
    """
    taken = {_target(path) for path in inputs if path is not None}
    for path in outputs:
        if path is None or path == STDOUT or (path.exists() and not path.is_file()):
            continue
        if _target(path) in taken:
            raise FileAccessError(
                "it would replace another file of this run, expected a name of its own", path=path
            )
        taken.add(_target(path))


def _target(path: Path) -> Path:
    return Path(os.path.realpath(path))  # a link stays a link


def _beside(target: Path, data: bytes) -> Path:
    """A temporary file with this content, ready to replace `target`."""
    import secrets  # brings OpenSSL along, which `import rotavg` does without

    if target.exists() and not os.access(target, os.W_OK):
        target.open("ab").close()  # raises: replacing would get round the write protection
    temporary = target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as stream:
            stream.write(data)
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary
