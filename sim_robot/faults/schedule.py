"""When each fault is active: counted in the robot's milliseconds, so that a script means the same in every run."""

from typing import TypeVar

from sim_robot.faults.kinds import Effect, Origin, ScriptedFault

Kind = TypeVar("Kind", bound=Effect)


class Schedule:
    """Follows a script. `active`: the faults of this ms; `begun`: those of them that began with it."""

    def __init__(self, faults: tuple[ScriptedFault, ...]) -> None:
        self.active = [fault for fault in faults if fault.origin is Origin.START]
        self.begun: list[ScriptedFault] = []
        self._now_ms = -1  # since the first motion; -1 before it
        self._contact_ms: int | None = None
        self._waiting = [fault for fault in faults if fault.origin is not Origin.START]
        self._left_ms = [fault.duration_ms for fault in self.active]  # of each active fault

    @property
    def awaits_contact(self) -> bool:
        """True while a fault waits for the first contact, and that has not come."""
        return self._contact_ms is None and any(fault.origin is Origin.FIRST_CONTACT for fault in self._waiting)

    def begin_millisecond(self, moving: bool, contact: bool) -> bool:
        """Go on by 1 ms; moving: an arm is in motion in it; contact: a pad touches the object. True when it changed."""
        self.begun.clear()
        if self._now_ms < 0 and not moving:
            return False
        self._now_ms += 1
        if contact and self._contact_ms is None:
            self._contact_ms = self._now_ms
        changed = self._expire()
        for fault in [fault for fault in self._waiting if self._is_due(fault)]:
            self._waiting.remove(fault)
            self.active.append(fault)
            self.begun.append(fault)
            self._left_ms.append(fault.duration_ms)
            changed = True
        return changed

    def pass_still_millisecond(self) -> bool:
        """Let 1 ms of what is active pass while the plant stands still; nothing begins. True when something ended."""
        self.begun.clear()
        return self._expire()

    def effects(self, kind: type[Kind], side: int) -> list[Kind]:
        return [fault.effect for fault in self.active if isinstance(fault.effect, kind) and side in fault.sides]

    def _is_due(self, fault: ScriptedFault) -> bool:
        origin_ms = 0 if fault.origin is Origin.MOTION else self._contact_ms
        return origin_ms is not None and self._now_ms >= origin_ms + fault.delay_ms

    def _expire(self) -> bool:
        before = len(self.active)
        left = [None if ms is None else ms - 1 for ms in self._left_ms]
        self.active = [fault for fault, ms in zip(self.active, left, strict=True) if ms != 0]
        self._left_ms = [ms for ms in left if ms != 0]
        return len(self.active) < before
