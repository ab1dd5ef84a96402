"""The workers: processes on this machine, or those of a Dask scheduler elsewhere."""

import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from typing import Any

import dask.config
from distributed import Client, Future, LocalCluster, Status, Worker
from distributed.security import Security

from hal.base.shared import private_folder
from rtstack.experiments.task import starting
from rtstack.experiments.version import present
from rtstack.trials.errors import TrialError

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


LOOPBACK = "127.0.0.1"
CONNECT_S = 10.0
FIRST_WORKER_S = 60.0
END_S = 10.0
_KEPT_BYTES = 1 << 28
# workers are heard from in seconds; a worker that dies takes its trial to another one, this often
_SETTINGS = {
    "distributed.scheduler.allowed-failures": 3,
    "distributed.comm.timeouts.connect": f"{CONNECT_S}s",
    "distributed.admin.log-format": "%(message)s",
    "distributed.admin.low-level-log-length": 100,  # messages that it keeps for its developers: by default 40 MB
    # HTTP has no TLS, and no answer that a campaign needs
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # a worker computes: to look at its stack a hundred times a second, and to give its memory back after each trial,
    # costs a tenth of its time
    "distributed.worker.profile.enabled": False,
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": _KEPT_BYTES,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": _KEPT_BYTES,
}


@contextmanager
def local_workers(workers: int) -> Iterator[Client]:
    """Give so many worker processes of one thread each, heard on the loopback address only, with no dashboard.

    A scheduler runs what it is sent: its clients and workers prove by TLS that they have this campaign's key, which is
    in its processes' memory alone. They end with this process, the only one that Ctrl-C reaches.
    """
    # workers that are ended in a trial leave its memory to Python's resource tracker: no need to warn of that
    os.environ["PYTHONWARNINGS"] = "ignore::UserWarning:multiprocessing.resource_tracker"
    with (
        private_folder("campaign") as folder,
        dask.config.set(_SETTINGS | {"temporary-directory": str(folder)}),
        _quiet(),
    ):
        with starting():
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, host=LOOPBACK, silence_logs=logging.CRITICAL,
                protocol="tls://", security=Security.temporary(),
                # the scheduler's HTTP server cannot be left out: let it be out of the way, with no dashboard
                scheduler_kwargs={"dashboard": False, "dashboard_address": f"{LOOPBACK}:0"},
            )  # fmt: skip
            client = Client(cluster, timeout=CONNECT_S)
        try:
            yield client
        finally:
            client.close(timeout=END_S)
            cluster.close(timeout=END_S)


class DistantClient(Client):
    """A client whose work goes to workers of our version only."""

    admission: Admission

    def submit(self, func: Callable[..., Any], *args: Any, **kwargs: Any) -> Future:
        return super().submit(func, *args, resources=self.admission.ticket, **kwargs)


@contextmanager
def distant_workers(address: str) -> Iterator[Client]:
    """Give the workers of the scheduler at tcp://HOST:PORT with our version. Raises TrialError without any."""
    start = f"`dask worker {address} --nthreads 1`"
    with dask.config.set(_SETTINGS), _quiet(), ExitStack() as ending:
        try:
            client = DistantClient(address, timeout=CONNECT_S)
        except (OSError, ValueError, TimeoutError) as error:
            reason = str(error).splitlines()[0] if str(error) else "no answer"
            raise TrialError(
                f"no scheduler at {address}: {reason}; start one with `dask scheduler`, and workers with {start}"
            ) from None
        ending.callback(client.close, timeout=END_S)
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_S)
        except TimeoutError:
            raise TrialError(f"the scheduler at {address} has no workers: start some with {start}") from None
        admission = client.admission = ending.enter_context(closing(Admission(client)))
        if not admission.slots:
            others = "; ".join(admission.refused.values())
            raise TrialError(f"no worker of the scheduler at {address} has our version: {others}")
        admission.begin()
        yield client


def slots(client: Client) -> int:
    if isinstance(client, DistantClient):
        return client.admission.slots
    return sum(client.nthreads().values())  # pyright: ignore[reportAttributeAccessIssue] (not a coroutine here)


@contextmanager
def _quiet() -> Iterator[None]:
    """Let distributed say nothing: what matters to a person is said by the runner."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado.application", "asyncio")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    hook = sys.unraisablehook
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
