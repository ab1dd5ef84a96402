"""A console for each test."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.console.served_console import ServedConsole, serve_console


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedConsole]:
    """Serve a console over real sockets."""
    logs = tmp_path / "logs"
    logs.mkdir()
    with serve_console(logs) as console:
        yield console
