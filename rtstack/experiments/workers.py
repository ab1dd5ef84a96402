"""The workers: processes on this machine, or those of a Dask scheduler elsewhere."""

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from multiprocessing import resource_tracker
from typing import Any

import dask.config
from distributed import Client, Future, LocalCluster
from distributed.security import Security

from hal.base.shared import private_folder
from rtstack.experiments.admission import Admission
from rtstack.trials.errors import TrialError

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
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


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
        resource_tracker.ensure_running()  # its first start would unblock the signals in the thread that needs it
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
        try:
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, host=LOOPBACK, silence_logs=logging.CRITICAL,
                protocol="tls://", security=Security.temporary(),
                # the scheduler's HTTP server cannot be left out: let it be out of the way, with no dashboard
                scheduler_kwargs={"dashboard": False, "dashboard_address": f"{LOOPBACK}:0"},
            )  # fmt: skip
            client = Client(cluster, timeout=CONNECT_S)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
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
