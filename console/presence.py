"""Signs of life: the console's own, and those of the operators whose pages and programs it hears.

Both are given by the console's event loop: while it hangs, neither the console nor anybody behind it is there.
"""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from rtstack.live.notify import Notifier
from rtstack.loop.mailbox import Mailbox

BEAT_S = 0.1


class Presence:
    """Who was heard of since somebody last asked. May be used from any thread."""

    def __init__(self) -> None:
        self._heard: set[str] = set()

    def note(self, operator: str) -> None:
        """Note a sign of life of an operator's page or program."""
        self._heard.add(operator)

    def heard(self, operator: str | None) -> bool:
        """Whether the operator was heard of since the last call."""
        was_heard = operator in self._heard
        self._heard.clear()
        return was_heard


@asynccontextmanager
async def heartbeat(mailbox: Mailbox) -> AsyncIterator[None]:
    """Give the console's sign of life every BEAT_S for as long as this event loop turns."""

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
