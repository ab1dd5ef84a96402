"""What a shell is told: how to complete the command's words."""

from typing import Annotated, Literal

import typer
from typer.completion import completion_init, shell_complete  # pyright: ignore[reportPrivateImportUsage]

commands = typer.Typer()
VARIABLE = "_RTSTACK_COMPLETE"  # set by the script while it asks for completions


@commands.command()
def completion(
    context: typer.Context, shell: Annotated[Literal["bash", "zsh", "fish"], typer.Argument(help="Which shell.")]
) -> None:
    """Print the script with which a shell completes commands, options and files.

    bash: put `eval "$(rtstack completion bash)"` into ~/.bashrc; zsh: the same with zsh into ~/.zshrc, after compinit;
    fish: rtstack completion fish > ~/.config/fish/completions/rtstack.fish
    """
    completion_init()
    shell_complete(context.find_root().command, {}, "rtstack", VARIABLE, f"source_{shell}")
