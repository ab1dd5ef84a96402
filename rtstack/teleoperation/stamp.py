"""What each command of teleoperation says of itself: who sent it, when, by what clock, and which picture it answers."""

import secrets
import time
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from rtstack.messages import MESSAGE, StrictFloat

Milliseconds = Annotated[StrictFloat, Field(ge=0.0, le=1e15)]
Count = Annotated[int, Field(ge=0, lt=1 << 53, strict=True)]


@checked(frozen=True, slots=True, config=MESSAGE)
class Stamp:
    """sender: a word that it has chosen for itself; sequence: rises with each command; made_ms: when the command was
    made, seen_ms: when the picture with this number was seen, both by the sender's clock, which never goes back.
    camera_us: the time that came with a camera's picture, where the sender looks at one: the older of both counts.
    """

    sender: Annotated[str, Field(pattern=r"^[0-9A-Za-z_-]{1,32}$")]
    sequence: Count
    made_ms: Milliseconds
    picture: Count
    seen_ms: Milliseconds
    camera_us: Count | None = None


class Sender:
    """Stamps the messages of a program. An answer of the console has the picture that the next command answers."""

    def __init__(self) -> None:
        self._name, self._sequence = secrets.token_hex(8), 0
        self._picture, self._seen_ms = 0, 0.0

    def saw(self, answer: dict[str, Any]) -> dict[str, Any]:
        """Take note of the picture that an answer brings, and return the answer."""
        if answer.get("picture"):
            self._picture, self._seen_ms = answer["picture"], 1e3 * time.monotonic()
        return answer

    def stamped(self, message: dict[str, Any]) -> dict[str, Any]:
        """Return a message that says what it answers, made now."""
        self._sequence += 1
        stamp = {"sender": self._name, "sequence": self._sequence, "made_ms": 1e3 * time.monotonic()}
        return message | {"stamp": stamp | {"picture": self._picture, "seen_ms": self._seen_ms}}
