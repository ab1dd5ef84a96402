"""Browsers' sessions beside the logs: they outlive the console's process, so that a restart signs no operator out.

The file has the SHA-256 of each cookie, 256 random bits. Control of the robot is not kept: the lease ends by itself.
"""

import json
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT
from hal.base.files import write_whole
from rtstack.access.tokens import Scope
from rtstack.live.protocol import Operator
from rtstack.references.acceptance import load_beside

FILE_NAME = "sessions.json"  # in the folder of logs


@checked(frozen=True, slots=True, config=STRICT)
class KeptSession:
    """A session as it is kept. digest: SHA-256 of its cookie, hexadecimal; ends_s: Unix time, s."""

    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    operator: Operator
    scope: Scope
    ends_s: float


class SessionFile:
    """The file. One that is broken, missing or cannot be written signs browsers out at the next restart."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_NAME

    def load(self) -> dict[str, KeptSession]:
        """Return the sessions that have not ended, by digest."""
        with suppress(ValueError):
            kept = load_beside(self._path, list[KeptSession], ValueError)
            return {one.digest: one for one in kept if one.ends_s > time.time()}
        return {}

    def save(self, kept: list[KeptSession]) -> None:
        """Replace the file. Only this user can read it."""
        with suppress(OSError):
            write_whole(self._path, json.dumps([asdict(one) for one in kept], indent=1), mode=0o600)
