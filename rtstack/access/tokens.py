"""Bearer tokens: what a program signs in with. Kept beside the logs, in a file that only this user can open.

The file has the SHA-256 of each token, 256 random bits; command line and console write it, one at a time.
"""

import hashlib
import hmac
import json
import os
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT
from hal.base.files import locked, write_whole

FILE_NAME = "tokens.json"  # in the folder of logs
MAX_TOKENS = 64
_PREFIX = "rtstack"

# shorter than an operator's name: a number may be added to keep names apart
TokenName = Annotated[str, Field(min_length=1, max_length=32, pattern=r"^[^\p{C}\s]([^\p{C}]*[^\p{C}\s])?$")]


class Scope(StrEnum):
    """What a session may do: look (and press STOP, as everybody may), or everything."""

    VIEW = "view"
    OPERATE = "operate"


class TokensError(Exception):
    """The file of tokens cannot be used, or not in this way. The message is one line."""


class NoSuchToken(TokensError):
    """There is no token with this id."""


@checked(frozen=True, slots=True, config=STRICT)
class Token:
    """A token as it is kept. `created_s`: Unix time, s; `digest`: SHA-256 of the token, in hexadecimal; `panel`: the
    only one that it may look at, None for everything that its scope allows."""

    id: Annotated[str, Field(pattern=r"^[0-9a-f]{8}$")]
    name: TokenName
    scope: Scope
    created_s: float
    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    panel: str | None = None


_TOKENS = TypeAdapter(list[Token])
_NAME = TypeAdapter(TokenName)


class Tokens:
    """The tokens of a folder of logs. May be used from any thread, by several processes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.path = folder / FILE_NAME
        self._read: tuple[tuple[int, int, int], dict[str, Token]] | None = None
        self._known: dict[str, Token] = {}  # that may still stop: see `may_stop`
        self._known_in = 0  # inode of the folder
        with suppress(TokensError):
            self._load()

    def all(self) -> tuple[Token, ...]:
        """Return the tokens, oldest first. Raises TokensError."""
        return tuple(self._load().values())

    def get(self, token_id: str) -> Token | None:
        """Return a token that is valid, None where there is none, or the file cannot be trusted."""
        try:
            return self._load().get(token_id)
        except TokensError:
            return None

    def match(self, word: str) -> Token | None:
        """Return the token that a program brings, None where it is none of ours."""
        prefix, _, rest = word.partition("_")
        token = self.get(rest.partition("_")[0]) if prefix == _PREFIX else None
        known = token is not None and hmac.compare_digest(_digest(word), token.digest)
        return token if known else None

    def may_stop(self, word: str) -> Token | None:
        """Return the token that a program brings for STOP alone, None where it is none of ours.

        A token that was not revoked keeps this right while its file is missing, replaced or cannot be trusted.
        """
        token = self.match(word) or self._known.get(word.partition("_")[2].partition("_")[0])
        return token if token is not None and hmac.compare_digest(_digest(word), token.digest) else None

    def create(self, name: str, scope: Scope, panel: str | None = None) -> tuple[Token, str]:
        """Make a token; return it and its word, which cannot be shown again. Raises TokensError."""
        if panel is not None and scope is not Scope.VIEW:
            raise TokensError("panel: a token for one panel may look, its scope is `view`")
        try:
            name = _NAME.validate_python(name)
        except ValidationError:
            raise TokensError("name: one line of 1 to 32 characters, without space around it") from None
        with self._changing() as tokens:
            if any(token.name == name for token in tokens.values()):
                raise TokensError(f"there is a token called {name}; choose another name, or revoke that one")
            if len(tokens) >= MAX_TOKENS:
                raise TokensError(f"there are {MAX_TOKENS} tokens; revoke one first")
            token_id = secrets.token_hex(4)
            word = f"{_PREFIX}_{token_id}_{secrets.token_urlsafe(32)}"
            token = tokens[token_id] = Token(token_id, name, scope, time.time(), _digest(word), panel)
            return token, word

    def revoke(self, token_id: str) -> Token:
        """Remove a token; return what it was. Raises TokensError."""
        with self._changing() as tokens:
            if token_id not in tokens:
                raise NoSuchToken(f"there is no token {token_id}")
            return tokens.pop(token_id)

    def _load(self) -> dict[str, Token]:
        """Read the file again where it has changed. Raises TokensError."""
        try:
            status = self.path.stat()
            if status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o077:
                raise TokensError(f"{self.path}: others may open it, so no token counts: chmod 600 it, or remove it")
            mark = status.st_ino, status.st_mtime_ns, status.st_size
            read = self._read
            if read is None or read[0] != mark:
                tokens = {token.id: token for token in _TOKENS.validate_json(self.path.read_bytes())}
                folder = self._folder.stat().st_ino
                revoked = read[1].keys() - tokens if read is not None and folder == self._known_in else ()
                self._known = {key: token for key, token in self._known.items() if key not in revoked} | tokens
                self._known_in = folder
                read = self._read = mark, tokens
            return read[1]
        except FileNotFoundError:
            return {}
        except (OSError, ValidationError) as error:
            line = str(error).splitlines()[0]
            raise TokensError(f"{self.path}: {line}; remove the file to begin anew") from None

    @contextmanager
    def _changing(self) -> Iterator[dict[str, Token]]:
        """Give the tokens for changing, one process at a time, and write them: all, or nothing."""
        try:
            with locked(self._folder):  # not the file, which is replaced
                tokens = dict(self._load())
                yield tokens
                rows = [{k: v for k, v in asdict(token).items() if v is not None} for token in tokens.values()]
                content = json.dumps(rows, indent=1)  # as older versions read it, where no token is for a panel
                write_whole(self.path, content, durable=True, mode=0o600)
                self._load()  # a revoked token ends here, whatever becomes of the folder
        except OSError as error:
            raise TokensError(f"{self.path}: cannot be written: {error.strerror}") from None


def _digest(word: str) -> str:
    return hashlib.sha256(word.encode(errors="replace")).hexdigest()
