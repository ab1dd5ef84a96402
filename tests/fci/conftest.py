"""Servers that tests share, or have of their own."""

import contextlib
import os
from collections.abc import Callable, Iterator

import pytest
from fci_server import Served, serve


@pytest.fixture(autouse=True)
def _ordinary_scheduling() -> Iterator[None]:
    """Take back the SCHED_FIFO that libfranka gives the thread that controls, where it is allowed to."""
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.fixture
def fresh_server() -> Callable[..., contextlib.AbstractContextManager[Served]]:
    """Start a server of the test's own."""
    return serve


@pytest.fixture(scope="session")
def lockstep() -> Iterator[Served]:
    """A lockstep server that tests share: each leaves both arms idle."""
    with serve("--lockstep") as served:
        yield served


@pytest.fixture(scope="session")
def realtime() -> Iterator[Served]:
    """A real-time server that tests share."""
    with serve() as served:
        yield served
