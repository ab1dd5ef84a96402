"""The real server in a process of its own, in lockstep: nothing here depends on how busy the machine is."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rtstack.testing import ServedArms, serve_arms

if TYPE_CHECKING:  # it brings pylibfranka, which not every Python has
    from hal.fci import FciPair


@pytest.fixture
def pair(served_arms: ServedArms) -> Iterator["FciPair"]:
    """Both arms of that server, idle."""
    from hal.fci import open_pair

    pair = open_pair(served_arms.left, served_arms.right, shared_clock=True)
    yield pair
    pair.close()


@pytest.fixture
def scripted(tmp_path: Path) -> Callable[[str], AbstractContextManager["FciPair"]]:
    """Open both arms of a lockstep server with a script of faults."""
    from hal.fci import open_pair

    @contextmanager
    def served(script: str) -> Iterator["FciPair"]:
        (tmp_path / "script.toml").write_text(script)
        with serve_arms(faults=tmp_path / "script.toml") as served:
            pair = open_pair(served.left, served.right, shared_clock=True)
            try:
                yield pair
            finally:
                pair.close()

    return served
