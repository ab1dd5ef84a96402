"""The runbook's commands about arms and boxes, page by page in their order, against simulated arms and their Desk."""

import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from rtstack.calibration.points import Point, nominal_geometry, save_points
from rtstack.cells import load_description
from rtstack.model.arm_model import ArmModel
from rtstack.references.demonstration import end_effector_pose
from sim_robot.desk.server import PASSWORD, USER
from tests.support.desk import desk_address, desk_cell_file
from tests.support.fci.server import Served, serve
from tests.support.wrong_cell import touched_points

RUNBOOK = Path(__file__).resolve().parents[2] / "docs/runbook"
COMMAND = Path(sys.executable).with_name("rtstack")
# what is executed here; `up` and what moves arms by itself have tests of their own (tests/console, tests/cli)
EXECUTED = re.compile(
    r"(?:^|/|sudo )rtstack ((?:desk [a-z]+|check|guide|wiggle [a-z]+|calibrate [a-z.]+)(?: --[^`]*)?)$"
)
MORE = {"guide": ("--seconds=0.3",), "calibrate": ("--seconds=0.3",)}
# what a page takes for granted: it begins with arms that are unlocked
BEGINS_READY = ("calibration.md", "recovery.md", "upgrade.md")
# whose commands stand on the other pages too
LONG = ("calibration.md", "daily.md", "first_power_on.md", "upgrade.md")


def commands(page: Path) -> list[str]:
    """Return the commands of a page that are executed here, in their order."""
    text = page.read_text()
    found = re.findall(r"`([^`]+)`|^ {4,}(rtstack .*)$", text, re.MULTILINE)
    lines = (re.sub(r"\s+", " ", one or other).strip() for one, other in found)
    return [match[1] for line in lines if (match := EXECUTED.search(line))]


@pytest.fixture
def boxes():
    with serve("--lockstep", "--object=none", "--desk") as served:
        yield served


@pytest.fixture
def cell_file(boxes: Served, tmp_path: Path) -> Path:
    return desk_cell_file(tmp_path / "cell.toml", map(desk_address, (boxes.left, boxes.right)))


def _write_points(path: Path, cell_file: Path) -> None:
    """Write points that were measured, and one for which the arms already stand where they are to be led."""
    cell, _ = load_description(cell_file)
    points = touched_points(cell, nominal_geometry(cell), 3e-4)
    place, _ = end_effector_pose(ArmModel(cell.left, cell.pad), np.array(cell.left.home))
    save_points(path, points | {"home": Point("touch", "left", tuple(place.tolist()))})


def test_the_pages_have_commands_that_are_executed_here():
    assert {page.name for page in RUNBOOK.glob("*.md") if commands(page)} >= {
        "first_power_on.md",
        "daily.md",
        "calibration.md",
        "recovery.md",
    }


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.long] if page.name in LONG else [], id=page.name)
        for page in sorted(RUNBOOK.glob("*.md"))
        if commands(page)
    ],
)
def test_the_steps_of_a_page_can_be_done(page: Path, boxes: Served, cell_file: Path, tmp_path: Path):
    import_module("pylibfranka")  # not every Python has it
    environment = {
        **os.environ, "XDG_CONFIG_HOME": str(tmp_path), "RTSTACK_DESK_USER": USER, "RTSTACK_DESK_PASSWORD": PASSWORD,
    }  # fmt: skip

    def run(words: list[str]) -> None:
        done = subprocess.run(
            [str(COMMAND), *words], env=environment, capture_output=True, text=True, cwd=tmp_path, timeout=120,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        # `check` also judges the host on which the tests run
        assert done.returncode == 0 or words[0] == "check", (words, done.stdout, done.stderr)
        assert done.returncode != 2, (words, done.stderr)
        if words[0] == "check" and "--left" in words:
            assert "FCI" not in done.stdout, done.stdout

    _write_points(tmp_path / "points.toml", cell_file)
    own = f"--cell-file={cell_file}"
    if page.name in BEGINS_READY:
        run(["desk", "start", own])
    for command in commands(page):
        command = command.replace("172.16.0.2", boxes.left).replace("172.16.1.2", boxes.right)
        words = command.replace("/etc/rtstack/cell.toml", str(cell_file)).split()
        if words[0] == "desk" and "--cell-file" not in words:
            words.append(own)
        run([*words, *MORE.get(words[0], ())])
        if words[:2] in (["desk", "stop"], ["desk", "shutdown"]):
            break  # what follows on the page is another case, or another day
