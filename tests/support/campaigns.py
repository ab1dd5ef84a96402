"""Fixtures: a small campaign, run by the command line in a process of its own."""

import csv
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from rtstack.experiments.registry import plan_file
from tests.support.made_once import made_once

RTSTACK = str(Path(sys.executable).parent / "rtstack")
PATIENCE_S = 280.0  # for a step that takes seconds, on a machine that is busy


def two_controllers(path: Path, displacement_mm: float) -> Path:
    """Write the plan of two trials of Figure 11, one of each of two controllers, so that there is a figure to draw."""
    text = plan_file("reference-spreading").path.read_text()
    head = text[: text.index("[[experiments]]")]
    before, _, after = head.partition("controllers = [")
    head = f'{before}controllers = ["no_interim", "proposed"]{after[after.index("]") + 1 :]}'
    place = f"displacements_mm = [{displacement_mm}]"
    path.write_text(
        f'{head}[[experiments]]\nname = "figure11"\nreferences = ["rice_box/0"]\n{place}\nrepetitions = 1\n'
    )
    return path


@dataclass(frozen=True, slots=True)
class Command:
    """The campaign's command line. `run` waits for its end."""

    plan: Path

    def arguments(self, out: Path, *more: str) -> list[str]:
        """Return the command with its arguments."""
        return [RTSTACK, "campaign", str(self.plan), "--out", str(out), *more]

    def run(self, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
        """Run it to its end."""
        return subprocess.run(self.arguments(out, *more), capture_output=True, text=True, timeout=PATIENCE_S)

    def start(self, out: Path, *more: str) -> subprocess.Popen[str]:
        """Start it as a terminal does: in a process group of its own."""
        return subprocess.Popen(
            self.arguments(out, *more),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )


@pytest.fixture(scope="session")
def command(tmp_path_factory: pytest.TempPathFactory) -> Command:
    """Five trials: the rice box at -30 mm, each controller."""
    text = plan_file("reference-spreading").path.read_text()
    table2 = text.index("[[experiments]]")
    path = tmp_path_factory.mktemp("plan") / "small.toml"
    experiment = 'name = "table2"\nreferences = ["rice_box/0"]\ndisplacements_mm = [-30.0]\nrepetitions = 1\n'
    path.write_text(f"{text[:table2]}[[experiments]]\n{experiment}")
    return Command(path)


@dataclass(frozen=True, slots=True)
class Finished:
    """A campaign that was run with one worker, and not disturbed."""

    out: Path
    process: subprocess.CompletedProcess[str]


@pytest.fixture(scope="session")
def finished(command: Command, demonstration: object, tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """The small campaign's folder. After a demonstration: everything is compiled."""

    def run(folder: Path) -> Finished:
        return Finished(folder / "out", command.run(folder / "out", "--workers", "1"))

    return made_once(tmp_path_factory, "campaign", run)


@pytest.fixture
def results() -> Callable[[Path], list[dict[str, str]]]:
    """Read results.csv; the commit is left out, since the tree may change between two runs."""

    def read(out: Path) -> list[dict[str, str]]:
        with (out / "results.csv").open() as file:
            return [{k: v for k, v in row.items() if k != "git_commit"} for row in csv.DictReader(file)]

    return read
