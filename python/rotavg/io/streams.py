"""Standard input and output as files: what is open is used, and not opened anew.

(Opened anew, a file behind them would be at its beginning again, and a socket does not open.)
"""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

STDIN, STDOUT = Path("/dev/stdin"), Path("/dev/stdout")


def open_input(path: Path) -> BinaryIO:
    """A file, or what is left of standard input, to read; OSError if that cannot be."""
    if path != STDIN:
        return path.open("rb")
    if is_closed(path):
        raise OSError(errno.EBADF, "it is closed")
    return os.fdopen(os.dup(0), "rb")


def read_all(path: Path) -> bytes:
    """The content of a file, or what is left of standard input; OSError if there is none."""
    if path != STDIN:
        return path.read_bytes()
    with open_input(path) as stream:
        return stream.read()


def write_to_stdout(data: bytes) -> None:
    """Write behind what was printed there; OSError if that cannot be.

    Where its reader has gone, as in `| head`, the rest is lost, and that is no error.
    """
    if is_closed(STDOUT):
        raise OSError(errno.EBADF, "it is closed")
    sys.stdout.flush()
    with suppress(BrokenPipeError), os.fdopen(os.dup(1), "wb") as stream:
        stream.write(data)


def is_closed(path: Path) -> bool:
    """Whether this is one of the two, and was closed before we began."""
    return (path == STDIN and sys.stdin is None) or (path == STDOUT and sys.stdout is None)
