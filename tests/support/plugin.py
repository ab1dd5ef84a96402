"""A package of another author, installed for a while: in this process and in those that it starts."""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from hal import extensions


@contextmanager
def installed(folder: Path, offers: str, modules: Mapping[str, str], name: str = "lab-tools") -> Iterator[Path]:
    """Install version 1.2 of a package. offers: its entry points, as in entry_points.txt; modules: text by name."""
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text)
    information = folder / f"{name.replace('-', '_')}-1.2.dist-info"
    information.mkdir(exist_ok=True)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
    (information / "entry_points.txt").write_text(offers)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
        patch.setenv("PYTHONPATH", os.pathsep.join(paths))
        extensions._offered.cache_clear()
        yield folder
    extensions._offered.cache_clear()
    for module in modules:
        sys.modules.pop(module, None)
