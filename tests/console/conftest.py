"""A console for each test."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.console.served_console import ServedConsole, serve_console


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedConsole]:
    """Serve a console over real sockets."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))  # plans of the user's own are written there
    logs = tmp_path / "logs"
    logs.mkdir()
    with serve_console(logs) as console:
        yield console
