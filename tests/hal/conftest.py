"""The real server in a process of its own, in lockstep: nothing here depends on how busy the machine is."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rtstack.cells.simulator import Simulator

if TYPE_CHECKING:  # it brings pylibfranka, which not every Python has
    from hal.fci import FciPair


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    """A lockstep server of the test's own, whose plant has not moved yet."""
    simulator = Simulator("rice_box", 0.0, 3, lockstep=True)
    yield simulator
    simulator.close()


@pytest.fixture
def pair(simulator: Simulator) -> Iterator["FciPair"]:
    """Both arms of that server, idle."""
    from hal.fci import open_pair

    pair = open_pair(simulator.left, simulator.right, shared_clock=True)
    yield pair
    pair.close()


@pytest.fixture
def scripted(tmp_path: Path) -> Callable[[str], AbstractContextManager["FciPair"]]:
    """Open both arms of a lockstep server with a script of faults."""
    from hal.fci import open_pair

    @contextmanager
    def served(script: str) -> Iterator["FciPair"]:
        (tmp_path / "script.toml").write_text(script)
        simulator = Simulator("rice_box", 0.0, 3, lockstep=True, faults=tmp_path / "script.toml")
        pair = open_pair(simulator.left, simulator.right, shared_clock=True)
        try:
            yield pair
        finally:
            pair.close()
            simulator.close()

    return served
