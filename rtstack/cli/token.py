"""`rtstack token`: bearer tokens of programs, made and revoked beside the logs; a running console sees it at once."""

import getpass
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from console.tokens import Scope, Tokens, TokensError
from rtstack.live.audit import FILE_NAME, AuditTrail
from rtstack.trials.errors import TrialError


def create(name: str, scope: str, logs: Path) -> None:
    """Make a token and print it, the only time that it is shown. Raises TrialError."""
    if scope not in list(Scope):
        raise TrialError(f"--scope: one of {', '.join(Scope)}, not {scope}")
    with _tokens(logs) as tokens:
        token, word = tokens.create(name, Scope(scope))
    typer.echo(word)
    typer.echo("Keep it: it cannot be shown again. Requests bring it as `Authorization: Bearer TOKEN`.", err=True)
    _note(logs, f"made token {token.id} for {token.name}: {token.scope}")


def list_all(logs: Path) -> None:
    """Print a row for each token. Raises TrialError."""
    with _tokens(logs) as tokens:
        rows = tokens.all()
    table = Table("id", "name", "scope", "made")
    for row in rows:
        made = time.strftime("%Y-%m-%d %H:%M", time.localtime(row.created_s))
        table.add_row(row.id, Text(row.name), row.scope, made)
    Console().print(table if rows else "no tokens")


def revoke(token_id: str, logs: Path) -> None:
    """Revoke a token. Raises TrialError."""
    with _tokens(logs) as tokens:
        token = tokens.revoke(token_id)
    typer.echo(f"{token.name} ({token.id}) is revoked")
    _note(logs, f"revoked token {token.id} of {token.name}")


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
