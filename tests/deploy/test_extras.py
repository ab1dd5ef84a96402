"""Each part of the stack runs without the packages of the others, and says what to install where it cannot."""

import os
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from hal.base.extras import advice

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
EXTRAS = {
    name: [line.split("=")[0].replace("-", "_") for line in PROJECT["optional-dependencies"][name]]
    for name in ("sim", "console", "campaign", "teleop")
}
WITHOUT = """
import sys
sys.modules.update(dict.fromkeys({lacking!r}))  # what is None there cannot be imported
sys.argv = ["rtstack", *{arguments!r}]
from rtstack.cli import main
main()
"""


def run_without(lacking: list[str], folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line as if these packages were not installed."""
    program = WITHOUT.format(lacking=lacking, arguments=list(arguments))
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=os.environ, capture_output=True, text=True, timeout=120.0
    )


@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("sim", ["sim"]),
        ("sim", ["teach", "ref.mcap"]),
        ("sim", ["up", "--port", "0"]),
        ("console", ["up", "--port", "0"]),
        ("campaign", ["campaign", "aim-aware-planar", "--out", "out"]),
    ],
)
def test_what_is_lacking_is_one_line_and_nothing_is_written(extra: str, arguments: list[str], tmp_path: Path) -> None:
    ended = run_without(EXTRAS[extra], tmp_path, *arguments)
    assert ended.returncode == 2, ended.stderr
    (line,) = ended.stderr.splitlines()
    assert line.startswith("rtstack: ")
    assert line.endswith(f" is not installed: pip install 'rtstack[{extra}]'")
    assert list(tmp_path.iterdir()) == []


def test_a_headless_runner_needs_none_of_them(tmp_path: Path) -> None:
    import_module("pylibfranka")
    lacking = [module for modules in EXTRAS.values() for module in modules]
    ended = run_without(lacking, tmp_path, "bench", "link", "--cell", "fci:127.0.0.1,127.0.0.2")
    assert ended.returncode == 2
    assert "127.0.0.1" in ended.stderr
    assert "installed" not in ended.stderr


@pytest.mark.long
def test_a_page_needs_no_simulator_and_a_simulator_no_page(tmp_path: Path) -> None:
    ended = run_without(
        EXTRAS["sim"],
        tmp_path,
        "console",
        "--run",
        str(tmp_path / "none"),
        "--left",
        "127.0.0.1",
        "--right",
        "127.0.0.2",
    )
    assert ended.returncode == 2
    assert "installed" not in ended.stderr.replace("pylibfranka is not installed", "")  # which a newer Python has not
    ended = run_without([*EXTRAS["console"], *EXTRAS["campaign"]], tmp_path, "demo", "--out", "demo")
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize("cell", ["fci:127.0.0.1,127.0.0.2", "lockstep"])
def test_a_python_without_the_vendors_client_is_told_of_one_that_has_it(cell: str, tmp_path: Path) -> None:
    ended = run_without(["pylibfranka"], tmp_path, "up", "--port", "0", "--cell-kind", cell)
    assert ended.returncode == 2, ended.stderr
    (line,) = ended.stderr.splitlines()
    assert "pylibfranka is not installed: that needs a Python for which it is published" in line
    assert "3.13" in line
    assert list(tmp_path.iterdir()) == []


def test_a_plant_in_the_process_does_without_the_vendors_client(tmp_path: Path) -> None:
    ended = run_without(["pylibfranka"], tmp_path, "teach", "ref.mcap")
    assert ended.returncode == 0, ended.stderr


@pytest.mark.long
def test_only_the_wire_needs_the_vendors_client(tmp_path: Path) -> None:
    program = """
import sys
sys.modules["pylibfranka"] = None
import importlib, pkgutil, console, hal, rtstack, sim_robot
for package in (console, hal, rtstack, sim_robot):
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + ".", onerror=lambda name: None):
        try:
            found.name.endswith("__main__") or importlib.import_module(found.name)
        except ModuleNotFoundError as error:
            assert error.name == "pylibfranka", error
            print(found.name)
"""
    said = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120.0
    )
    assert said.stdout.split() == ["hal.fci", "rtstack.cells.fci"]


def test_a_system_without_libgomp_is_told_the_package(tmp_path: Path) -> None:
    program = """
import sys
class Linker:
    def find_spec(self, name, path=None, target=None):
        if name == "proxsuite":
            raise ImportError("libgomp.so.1: cannot open shared object file: No such file or directory")
sys.meta_path.insert(0, Linker())
sys.argv = ["rtstack", "teach", "ref.mcap"]
from rtstack.cli import main
main()
"""
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120.0)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.endswith("apt-get install libgomp1\n")


def test_a_module_of_no_extra_has_no_advice() -> None:
    assert advice("os") is None
    assert advice(None) is None
