"""`rtstack token`: bearer tokens of programs, made and revoked beside the logs; a running console sees it at once."""

import getpass
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import typer

from console.tokens import Scope, Tokens, TokensError
from rtstack.cli.tables import print_table
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.trials.errors import TrialError

_PATIENCE_S = 10.0


def create(name: str, scope: str, logs: Path) -> None:
    """Make a token and print it, the only time that it is shown. Raises TrialError."""
    wanted = _scope(scope)
    with _tokens(logs) as tokens:
        token, word = tokens.create(name, wanted)
    typer.echo(word)
    typer.echo("Keep it: it cannot be shown again. Requests bring it as `Authorization: Bearer TOKEN`.", err=True)
    _note(logs, f"made token {token.id} for {token.name}: {token.scope}")


def list_all(logs: Path) -> None:
    """Print a row for each token. Raises TrialError."""
    with _tokens(logs) as tokens:
        rows = tokens.all()
    made = [time.strftime("%Y-%m-%d %H:%M", time.localtime(row.created_s)) for row in rows]
    cells = [(row.id, row.name, row.scope, when) for row, when in zip(rows, made, strict=True)]
    print_table(("id", "name", "scope", "made"), cells, "no tokens")


def revoke(token_id: str, logs: Path) -> None:
    """Revoke a token. Raises TrialError."""
    with _tokens(logs) as tokens:
        token = tokens.revoke(token_id)
    typer.echo(f"{token.name} ({token.id}) is revoked")
    _note(logs, f"revoked token {token.id} of {token.name}")


def sign_in(scope: str, logs: Path, console: str) -> None:
    """Print an address that signs one browser in, once. Raises TrialError.

    A running console is asked for it with a token that is good for this question alone.
    """
    wanted = _scope(scope)
    with _tokens(logs) as tokens:
        token, word = tokens.create(f"sign-in {secrets.token_hex(4)}", Scope.OPERATE)
        try:
            answer = httpx.post(
                f"{console}/api/invitations", json={"scope": wanted}, headers={"authorization": f"Bearer {word}"},
                trust_env=False, timeout=_PATIENCE_S,
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


def _scope(word: str) -> Scope:
    if word not in list(Scope):
        raise TrialError(f"--scope: one of {', '.join(Scope)}, not {word}")
    return Scope(word)


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
    user = _user()
    audit.note("token", user, f"{user} {text}")
    audit.close()


def _user() -> str:
    try:
        return f"{getpass.getuser()}, terminal"
    except (OSError, KeyError):  # a user without a name
        return "unknown user, terminal"
