"""A hand's tracker that loses it, in front of arms that follow: in simulated time, so that every figure is exact."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from console.teleoperation.teleop_input import TeleopInput
from rtstack.cells import default_cell_file, open_cell
from rtstack.live.client import RobotRefused
from rtstack.live.protocol import JobKind, JobState
from rtstack.log.reader import read_log
from rtstack.loop.mailbox import Mailbox
from rtstack.samples import SIDES
from rtstack.teleoperation.stamp import Stamp
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification
from rtstack.trials.teleoperation import run_teleoperation
from tests.support.hand import JOB, START, Hand

BEAT_MS = 20
REST_MS, JUMPED_MS, BACK_MS, OPEN_MS = 200, 320, 440, 500  # of one grip: it jumps, is there, is back, is opened
JUMPS = [
    *[((0.0, 0.0, 1e-3 * mm), 0.0, 1) for mm in (60, 80, 150, 250, 400)],
    *[((0.0, 0.0, 0.0), degrees, 1) for degrees in (40, 90, 180)],
    ((0.1, -0.1, 0.0), 0.0, 3), ((0.0, 0.0, 0.15), 0.0, 5), ((np.nan, 0.0, 0.0), 0.0, 1),
]  # fmt: skip


class Person:
    """A person at the console's door, whose left hand is tracked: `at(ms)` acts each tick. kind: "hands" or "pose"."""

    def __init__(self, mailbox, kind, rest):
        job = SimpleNamespace(kind=JobKind.TELEOPERATION, state=JobState.RUNNING, number=JOB)
        status = SimpleNamespace(job=job, holder="anna", simulated=True)
        rings = SimpleNamespace(reader=lambda _: SimpleNamespace(drain=list))
        self.watch = SimpleNamespace(
            sides=SIDES, view=SimpleNamespace(status=status), rings=rings, command=lambda: rest
        )
        self.teleop = TeleopInput(mailbox, self.watch, lambda: self.now_ns)  # pyright: ignore[reportArgumentType]
        self.kind, self.rest, self.now_ns, self.refused = kind, rest[0], 0, {}

    def act(self, ms, now_ns):
        self.now_ns = now_ns
        which, within = divmod(ms, OPEN_MS)
        if ms % BEAT_MS or which >= len(JUMPS):
            return
        if within == 0:
            self.teleop.release("anna")
            return
        way, degrees, samples = JUMPS[which]
        share = np.clip((within - REST_MS) / (samples * BEAT_MS), 0.0, 1.0) if within < BACK_MS else 0.0
        pose = self.rest.copy()
        if share:
            turn = Rotation.from_rotvec([0.0, np.radians(degrees) * share, 0.0])
            pose[:3] += share * np.array(way)
            pose[3:] = (turn * Rotation.from_quat(pose[3:], scalar_first=True)).as_quat(scalar_first=True)
        self.teleop._motion.advance(Stamp("a", ms, float(ms), 1, float(ms)), now_ns)
        try:
            self.teleop.press("anna", now_ns)
            (self.teleop.track if self.kind == "hands" else self.teleop.move)("anna", [pose, None])
        except RobotRefused as refused:
            self.refused.setdefault(which, (within, str(refused)))


@pytest.mark.parametrize("kind", ["hands", "pose"])
def test_a_hand_that_its_tracker_moves_moves_no_arm(cell, tmp_path, kind):
    mailbox = Mailbox.create(f"rtstack-test-jumps-{os.getpid()}")

    def script(ms, hand):
        if ms == len(JUMPS) * OPEN_MS:
            hand._target["finish"] = 1
            mailbox.write_target(hand._target)
        else:
            person.act(ms, hand.clock())

    hand = Hand(mailbox, script, cell)
    person = Person(mailbox, kind, np.column_stack([START, hand.orientations]))
    specification = TeleoperationSpecification("anna", job=JOB, recorded=True, stop_on_release=False)
    opened = open_cell("direct", "rice_box", 0.0, 0)
    log = open_log(tmp_path / "jumps.mcap", specification, cell, "direct", default_cell_file(), overwrite=True)
    try:
        result = run_teleoperation(
            specification, cell, opened, mailbox, RunContext(log, watchdogs=(hand,)), clock=hand.clock
        )
    finally:
        opened.close()
        mailbox.close()
    assert result.success, result.failure_reason
    assert sorted(person.refused) == list(range(len(JUMPS)))
    for which, (within, text) in person.refused.items():
        assert within == REST_MS + BEAT_MS, (which, text)  # the first sample of the jump
        assert "let go" in text
    log = read_log(tmp_path / "jumps.mcap")
    pose = log.topic("/left/control")["pose_ref"]
    assert np.linalg.norm(pose[:, :3] - pose[0, :3], axis=1).max() < 1e-5  # home is not START to the last digit
    assert 2.0 * np.arccos(np.clip(np.abs(pose[:, 3:] @ pose[0, 3:]), 0.0, 1.0)).max() < 1e-3
    said = [event.text for event in log.events if event.text.startswith("the grip was let go, and the arms hold")]
    assert len(said) == len(JUMPS)
