"""A file of the user's that has the name of one of our packages: one line says which, and what to do."""

import subprocess
import sys
from pathlib import Path

import pytest

READS_A_LOG = "import rtstack.log.reader\nprint('imported')"
OPENS_A_CELL = "from rtstack.cells import load_description\nload_description(None)"
ADVICE = "rename it, or move the program away"


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder, whose files it finds first."""
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize("name", ["hal.py", "hal/__init__.py"])
def test_a_hal_of_the_users_is_named_at_the_import(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.touch()
    done = python(tmp_path, "-c", READS_A_LOG)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last == f"ImportError: Python finds {file} in the place of rtstack's package 'hal': {ADVICE}"
    done = python(tmp_path, "-m", "rtstack", "--version")
    assert (done.returncode, done.stderr) == (2, f"rtstack: {last.removeprefix('ImportError: ')}\n")


def test_a_deploy_of_the_users_is_named_where_ours_is_needed(tmp_path: Path) -> None:
    file = tmp_path / "deploy" / "__init__.py"
    file.parent.mkdir()
    file.touch()
    assert python(tmp_path, "-c", READS_A_LOG).stdout == "imported\n"
    done = python(tmp_path, "-c", OPENS_A_CELL)
    assert done.stderr.endswith(f"Python finds {file} in the place of rtstack's package 'deploy': {ADVICE}\n")
    done = python(tmp_path, "-m", "rtstack", "--version")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert str(file) in done.stderr


def test_a_link_to_our_package_is_ours(tmp_path: Path) -> None:
    (tmp_path / "deploy").symlink_to(Path(__file__).parents[1] / "deploy")
    done = python(tmp_path, "-c", OPENS_A_CELL)
    assert (done.returncode, done.stderr) == (0, "")
