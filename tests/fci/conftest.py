"""Servers of each test's own."""

import contextlib
import os
from collections.abc import Callable, Iterator

import pytest

from tests.support.fci.server import Served, serve


@pytest.fixture(autouse=True)
def _ordinary_scheduling() -> Iterator[None]:
    """Take back the SCHED_FIFO that libfranka gives the thread that controls, where it is allowed to."""
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.fixture
def fresh_server() -> Callable[..., contextlib.AbstractContextManager[Served]]:
    """Start a server with arguments of the test's choice."""
    return serve


@pytest.fixture
def lockstep() -> Iterator[Served]:
    """A lockstep server: what happens does not depend on how busy the machine is."""
    with serve("--lockstep") as served:
        yield served


@pytest.fixture
def realtime() -> Iterator[Served]:
    """A real-time server."""
    with serve() as served:
        yield served
