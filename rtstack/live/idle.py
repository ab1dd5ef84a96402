"""Between jobs: both arms are read at the robot's pace and shown, and no torque is ever written."""

import time
from collections.abc import Callable

import numpy as np

from hal.cell import Cell
from hal.limits import CONTROL_PERIOD_S
from hal.state import ARM_STATE
from rtstack.log.ring import Rings
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, EVENT, SIDES, TIMING_SAMPLE, Level, Mode

_PERIOD_NS = round(CONTROL_PERIOD_S * 1e9)
_TRACKER_EVERY = 10  # ticks: the tracker's contract is 100 Hz


class IdleView:
    """Publishes an idle cell to the live rings, in the same records as a trial does."""

    def __init__(self, rings: Rings) -> None:
        self._arm_pushers = [rings.pusher(f"/{side}/arm") for side in SIDES]
        self._control_pushers = [rings.pusher(f"/{side}/control") for side in SIDES]
        self._timing_pusher = rings.pusher("/timing")
        self._object_pusher = rings.pusher("/object/pose")
        self._event_pusher = rings.pusher("/events")
        self._event = np.zeros(1, EVENT)
        self._sample = np.zeros(1, ARM_SAMPLE)  # nothing desired, nothing applied
        self._control = np.zeros(1, CONTROL_SAMPLE)
        self._control["mode"] = Mode.IDLE
        self._timing = np.zeros(1, TIMING_SAMPLE)

    def watch(self, cell: Cell, interrupted: Callable[[], bool]) -> None:
        """Read and show both arms until `interrupted`. Raises hal.errors.HardwareError when an arm is lost."""
        arms = (cell.left, cell.right)
        last_ns = time.perf_counter_ns()
        last_t_ns = 0
        self._timing["missed_deadlines"] = 0
        ticks = 0
        while not interrupted():
            for side, arm in enumerate(arms):
                state = arm.read()
                for name in ARM_STATE.names or ():
                    self._sample[name] = state.record[name]
                self._arm_pushers[side].push(self._sample)
                self._control["t_ns"] = state.t_ns
                self._control_pushers[side].push(self._control)
            now_ns = time.perf_counter_ns()
            t_ns = int(self._sample["t_ns"][0])
            if last_t_ns and t_ns - last_t_ns > 1.5 * _PERIOD_NS:
                self._timing["missed_deadlines"] += round((t_ns - last_t_ns) / _PERIOD_NS) - 1
            self._timing["t_ns"] = t_ns
            self._timing["period_us"] = (now_ns - last_ns) * 1e-3
            self._timing_pusher.push(self._timing)
            if ticks % _TRACKER_EVERY == 0:
                self._object_pusher.push(cell.tracker.latest().record)
            last_ns, last_t_ns, ticks = now_ns, t_ns, ticks + 1

    def tell(self, level: Level, text: str) -> None:
        """Publish an event of the robot process, at the time of the last state that was shown."""
        self._event["t_ns"] = self._sample["t_ns"]
        self._event["level"] = level
        self._event["name"] = b"robot"
        self._event["text"] = text.encode("ascii", "replace")
        self._event_pusher.push(self._event)
