"""`rtstack token`: bearer tokens of programs, made and revoked beside the logs; a running console sees it at once."""

import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from hal.base.shared import user_name
from rtstack.access.tokens import Scope, Tokens, TokensError
from rtstack.cli.options import LogFolder
from rtstack.cli.tables import print_table
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.live.panel import PANELS
from rtstack.trials.errors import TrialError

_PATIENCE_S = 10.0
commands = typer.Typer()
token = typer.Typer(help="Let programs use the console (bearer tokens), and a browser back in (sign-in).")
commands.add_typer(token, name="token")
ScopeName = Annotated[Scope, typer.Option("--scope", help="view: look, and press STOP; operate: everything.")]


@token.command("create")
def token_create(
    name: Annotated[str, typer.Option(help="What the program is called, in the audit trail too.")],
    scope: ScopeName = Scope.VIEW,
    panel: Annotated[str | None, typer.Option(help="To look at this panel of the console, and nothing else.")] = None,
    logs: LogFolder = Path("logs"),
) -> None:
    """Make a token for a program and print it, once."""
    with _tokens(logs) as tokens:
        token, word = tokens.create(name, scope, None if panel is None else PANELS.check(panel))
    typer.echo(word)
    typer.echo("Keep it: it cannot be shown again. Requests bring it as `Authorization: Bearer TOKEN`.", err=True)
    _note(logs, f"made token {token.id} for {token.name}: {panel or token.scope}")


@token.command("list")
def token_list(logs: LogFolder = Path("logs")) -> None:
    """List the tokens, without what makes them tokens."""
    with _tokens(logs) as tokens:
        rows = tokens.all()
    made = [time.strftime("%Y-%m-%d %H:%MZ", time.gmtime(row.created_s)) for row in rows]
    cells = [(row.id, row.name, row.panel or row.scope, when) for row, when in zip(rows, made, strict=True)]
    print_table(("id", "name", "scope", "made"), cells, "no tokens")


@token.command("revoke")
def token_revoke(
    token_id: Annotated[str, typer.Argument(metavar="ID", help="As `rtstack token list` has it.")],
    logs: LogFolder = Path("logs"),
) -> None:
    """Revoke a token: a running console does not know it any more from now on."""
    with _tokens(logs) as tokens:
        token = tokens.revoke(token_id)
    typer.echo(f"{token.name} ({token.id}) is revoked")
    _note(logs, f"revoked token {token.id} of {token.name}")


@token.command("sign-in")
def token_sign_in(
    scope: ScopeName = Scope.OPERATE,
    logs: LogFolder = Path("logs"),
    console: Annotated[str, typer.Option(metavar="URL", help="Of the running console.")] = "http://127.0.0.1:8080",
) -> None:
    """Print a fresh address of a running console, for a browser that has lost its cookies."""
    import httpx

    from rtstack.access.authority import Authority

    with _tokens(logs) as tokens:  # the console is asked with a token that is good for this question alone
        token, word = tokens.create(f"sign-in {secrets.token_hex(4)}", Scope.OPERATE)
        try:
            answer = httpx.post(
                f"{console}/api/invitations", json={"scope": scope}, headers={"authorization": f"Bearer {word}"},
                trust_env=False, timeout=_PATIENCE_S, verify=Authority.trusting(),
            )  # fmt: skip
        except (httpx.HTTPError, httpx.InvalidURL):
            raise TrialError(
                f"no console answers at {console}: start one with `rtstack up`, or give its address with --console"
            ) from None
        finally:
            tokens.revoke(token.id)
    if answer.status_code in (401, 403):
        raise TrialError(f"the console at {console} has other logs than {logs}: give its folder with --logs")
    if answer.status_code != 201:
        raise TrialError(f"the console at {console} answers {answer.status_code}")
    typer.echo(answer.json()["address"])
    typer.echo("Open it in a browser: it signs one in, once, within some minutes.", err=True)


@contextmanager
def _tokens(logs: Path) -> Iterator[Tokens]:
    if not logs.is_dir():
        raise TrialError(f"{logs}: no such folder; give the one of `rtstack up` with --logs")
    try:
        yield Tokens(logs)
    except TokensError as error:
        raise TrialError(str(error)) from None


def _note(logs: Path, text: str) -> None:
    try:
        audit = AuditTrail(logs / FILE_NAME)
    except OSError as error:
        raise TrialError(f"done, but the audit trail {logs / FILE_NAME} cannot be written: {error.strerror}") from None
    user = f"{user_name()}, terminal"
    audit.note("token", user, f"{user} {text}")
    audit.close()
