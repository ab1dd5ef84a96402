"""Heartbeats: the console's own, and its operators'. While its event loop does not respond, there are neither."""

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager

from rtstack.live.notify import Notifier
from rtstack.loop.mailbox import Mailbox

BEAT_S = 0.1
LOAD_S = 10.0  # a page's scripts took up to 5 s on a machine with a load of 16


class OperatorHeartbeats:
    """The operators that are there: by a message since the last query, by a page that is being loaded, or by a page
    that the browser has frozen while its connection is open. May be used from any thread.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._heard = clock, set[str]()
        self._loads: dict[str, float] = {}  # until when a page may be loading, by operator
        self._asleep = Counter[str]()  # frozen pages, by operator

    def note(self, operator: str) -> None:
        """Note a message of an operator's page or program."""
        self._heard.add(operator)

    def load(self, operator: str) -> None:
        """Note that an operator's browser requests a page, which cannot beat before its scripts run."""
        self._loads[operator] = self._clock() + LOAD_S

    @contextmanager
    def asleep(self, operator: str) -> Iterator[None]:
        """Count the operator as there while the block waits for the answers of a frozen page's connection."""
        self._asleep[operator] += 1
        try:
            yield
        finally:
            self._asleep[operator] -= 1

    def heard(self, operator: str | None) -> bool:
        """Whether the operator sent a message since the last call, loads a page, or has a page that is frozen."""
        was_heard = operator in self._heard
        self._heard.clear()
        if operator is None:
            return False
        return was_heard or self._loads.get(operator, 0.0) > self._clock() or self._asleep[operator] > 0


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
