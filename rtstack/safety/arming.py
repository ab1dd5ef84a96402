"""Whether the arms may move, and for which operator. A state machine without clock, thread or I/O, which callers bring.

    DISARMED --arm--> ARMED --begin--> MOVING --end--> ARMED
       any --fault--> FAULT --recover--> RECOVERING --recovered--> DISARMED
                        ^-----------not_recovered-----'

One operator at a time holds the lease, and keeps it by signs of life; only the holder arms and begins; each may
disarm, stop and ask for a recovery. Who loses the lease disarms, and a motion without its operator has to stop. A
recovery is asked for in a fault and at no other time, so that none waits for the next error; it never leads to motion.
What a person's hand leads may run in a fault too, which it does not end.
"""

from enum import StrEnum

LEASE_S = 2.0  # a holder that gives no sign of life for so long is gone
NOT_AT_REST = "the arms have not come to rest yet; wait a moment"


class Phase(StrEnum):
    """What the arms are allowed to do."""

    DISARMED = "disarmed"
    ARMED = "armed"
    MOVING = "moving"
    FAULT = "fault"
    RECOVERING = "recovering"


class Refused(Exception):
    """What was asked for is not allowed now. The message is one line that says why, and what to do."""


class ArmingStateMachine:
    """The arming of one cell: lease, phase, fault, recovery. Times are seconds of one monotonic clock, the caller's."""

    def __init__(self, lease_s: float = LEASE_S) -> None:
        self.phase = Phase.DISARMED
        self.reason: str | None = None  # of the fault, until it is recovered
        self.holder: str | None = None
        self.running = False  # a motion has begun, and the arms are not yet reported at rest
        self.stop_wanted = False  # that motion has to stop: its operator has gone, or a fault has come
        self._lease_s = lease_s
        self._alive_s = 0.0

    # the lease

    def take(self, operator: str, now_s: float) -> None:
        """Give the lease to an operator. Raises Refused while another operator holds it."""
        self.watch(now_s)
        if self.holder not in (None, operator):
            raise Refused(f"{self.holder} has control; ask them to release it")
        self.holder, self._alive_s = operator, now_s

    def beat(self, operator: str, now_s: float) -> None:
        """Take the holder's sign of life; another operator's, or a late one, has no effect."""
        self.watch(now_s)
        if operator == self.holder:
            self._alive_s = now_s

    def release(self, operator: str) -> None:
        """Give the lease back. A motion that still runs stops."""
        if operator == self.holder:
            self._lose_holder()

    def watch(self, now_s: float) -> None:
        """Notice that the holder has gone. To be called regularly."""
        if self.holder is not None and now_s - self._alive_s > self._lease_s:
            self._lose_holder()

    def _lose_holder(self) -> None:
        self.holder = None
        self.disarm()

    # motion

    def arm(self, operator: str, now_s: float) -> None:
        """Allow motion. Raises Refused without the lease, in a fault, and while something runs."""
        self._check_holder(operator, now_s)
        if self.phase is Phase.FAULT:
            raise Refused(f"there is a fault: {self.reason}; recover first")
        if self.phase is not Phase.DISARMED and self.phase is not Phase.ARMED:
            raise Refused(f"the arms are {self.phase}; wait for the end")
        self.phase = Phase.ARMED

    def disarm(self) -> None:
        """Allow no motion any more; a running one has to stop. Needs no lease."""
        if self.phase is Phase.ARMED:
            self.phase = Phase.DISARMED
        self.stop_wanted = self.running

    def begin(self, operator: str, now_s: float) -> None:
        """Begin a motion. Raises Refused unless the holder has armed."""
        self._check_holder(operator, now_s)
        if self.phase is not Phase.ARMED:
            raise Refused(f"the arms are {self.phase}; arm them first")
        self.phase, self.running, self.stop_wanted = Phase.MOVING, True, False

    def begin_by_hand(self, operator: str, now_s: float) -> None:
        """Begin a motion that a hand leads, in a fault too: it may lead out of its cause.

        Raises Refused as `begin` does; in a fault unless the arms are at rest.
        """
        if self.phase is not Phase.FAULT:
            self.begin(operator, now_s)
            return
        self._check_holder(operator, now_s)
        if self.running:
            raise Refused(NOT_AT_REST)
        self.running, self.stop_wanted = True, False

    def end(self) -> None:
        """The motion is over and the arms are at rest. A fault that has ended it stays."""
        if self.phase is Phase.MOVING:
            self.phase = Phase.DISARMED if self.stop_wanted else Phase.ARMED
        self.running = self.stop_wanted = False

    # faults

    def fault(self, reason: str) -> None:
        """Latch a fault. The first reason stays until the recovery; a recovery that is under way has failed."""
        self.stop_wanted = self.running
        if self.phase is not Phase.FAULT:
            self.phase, self.reason = Phase.FAULT, reason

    def recover(self) -> None:
        """Begin a recovery. Raises Refused when there is nothing to recover from, or the arms still come to rest."""
        if self.phase is not Phase.FAULT:
            raise Refused(f"nothing to recover from: the arms are {self.phase}")
        if self.running:
            raise Refused(NOT_AT_REST)
        self.phase = Phase.RECOVERING

    def recovered(self) -> None:
        """The robot has recovered. Does nothing where a fault has come meanwhile."""
        if self.phase is Phase.RECOVERING:
            self.phase, self.reason = Phase.DISARMED, None

    def not_recovered(self, reason: str) -> None:
        """The robot has refused the recovery: the fault stays, with what it says."""
        if self.phase is Phase.RECOVERING:
            self.phase, self.reason = Phase.FAULT, reason

    def _check_holder(self, operator: str, now_s: float) -> None:
        self.watch(now_s)
        if self.holder != operator:
            held = "no operator has" if self.holder is None else f"{self.holder} has"
            raise Refused(f"{held} control; take control first")
