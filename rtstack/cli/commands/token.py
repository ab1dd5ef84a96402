"""`rtstack token`."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import LogFolder

commands = typer.Typer(help="Let programs use the console (bearer tokens), and a browser back in (sign-in).")


@commands.command("create")
def token_create(
    name: Annotated[str, typer.Option(help="What the program is called, in the audit trail too.")],
    scope: Annotated[str, typer.Option(help="view: look, and press STOP; operate: everything.")] = "view",
    logs: LogFolder = Path("logs"),
) -> None:
    """Make a token for a program and print it, once."""
    from rtstack.cli.token import create as run

    run(name, scope, logs)


@commands.command("list")
def token_list(logs: LogFolder = Path("logs")) -> None:
    """List the tokens, without what makes them tokens."""
    from rtstack.cli.token import list_all as run

    run(logs)


@commands.command("revoke")
def token_revoke(
    token_id: Annotated[str, typer.Argument(metavar="ID", help="As `rtstack token list` has it.")],
    logs: LogFolder = Path("logs"),
) -> None:
    """Revoke a token: a running console does not know it any more from now on."""
    from rtstack.cli.token import revoke as run

    run(token_id, logs)


@commands.command("sign-in")
def token_sign_in(
    scope: Annotated[str, typer.Option(help="view: look, and press STOP; operate: everything.")] = "operate",
    logs: LogFolder = Path("logs"),
    console: Annotated[str, typer.Option(metavar="URL", help="Of the running console.")] = "http://127.0.0.1:8080",
) -> None:
    """Print a fresh address of a running console, for a browser that has lost its cookies."""
    from rtstack.cli.token import sign_in as run

    run(scope, logs, console)
