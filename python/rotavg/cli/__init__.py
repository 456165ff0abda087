"""The command `rotavg`."""

from __future__ import annotations

import sys

from rotavg.cli.status import INTERRUPTED


def main() -> None:
    """Run the command; needs the packages click and rich."""
    try:
        try:
            from rotavg.cli.main import run
        except ModuleNotFoundError as error:
            if error.name not in ("click", "rich"):
                raise
            sys.exit(f"rotavg: the command line needs {error.name}: pip install click rich")
        run()
    except KeyboardInterrupt:  # before the command has begun, or after it has ended
        sys.stderr.write("interrupted\n")
        sys.exit(INTERRUPTED)
