"""The cell of a running robot process as it shows itself in the live rings: to look at, never to move."""

import time
from collections.abc import Sequence
from pathlib import Path

from hal.cell import Cell
from hal.state import ARM_STATE, ArmState
from hal.tracker import ObjectPose
from rtstack.live.standalone import find_rings
from rtstack.log.ring import RingReader, Rings
from rtstack.playback.logged_cell import LoggedArm
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC

_NEWER_S = 0.05  # for so long a state is waited for that was not read yet


class _ShownArm(LoggedArm):
    def __init__(self, reader: RingReader) -> None:
        self._reader, self._state = reader, ArmState.empty()

    def read(self) -> ArmState:
        """Return the newest state; where it was read before, the next one, if that comes soon."""
        end_s, record = time.monotonic() + _NEWER_S, self._state.record
        while (last := self._reader.latest()) is not None:
            if last["t_ns"][0] != record["t_ns"][0] or time.monotonic() > end_s:
                for name in ARM_STATE.names or ():
                    record[name] = last[name]
                break
            time.sleep(1e-3)
        return self._state


class _ShownTracker:
    def __init__(self, reader: RingReader) -> None:
        self._reader, self._pose = reader, ObjectPose.empty()

    def latest(self) -> ObjectPose:
        if (last := self._reader.latest()) is not None:
            self._pose.record[0] = last[0]
        return self._pose


def shown_cell(run: Path, name: str, sides: Sequence[str] = SIDES) -> tuple[Cell, Rings]:
    """Return the cell that the robot process of a folder shows, and the rings, to be closed. Raises LogError."""
    rings = Rings.attach(find_rings(run))
    arms = {side: _ShownArm(rings.reader(ARM_TOPICS[SIDES.index(side)])) for side in sides}
    return Cell(name, arms.get("left"), arms.get("right"), _ShownTracker(rings.reader(OBJECT_TOPIC))), rings
