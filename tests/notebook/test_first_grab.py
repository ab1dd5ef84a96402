"""The example's notebook, run as a notebook service does: from the wheel, without a clone, a display or a browser."""

import json
import os
import shutil
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from tests.support.wheel import build, copy_sources

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "examples" / "first_grab.ipynb"
EXECUTE = """
import nbformat, nbclient
book = nbformat.read("first_grab.ipynb", 4)
nbclient.NotebookClient(book, timeout=1500).execute()
nbformat.write(book, "done.ipynb")
"""


def test_it_is_kept_without_outputs() -> None:
    assert not any(cell.get("outputs") for cell in json.loads(NOTEBOOK.read_text())["cells"])


@pytest.fixture
def executed(tmp_path: Path) -> dict[str, dict[str, Any]]:
    """The cells of code, by their names, after a run in a new environment, an empty home and a folder of their own.

    Packages are taken from the user's index, in the versions that the tests run with.
    """
    copy_sources(tmp_path / "source")
    wheel, here, venv = build(tmp_path / "source", tmp_path / "built"), tmp_path / "here", tmp_path / "venv"
    for folder in (here, tmp_path / "home"):
        folder.mkdir()
    for file in (wheel, NOTEBOOK):
        shutil.copy(file, here)
    subprocess.run([sys.executable, "-m", "venv", str(venv)], check=True)
    subprocess.run([str(venv / "bin" / "pip"), "install", "--quiet", "nbclient", "ipykernel"], check=True)
    without = ("DISPLAY", "NUMBA_CACHE_DIR", "PYTHONPATH", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in without} | {
        "HOME": str(tmp_path / "home"), "PATH": f"{venv / 'bin'}:/usr/bin:/bin",
        "PIP_CACHE_DIR": str(Path.home() / ".cache" / "pip"), "PIP_CONSTRAINT": str(ROOT / "constraints.txt"),
        "PIP_CONFIG_FILE": str(Path.home() / ".config" / "pip" / "pip.conf"),
    }  # fmt: skip
    subprocess.run([str(venv / "bin" / "python"), "-c", EXECUTE], cwd=here, env=environment, check=True, timeout=1600)
    assert {path.name for path in here.iterdir()} == {wheel.name, NOTEBOOK.name, "done.ipynb"}
    assert (here / "done.ipynb").stat().st_size < 1_000_000
    cells = json.loads((here / "done.ipynb").read_text())["cells"]
    return {cell["id"]: cell for cell in cells if cell["cell_type"] == "code"}


def _time(cell: dict[str, Any], event: str) -> datetime:
    return datetime.fromisoformat(cell["metadata"]["execution"][event])


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_it_runs_from_the_wheel_alone(executed: dict[str, dict[str, Any]]) -> None:
    shown = {name: [output.get("data", {}) for output in cell["outputs"]] for name, cell in executed.items()}
    assert len(shown["grab"]) == len(shown["law"]) == 1
    assert all("image/png" in shown[name][0] for name in ("grab", "law"))
    assert executed["read"]["outputs"][0]["text"][0].startswith("242 mm lifted, ")
    assert "".join(shown["table"][-1]["text/html"]).count("100 % [44, 100]") == 2
    took = _time(executed["grab"], "shell.execute_reply") - _time(executed["install"], "iopub.execute_input")
    print(f"first picture after {took.total_seconds():.0f} s")
