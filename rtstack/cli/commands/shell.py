"""What a shell is told: how to complete the command's words."""

from enum import StrEnum
from typing import Annotated

import typer
from typer.completion import get_completion_script

commands = typer.Typer()
VARIABLE = "_RTSTACK_COMPLETE"  # set by the script while it asks for completions


class Shell(StrEnum):
    """A shell that can complete."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


@commands.command()
def completion(shell: Annotated[Shell, typer.Argument(help="Which shell.")]) -> None:
    """Print the script with which a shell completes commands, options and files.

    bash: put `eval "$(rtstack completion bash)"` into ~/.bashrc; zsh: the same with zsh into ~/.zshrc, after compinit;
    fish: rtstack completion fish > ~/.config/fish/completions/rtstack.fish
    """
    typer.echo(get_completion_script(prog_name="rtstack", complete_var=VARIABLE, shell=shell))
