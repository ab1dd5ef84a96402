"""Between jobs: the arms are read at the robot's pace and shown, and no torque is ever written."""

import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from hal.arm import Arm
from hal.cell import LEFT, RIGHT, Cell
from hal.errors import CommandRejected
from hal.limits import CONTROL_PERIOD_S
from hal.robot_errors import ROBOT_ERRORS, error_bit
from hal.state import ARM_STATE, NEEDS_PERSON, RobotMode
from rtstack.log.ring import Rings
from rtstack.loop.publisher import Publisher
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, Level, Mode
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC
from rtstack.trials.run_context import RunEvent

_PERIOD_NS = round(CONTROL_PERIOD_S * 1e9)


class _ArmView:
    """Shows one arm. In a reflex an arm answers with its errors only: they are shown on its last state."""

    def __init__(self, rings: Rings, topic: str, side: str) -> None:
        self._side = side
        self._reader = rings.reader(topic)
        self._sample = np.zeros(1, ARM_SAMPLE)
        self._control = np.zeros(1, CONTROL_SAMPLE)
        self._control["mode"] = Mode.IDLE
        self.samples = self._sample, self._control  # to be published

    def begin(self) -> None:
        """Go on from what was shown last, by whomever: nothing is desired or applied any more."""
        last = self._reader.latest()
        if last is not None:
            self._sample[:] = last
        self._sample["tau_desired"] = self._sample["tau_applied"] = 0.0

    def show(self, arm: Arm) -> str | None:
        """Read the arm and take its state. Returns why it refuses to move, None when it does not."""
        refusal = None
        try:
            state = arm.read()
            person = NEEDS_PERSON.get(state.robot_mode)
            refusal = None if person is None else f"the {self._side} arm cannot move, {person}, then recover"
            for name in ARM_STATE.names or ():
                self._sample[name] = state.record[name]
        except CommandRejected as error:
            refusal = str(error)
            self._sample["t_ns"] += _PERIOD_NS
            self._sample["dq"] = 0.0
            self._sample["robot_mode"] = RobotMode.REFLEX
            self._sample["current_errors"] = sum(error_bit(name) for name in error.errors if name in ROBOT_ERRORS)
        self._control["t_ns"] = self._sample["t_ns"]
        return refusal

    @property
    def t_ns(self) -> int:
        """Robot's time of what this view showed last, ns."""
        return int(self._sample["t_ns"][0])

    def last_shown_t_ns(self) -> int:
        """Return the robot's time of the last shown state, ns; 0 before the first state."""
        last = self._reader.latest()
        return 0 if last is None else int(last["t_ns"][0])


class IdleView:
    """Publishes an idle cell to the live rings, in the same records as a trial does."""

    def __init__(self, rings: Rings, sides: Sequence[str] = SIDES) -> None:
        """sides: of the cell's arms."""
        self._rings = rings
        self._arms = tuple(_ArmView(rings, ARM_TOPICS[SIDES.index(side)], side) for side in sides)
        self._samples = tuple(view.samples for view in self._arms)
        self._publisher = Publisher([rings], None, sides=sides)

    def watch(
        self,
        cell: Cell,
        interrupted: Callable[[], bool],
        refused: Callable[[str], None],
        run_events: Callable[[], Iterable[RunEvent]],
    ) -> None:
        """Read and show the arms until `interrupted`; pass each new refusal to `refused`. Raises HardwareError."""
        for view in self._arms:
            view.begin()
        self._publisher = publisher = Publisher([self._rings], None, cell.sensors, sides=cell.sides)
        timing = publisher.timing
        # also an object that was not seen yet: what was shown last may be another cell's
        self._rings.pusher(OBJECT_TOPIC).push(cell.tracker.latest().record)
        last_ns, last_t_ns = time.perf_counter_ns(), 0
        told: list[str | None] = [None] * len(self._arms)
        refusals = told.copy()
        while not interrupted():
            if not self._show(cell, refusals) & LEFT:
                continue  # the first arm's states are the beat
            if refusals != told:
                for refusal in refusals:
                    if refusal is not None and refusal not in told:
                        self.tell(Level.ERROR, refusal)
                        refused(refusal)
                told = list(refusals)
            self.publish(run_events())
            if None not in refusals and not cell.own_clocks:
                time.sleep(CONTROL_PERIOD_S)  # no arm is the clock any more
            now_ns = time.perf_counter_ns()
            # two clocks may count from anywhere
            t_ns = self._arms[0].t_ns if cell.own_clocks else max(view.t_ns for view in self._arms)
            if last_t_ns and t_ns - last_t_ns > 1.5 * _PERIOD_NS:
                timing["missed_deadlines"] += round((t_ns - last_t_ns) / _PERIOD_NS) - 1
            timing["t_ns"] = t_ns
            timing["period_us"] = (now_ns - last_ns) * 1e-3
            publisher.look(cell.tracker)
            publisher.tick(self._samples)
            last_ns, last_t_ns = now_ns, t_ns

    def _show(self, cell: Cell, refusals: list[str | None]) -> int:
        """Show the arms whose states have arrived, note why they refuse to move, and return their mask."""
        mask = cell.link.wait() if cell.own_clocks and cell.link is not None else LEFT | RIGHT
        for k, arm in enumerate(cell.arms):
            if mask & 1 << k:
                refusals[k] = self._arms[k].show(arm)
        return mask

    def publish(self, run_events: Iterable[RunEvent]) -> None:
        """Publish what operators did, as events."""
        for run_event in run_events:
            self.tell(run_event.level, run_event.text, run_event.name)

    def tell(self, level: Level, text: str, name: str = "robot") -> None:
        """Publish an event of the robot process, at the time of the last state that was shown, by whomever."""
        t_ns = max(view.last_shown_t_ns() for view in self._arms)
        self._publisher.event(t_ns, level, name, text)
