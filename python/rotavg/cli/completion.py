"""`rotavg completion`."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from rotavg.cli.output import print_text


@click.command(short_help="Print a script for completion in bash, zsh or fish.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print a script that lets a shell complete commands, options, words and files.

    \b
    Examples:
      rotavg completion bash > ~/.local/share/bash-completion/completions/rotavg
      echo 'eval "$(rotavg completion zsh)"' >> ~/.zshrc
      rotavg completion fish > ~/.config/fish/completions/rotavg.fish
    """
    scripts = get_completion_class(shell)
    assert scripts is not None
    root = click.get_current_context().find_root().command
    print_text(scripts(root, {}, "rotavg", "_ROTAVG_COMPLETE").source())
