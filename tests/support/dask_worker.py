"""A Dask worker in the tests' own process."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from distributed import Client, LocalCluster

LOOPBACK = "127.0.0.1"


@contextmanager
def dask_worker() -> Iterator[Client]:
    """Give a client of one worker, a thread of this process; nothing is heard outside of it."""
    quiet = {"dashboard": False, "dashboard_address": f"{LOOPBACK}:0"}
    with (
        LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, host=LOOPBACK, protocol="tcp://",
            silence_logs=logging.CRITICAL,
            scheduler_kwargs=quiet,
        ) as cluster,
        Client(cluster) as client,
    ):  # fmt: skip
        yield client
