"""The real server in a process of its own, in lockstep: nothing here depends on how busy the machine is."""

from collections.abc import Iterator

import pytest

from hal.fci import FciPair, open_pair
from rtstack.cells.simulator import Simulator


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    """A lockstep server of the test's own, whose plant has not moved yet."""
    simulator = Simulator("rice_box", 0.0, 3, lockstep=True)
    yield simulator
    simulator.close()


@pytest.fixture
def pair(simulator: Simulator) -> Iterator[FciPair]:
    """Both arms of that server, idle."""
    pair = open_pair(simulator.left, simulator.right, shared_clock=True)
    yield pair
    pair.close()
