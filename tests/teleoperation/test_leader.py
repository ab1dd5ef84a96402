"""The leader arms of examples/plugin: what is said to their port, and what comes of it."""

import json
import socket
from contextlib import closing

import numpy as np
import pytest

from hal.base.arrays import Array
from rtstack.cells import load_description
from rtstack.model.arm_model import flange_pose
from rtstack.model.cell_description import base_poses
from tests.support.example_module import example

plugin = example("leader")
CELL, _ = load_description(None)
HOME = np.array([CELL.left.home, CELL.right.home])


class Said:
    """A program that reads leader arms."""

    def __init__(self, port: int) -> None:
        self._to, self._out = ("127.0.0.1", port), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.close = self._out.close

    def say(self, sequence: int, q: Array = HOME, held: object = True, **more: object) -> None:
        left, right = q.tolist()
        self.line(json.dumps({"sequence": sequence, "held": held, "left": left, "right": right} | more))

    def line(self, text: str) -> None:
        self._out.sendto(text.encode(), self._to)


@pytest.fixture
def leader():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with closing(plugin.Leader(str(port))) as device, closing(Said(port)) as program:
        yield device, program


def test_its_hands_are_where_its_joints_put_them_in_the_followers_world(leader):
    device, program = leader
    program.say(1)
    said = device.read()
    assert said.held
    assert said.message()["hands"] == {"left": list(said.left), "right": list(said.right)}
    for side, base, mounting, pose in zip(
        range(2), base_poses(CELL), (CELL.left, CELL.right), (said.left, said.right), strict=True
    ):
        T = base @ flange_pose(mounting.robot, HOME[side])
        np.testing.assert_allclose(pose[:3], T[:3, 3])
        assert np.linalg.norm(pose[3:]) == pytest.approx(1.0)


def test_a_leader_that_is_silent_lets_go(leader, monkeypatch):
    device, program = leader
    assert not device.read().held
    program.say(1)
    assert device.read().held
    monkeypatch.setattr(plugin, "SILENT_S", 0.0)
    assert device.read().message() == {"clutch": False}


@pytest.mark.parametrize(
    "line", ["", "nothing", "[]", "3", "null", '{"sequence": 2}', "\x00", json.dumps({"sequence": "x"})]
)
def test_what_is_no_word_of_a_leader_changes_nothing(leader, line):
    device, program = leader
    program.say(1)
    before = device.read()
    program.line(line)
    program.say(2, HOME[:, :6])
    program.say(2, HOME * np.nan)
    program.say(1, HOME + 0.1)
    assert device.read() == before


def test_its_switch_lets_go_and_it_can_finish(leader):
    device, program = leader
    program.say(1, held=False, finished=True)
    said = device.read()
    assert (said.held, said.finished) == (False, True)
