"""Which workers get trials: a trial asks for a resource that a worker has once it has shown that it is our version."""

import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from distributed import Client, Status, Worker

from rtstack.experiments.version import present

PERIOD_S = 0.5  # between two looks for workers that have joined


class Admission:
    """Admits the workers of a scheduler, those that are there first and those that join until `close`."""

    def __init__(self, client: Client) -> None:
        """See who is there. `refused` has a line for each worker that gets nothing, `slots` the others' threads."""
        self.slots = 0
        self.refused: dict[str, str] = {}
        self._client = client
        self._version = present()
        self._ticket = f"rtstack-{self._version.digest}"
        self._known: set[str] = set()
        self._closed = threading.Event()
        self._look()

    def begin(self) -> None:
        """Say who was refused, and look for others from now on."""
        for line in self.refused.values():
            _say(line)
        threading.Thread(target=self._watch, name="admission", daemon=True).start()

    @property
    def ticket(self) -> dict[str, float]:
        return {self._ticket: 1.0}

    def close(self) -> None:
        """Look no more. Does not wait for a worker that does not answer."""
        self._closed.set()

    def _watch(self) -> None:
        while not self._closed.wait(PERIOD_S):
            with suppress(Exception):  # the scheduler has gone, or the client is closed: the runner's trials tell it
                for line in self._look():
                    _say(line)

    def _look(self) -> list[str]:
        """Admit or refuse who is new; return the new refusals."""
        # not scheduler_info(): between its question and its answer the client's own, without workers, may be put there
        scheduler: Any = self._client.scheduler
        answer: Any = self._client.sync(scheduler.identity, n_workers=-1)
        workers = answer["workers"]
        self._known &= set(workers)
        lines = []
        for address in sorted(set(workers) - self._known):
            self._known.add(address)
            try:
                refusal = self._admit(address)
            except Exception as error:  # whatever a worker of another version answers
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                refusal = f"the worker at {address} cannot say its version ({reason}): it gets no trials"
            if refusal:
                self.refused[address] = refusal
                lines.append(refusal)
        return lines

    def _admit(self, address: str) -> str:
        """Give a worker trials; return why it gets none, "" where it does."""
        different = self._version.difference(self._ask(address, present))
        if different is not None:
            return f"the worker at {address} has {different}: it gets no trials"
        self.refused.pop(address, None)
        self.slots += self._ask(address, _give_ticket, self._ticket)
        return ""

    def _ask(self, address: str, function: Callable[..., Any], *arguments: str) -> Any:
        """Have a worker call a function of ours, and return what it says. Raises whatever goes wrong there."""
        answers: Any = self._client.run(function, *arguments, workers=[address])  # no coroutine in this client
        return answers[address]


async def _give_ticket(ticket: str, dask_worker: Worker) -> int:
    """On a worker: have the ticket, as often as there are threads, and be looked at again by the scheduler."""
    threads = dask_worker.state.nthreads
    if ticket not in dask_worker.state.total_resources:
        await dask_worker.set_resources(**{ticket: float(threads)})
        # the scheduler looks at trials without a worker when a worker begins to run, not when it has a resource
        dask_worker.status = Status.paused
        dask_worker.status = Status.running
    return threads


def _say(line: str) -> None:
    print(f"rtstack: {line}", file=sys.stderr, flush=True)
