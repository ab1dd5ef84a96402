"""Exit statuses other than 0, and how a command ends with one."""

from typing import NoReturn

import typer

FAILED, BAD_INPUT = 1, 2


def fail(reason: str) -> NoReturn:
    """End the command with a line on stderr and exit status 1."""
    typer.echo(f"rtstack: {reason}", err=True)
    raise typer.Exit(FAILED)
