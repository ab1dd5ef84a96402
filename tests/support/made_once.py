"""What takes seconds to make and nobody changes: made by the worker of a test run that needs it first, for all."""

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from hal.base.files import locked, write_whole

Made = TypeVar("Made")


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], Made]) -> Made:
    """Return what `make` returns for a folder of this name, from the first worker of pytest-xdist that asks."""
    base = factory.getbasetemp().parent if "PYTEST_XDIST_WORKER" in os.environ else factory.getbasetemp()
    kept, folder = base / f"{name}.pickle", base / name
    with locked(base / f"{name}.lock"):
        if not kept.exists():
            folder.mkdir(exist_ok=True)
            write_whole(kept, pickle.dumps(make(folder)))
    return pickle.loads(kept.read_bytes())
