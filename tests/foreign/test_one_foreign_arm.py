"""The commands of a cell of one arm on another author's robot, in its own time: check, excite, play, by hand."""

import contextlib
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hal.fci import FciArm
from rtstack.cells import open_cell
from rtstack.log.reader import read_log
from rtstack.loop.mailbox import TARGET, Mailbox, remove_mailbox
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import load_cell_description
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.start_motion import start_motion
from rtstack.trials.teleoperation import run_teleoperation
from tests.support.foreign_robot import END_S, addresses, foreign_command, wait_for
from tests.support.one_arm import one_arm_file
from tests.support.start import go

pytestmark = [pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(900)]
NAME, SIDE = "franka-sim", "left"
ATTEMPTS = 6  # of what this machine, which serves both ends, may break off
BY_HAND_M = (0.03, 0.0, 0.08)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """One arm of franka-sim's, at the pace of its own clock."""
    folder, (address, _) = tmp_path_factory.mktemp(NAME), addresses()
    with open(folder / "said.txt", "wb") as output:
        process = subprocess.Popen(
            foreign_command(NAME, address, folder, 1.0), stdout=output, stderr=output, cwd=folder
        )
        try:
            wait_for(address, process, folder / "said.txt")
            yield address
        finally:
            process.kill()
            process.wait(END_S)


@pytest.fixture(scope="module")
def cell_file(address: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cell as its lab would describe it: no tracker; this robot estimates no forces, and begins further away."""
    path = one_arm_file(tmp_path_factory.mktemp("cell"), SIDE)
    wide = [100.0] * 4 + [60.0] * 3
    forces = f"tau_ext_approach_max = {wide}\ntau_ext_contact_max = {wide}\nforce_approach_max = 250.0\n"
    text = path.read_text().replace("power_max = 100.0\n", f"power_max = 100.0\n{forces}force_contact_max = 250.0\n")
    for slow, quick in (("longest_rad = 1.5", "longest_rad = 2.0"), ("speed_rad_s = 0.4", "speed_rad_s = 0.8")):
        text = text.replace(slow, quick)
    path.write_text(text.replace("127.0.0.1:1341", f"{address}:1341"))
    return path


def kept_time(address, run):
    """Run a command until this machine has kept time. Returns its result."""
    for _ in range(ATTEMPTS):
        done = run()
        if done["success"]:
            return done
        print("again:", done["failure_reason"])
        with contextlib.closing(FciArm(address)) as arm:
            arm.recover()
    raise AssertionError(f"not once in {ATTEMPTS} times: {done['failure_reason']}")


def test_check_excite_play_and_a_trial_of_two_arms(address, cell_file, command_line, tmp_path):
    checked = command_line("check", f"--{SIDE}", address, "--cell-file", cell_file, "--json")
    assert "right" not in checked.stdout, checked.stdout
    options = ("--cell", f"fci:{address}", "--cell-file", cell_file, "--json")

    def excite():
        done = command_line("excite", tmp_path / "excite.mcap", *options[:4])
        if done.returncode:
            (tmp_path / "excite.mcap").unlink(missing_ok=True)
        return {"success": done.returncode == 0, "failure_reason": done.stdout + done.stderr}

    def play():
        return json.loads(command_line("play", tmp_path / "excite.mcap", *options, "--log", tmp_path / "p.mcap").stdout)

    kept_time(address, excite)
    assert read_log(tmp_path / "excite.mcap").sides == (SIDE,)
    played = kept_time(address, play)
    assert played["played_s"] == pytest.approx(played["duration_s"])
    assert played["largest_error_mm"] < 25.0
    refused = command_line("teach", tmp_path / "grab.mcap", *options)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "two arms" in refused.stderr


class Hand:
    """What a console writes, by the loop's turns: a watchdog that never trips."""

    def __init__(self, mailbox, description):
        (mounting,) = description.arms
        self._mailbox, self._turn = mailbox, -1
        self._target = np.zeros(1, TARGET)
        self._target["job"], self._target["speed"], self._target["stiffness"] = 3, 0.2, 300.0
        position, rotation = end_effector_pose(ArmModel(mounting, description.pad), np.array(mounting.home))
        pose = self._target["pose"][0]
        pose[..., :3] = position + BY_HAND_M
        quaternion = np.zeros(4)
        quaternion_from_rotation(np.ascontiguousarray(rotation), quaternion)
        pose[..., 3:] = quaternion

    def clock(self):
        return 1_000_000_000 + self._turn * 1_000_000

    def trip(self):
        self._turn += 1
        if self._turn % 50 == 0:
            self._target["clutch_ns"] = self.clock()
            self._mailbox.write_target(self._target)
        if self._turn == 2500:
            self._target["finish"] = 1
            self._mailbox.write_target(self._target)


def test_the_arm_is_led_by_hand(address, cell_file, tmp_path):
    description = load_cell_description(cell_file)
    kind, logs = f"fci:{address}", iter(tmp_path / f"{k}.mcap" for k in range(ATTEMPTS))

    def run():
        mailbox = Mailbox.create("rtstack-test-one-foreign")
        cell = open_cell(kind, "", 0.0, 0, description)
        try:
            way = start_motion(cell, description, "")
            if way is not None:
                assert go(cell, description, way.path.goal, limit=way.limits) is None
            hand, asked = Hand(mailbox, description), TeleoperationSpecification("anna", job=3)
            context = RunContext(open_log(next(logs), asked, description, kind, cell_file), watchdogs=(hand,))
            return run_teleoperation(asked, description, cell, mailbox, context, clock=hand.clock).as_dict()
        finally:
            cell.close()
            mailbox.close()
            remove_mailbox("rtstack-test-one-foreign")

    log = read_log(kept_time(address, run)["log"])
    (mounting,) = description.arms
    model, q = ArmModel(mounting, description.pad), log.topic(f"/{SIDE}/arm")["q"]
    moved = end_effector_pose(model, q[-1])[0] - end_effector_pose(model, np.array(mounting.home))[0]
    np.testing.assert_allclose(moved, BY_HAND_M, atol=0.025)
