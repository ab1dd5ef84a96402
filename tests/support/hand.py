"""An operator's hand by the tick, in the place of a console's page."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rtstack.loop.mailbox import TARGET, Mailbox, Release
from rtstack.model.cell_description import CellDescription
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.assembly import arm_controllers, default_parameters

JOB = 5
START = np.array([[0.0, 0.35, 0.26], [0.0, -0.35, 0.26]])
BEAT_MS = 50


class Hand:
    """What a console writes, by the tick: a watchdog that never trips. `script(ms, hand)` acts each tick."""

    def __init__(self, mailbox: Mailbox, script: Callable[[int, "Hand"], None], cell: CellDescription) -> None:
        self._mailbox = mailbox
        self._script = script
        self._target = np.zeros(1, TARGET)
        self._target["job"] = JOB
        self._target["speed"], self._target["stiffness"] = 0.3, 300.0
        self.orientations = np.zeros((2, 4))
        self.ms = -1
        arms = arm_controllers(cell, default_parameters())
        for k, mounting in enumerate(cell.arms):
            _, rotation = end_effector_pose(arms[k].model, np.array(mounting.home))
            quaternion_from_rotation(np.ascontiguousarray(rotation), self.orientations[k])

    def clock(self) -> int:
        return 1_000_000_000 + self.ms * 1_000_000

    def trip(self) -> None:
        self.ms += 1
        self._script(self.ms, self)

    def hold(self, offsets: Any = ((0, 0, 0), (0, 0, 0)), **fields: Any) -> None:
        """Hold the clutch, with requests this far from the start; a sign of life a beat, as a page gives it."""
        if self.ms % BEAT_MS == 0:
            self._target["pose"][0, :, :3] = START + offsets
            self._target["pose"][0, :, 3:] = self.orientations
            self._target["clutch_ns"] = self.clock()
            for name, value in fields.items():
                self._target[name] = value
            self._mailbox.write_target(self._target)

    def release(self, why: Release = Release.RELEASED) -> None:
        self._target["clutch_ns"], self._target["release"] = 0, why
        self._mailbox.write_target(self._target)

    def finish(self) -> None:
        self._target["finish"] = 1
        self._mailbox.write_target(self._target)
