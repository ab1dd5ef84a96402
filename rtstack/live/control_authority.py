"""The control authority: which operator has the lease, and whether the arms may move.

It adds a clock, a lock and an audit trail to the arming state machine (rtstack.safety.arming), which takes every
decision about motion in the robot process. Each action of an operator becomes a line of the audit trail and a RunEvent.
A STOP disarms; its request is reset by arming, and before a person's hand leads the arms.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rtstack.live.audit import AuditTrail
from rtstack.loop.mailbox import NOT_TAKEN, TAKEN_S, Mailbox
from rtstack.loop.watchdogs import since_boot_s
from rtstack.safety.arming import LEASE_S, ArmingStateMachine, Phase, Refused
from rtstack.samples import Level
from rtstack.trials.run_context import RunEvent

# the loop's own watchdog is the first to stop a motion without an operator, so that the log has the true reason
_LOOP_FIRST_S = 0.3
_STOP_LASTS_S = 1.0  # a guide that is ordered within it may have been ordered before the STOP was seen
_LOOK_S = 5e-3
_RUN_EVENTS = 256  # not yet published


@dataclass(frozen=True, slots=True)
class AuthorityView:
    """The state of the arming. `since_s`: Unix time of the last change of phase; `refusal`: why nothing may begin."""

    phase: Phase
    reason: str | None
    holder: str | None
    since_s: float
    refusal: str | None


class ControlAuthority:
    """Owns the arming state machine. All methods may be called from any thread; they raise Refused with one line.

    clock: time since the host's start, s. It counts suspended time too, so that a lease ends in it.
    """

    def __init__(self, mailbox: Mailbox, audit: AuditTrail, clock: Callable[[], float] = since_boot_s) -> None:
        self._lock, self._arming = threading.Lock(), ArmingStateMachine()
        self._mailbox, self._audit, self._clock = mailbox, audit, clock
        self._run_events: deque[RunEvent] = deque(maxlen=_RUN_EVENTS)
        self._since_s = time.time()
        self._stopped_s = -_STOP_LASTS_S  # by the clock: of the last STOP that was reported
        self._stop_due_s: float | None = None  # by the clock: when a motion has to have begun to stop

    # the lease

    def take(self, operator: str, over_from: str | None = None) -> None:
        """Give the lease to an operator; where `over_from` still has it, and nothing moves, from them."""
        with self._acting() as now_s:
            arming, before = self._arming, self._arming.holder
            takeover = over_from is not None and before == over_from != operator
            if takeover and arming.running:
                raise Refused(f"the arms are moving: take over from {before} once they are at rest")
            if takeover and before is not None:
                arming.release(before)
            arming.take(operator, now_s)
            self._alive()
            if takeover:
                self._note("takeover", operator, f"{operator} took over from {before}", Level.WARNING)
            elif before != operator:
                self._note("take", operator, f"{operator} took control")

    def release(self, operator: str) -> None:
        """Give the lease back; a motion that still runs stops."""
        with self._acting():
            if self._arming.holder != operator:
                raise Refused(f"{self._arming.holder or 'no operator'} has control, not {operator}")
            self._arming.release(operator)
            self._stop_at_once()
            self._note("release", operator, f"{operator} released control")

    def beat(self, operator: str) -> None:
        """Take a sign of life; only the holder's counts."""
        with self._acting() as now_s:
            self._arming.beat(operator, now_s)
            if operator == self._arming.holder:
                self._alive()

    def watch(self) -> None:
        """Check for a holder without signs of life and for a STOP in the mailbox. To be called regularly."""
        with self._acting() as now_s:
            if self._mailbox.stop_requested:
                self._arming.disarm()
            if not self._arming.stop_wanted:
                self._stop_due_s = None
            elif self._stop_due_s is None:
                self._stop_due_s = now_s + _LOOP_FIRST_S
            elif now_s > self._stop_due_s:
                self._mailbox.request_stop()

    # motion

    def arm(self, operator: str) -> None:
        """Allow motion."""
        with self._acting() as now_s:
            before = self._arming.phase
            if before is Phase.ARMED and self._mailbox.stop_requested:
                self._arming.disarm()
                raise Refused("STOP was pressed a moment ago; arm again if that is what you want")
            self._arming.arm(operator, now_s)
            self._mailbox.clear_stop()
            if before is not Phase.ARMED:
                self._note("arm", operator, f"{operator} armed the cell")

    def disarm(self, operator: str) -> None:
        """Allow no motion any more; a running motion stops. Needs no lease."""
        with self._acting():
            self._arming.disarm()
            self._stop_at_once()
            self._note("disarm", operator, f"{operator} disarmed the cell")

    def stop(self, operator: str) -> None:
        """Stop all motion, and disarm. Needs no lease. Raises Refused where the loop does not take it."""
        turn = self._mailbox.request_stop()  # before any lock
        with self._acting() as now_s:
            self._stopped_s = now_s
            self._arming.disarm()
            self._note("stop", operator, f"{operator} pressed STOP", Level.WARNING)
        due_s = time.monotonic() + TAKEN_S
        while not self._mailbox.stop_taken(turn):
            if time.monotonic() > due_s:
                raise Refused(NOT_TAKEN)
            time.sleep(_LOOK_S)

    def note(self, operator: str, text: str, failed: bool = False) -> None:
        """Note what happened to an operator's motion. failed: the run that goes on has failed (rtstack.trials.run)."""
        with self._acting():
            self._note("note", operator, f"{operator}: {text}", Level.ERROR if failed else Level.WARNING)

    def begin(self, operator: str, what: str, by_hand: bool = False) -> None:
        """Begin a motion of the operator's; `what`: for the record. by_hand: a person's hand leads the arms."""
        with self._acting() as now_s:
            if self._mailbox.stop_requested:  # since it was armed
                self._arming.disarm()
            if by_hand:
                if now_s - self._stopped_s < _STOP_LASTS_S:
                    raise Refused("STOP was pressed a moment ago; hold the button again if that is what you want")
                self._arming.begin_by_hand(operator, now_s)
                # of the motion that ended in the fault; a STOP whose report is still to come is asked for again by it
                self._mailbox.clear_stop()
            else:
                self._arming.begin(operator, now_s)
            self._note("begin", operator, f"{operator} ordered {what}")

    def end(self) -> None:
        """The motion is over, and the arms are at rest."""
        with self._acting():
            self._arming.end()

    # faults

    def fault(self, reason: str) -> None:
        """Latch a fault; the first reason stays."""
        with self._acting():
            new = self._arming.phase is not Phase.FAULT
            self._arming.fault(reason)
            if new:
                self._audit.note("fault", None, reason)

    def recover(self, operator: str) -> None:
        """Begin a recovery. Only in a fault, and once the arms are at rest."""
        with self._acting():
            self._arming.recover()
            self._note("recover", operator, f"{operator} asked for a recovery")

    def recovered(self) -> None:
        """The arms have recovered; they are disarmed."""
        with self._acting():
            self._arming.recovered()
            self._note("recovered", None, "recovered: disarmed")

    def not_recovered(self, reason: str) -> None:
        """The recovery was refused: the fault stays, with what the robot said."""
        with self._acting():
            self._arming.not_recovered(reason)
            self._note("not recovered", None, f"recovery refused: {reason}", Level.ERROR)

    # what others see

    def view(self) -> AuthorityView:
        """Return how things are now."""
        with self._acting():
            arming = self._arming
            return AuthorityView(arming.phase, arming.reason, arming.holder, self._since_s, self._refusal())

    @property
    def armed(self) -> bool:
        """Whether motion is allowed, and none runs. Never waits: for the loop's thread."""
        return self._arming.phase is Phase.ARMED

    def run_events(self) -> Iterable[RunEvent]:
        """Return what was done since the last call, oldest first. Never waits: for the loop's thread."""
        while self._run_events:
            yield self._run_events.popleft()

    @contextmanager
    def _acting(self) -> Iterator[float]:
        """Hold the lock, notice a holder who has gone, give the time, and keep the books on the phase."""
        with self._lock:
            phase, holder, now_s = self._arming.phase, self._arming.holder, self._clock()
            self._arming.watch(now_s)
            if holder is not None and self._arming.holder is None:
                text = f"{holder} sent no signal for {LEASE_S:g} s and lost control"
                self._note("lost", holder, text, Level.WARNING)
            try:
                yield now_s
            finally:
                if self._arming.phase is not phase:
                    self._since_s = time.time()

    def _alive(self) -> None:
        self._mailbox.operator_beat(time.monotonic_ns())

    def _stop_at_once(self) -> None:
        if self._arming.stop_wanted:
            self._mailbox.request_stop()

    def _note(self, action: str, operator: str | None, text: str, level: Level = Level.INFO) -> None:
        self._audit.note(action, operator, text)
        self._run_events.append(RunEvent(level, "operator" if operator is not None else "robot", text))

    def _refusal(self) -> str | None:
        arming = self._arming
        if arming.phase is Phase.FAULT:
            return f"there is a fault: {arming.reason}; recover first"
        if arming.phase is Phase.RECOVERING:
            return "the arms are recovering; wait for the end"
        if arming.holder is None:
            return "no operator has control; take control first"
        return "the arms are disarmed; arm them first" if arming.phase is Phase.DISARMED else None
