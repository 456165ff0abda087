"""The command group and what all commands share: errors, exit statuses, interruption."""

from __future__ import annotations

import sys
import warnings
from typing import Any

import click

import rotavg
from rotavg.cli.colmap import colmap
from rotavg.cli.command import Commands
from rotavg.cli.compare import compare
from rotavg.cli.completion import completion
from rotavg.cli.convert import convert
from rotavg.cli.images import images
from rotavg.cli.info import info
from rotavg.cli.output import print_error
from rotavg.cli.reproduce import reproduce
from rotavg.cli.simulate import simulate
from rotavg.cli.solve import solve
from rotavg.cli.status import INTERRUPTED


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Exit status: 0 solved (or done), 1 not solved, 2 bad input or usage, 130 interrupted.",
)
@click.version_option(rotavg.__version__, package_name="rotavg")
def commands() -> None:
    """Rotation averaging: absolute rotations from relative ones, with a proof of optimality.

    \b
    Examples:
      rotavg simulate sphere -n 2500 --noise 0.1 -o sphere.g2o
      rotavg info sphere.g2o
      rotavg solve sphere.g2o -o solved.g2o --report report.html

    'rotavg COMMAND --help' tells more, with examples.
    """


for command in (
    *(solve, info, simulate, convert, compare),
    *(images, colmap, reproduce, completion),
):
    commands.add_command(command)


def run() -> None:
    """Run the command and exit with its status."""
    warnings.showwarning = _show_warning
    try:
        status = commands.main(prog_name="rotavg", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        status = error.exit_code
    except rotavg.Error as error:
        print_error(str(error))
        status = 2
    except MemoryError as error:
        print_error(f"there is not enough memory: {error}".rstrip(": "))
        status = 2
    except (click.Abort, KeyboardInterrupt):
        click.echo("interrupted", err=True)
        status = INTERRUPTED
    sys.exit(status or 0)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    click.echo(f"warning: {message}", err=True)
