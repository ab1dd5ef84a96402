"""Heartbeats: the console's own, and its operators'. While its event loop does not respond, there are neither."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from rtstack.live.notify import Notifier
from rtstack.loop.mailbox import Mailbox

BEAT_S = 0.1


class OperatorHeartbeats:
    """The operators that sent a message since the last query. May be used from any thread."""

    def __init__(self) -> None:
        self._heard: set[str] = set()

    def note(self, operator: str) -> None:
        """Note a message of an operator's page or program."""
        self._heard.add(operator)

    def heard(self, operator: str | None) -> bool:
        """Whether the operator sent a message since the last call."""
        was_heard = operator in self._heard
        self._heard.clear()
        return was_heard


@asynccontextmanager
async def heartbeat(mailbox: Mailbox) -> AsyncIterator[None]:
    """Write the console's heartbeat every BEAT_S while this event loop runs."""
    notifier = Notifier()

    async def beat() -> None:
        while True:
            mailbox.console_beat(time.monotonic_ns())
            notifier.alive()
            await asyncio.sleep(BEAT_S)

    task = asyncio.create_task(beat())
    try:
        yield
    finally:
        task.cancel()
        notifier.close()
