"""The gate in front of all that moves the arms by hand: a command that is old, out of order, or made on an old picture
is not applied. It counts what it does not let through, and why.

A sender has a clock of its own. A picture that it says to have seen left the console before that: its clock is behind
ours by at least the one minus the other. A command came after it was made: its clock is behind by at most arrival minus
making. With the first limit a command is taken for older than it is, by the fastest way from console to sender;
so that none older than the limit is applied, whatever the network does.
"""

from dataclasses import dataclass, field
from enum import IntEnum

from rtstack.teleoperation.stamp import Stamp

OLDEST_COMMAND_S, OLDEST_PICTURE_S = 0.1, 0.25
_GENERATION_NS = 10_000_000_000  # a limit is of the last 10 to 20 s
_DRIFT_NS = 2_000_000  # of two crystal clocks in 20 s: less than 100 ppm
_SENDERS = 32  # that are remembered


class Drop(IntEnum):
    """Why a command was not applied: the index of its counter."""

    OLD = 0
    ORDER = 1
    PICTURE = 2
    OTHER = 3


UNSTAMPED = "a command has to say which picture it answers, and when it was made: the stamp is missing"
_UNKNOWN = "it answers a picture that was never shown, or too long ago"
_CLOCK = "its sender's clock was set, or it says to be made later than it came"
_ORDER = "a later one has come before it"


@dataclass(frozen=True, slots=True)
class Admission:
    """What the gate says of a command. drop: None where it is applied; text: why not. Times are ns of the console's
    clock, in the middle of both limits: when it was made, of which moment its picture was, and when that was seen;
    latest_ns: when it was made at the latest.
    """

    drop: Drop | None
    text: str = ""
    sequence: int = 0
    made_ns: int = 0
    picture: int = 0
    picture_ns: int = 0
    seen_ns: int = 0
    latest_ns: int = 0

    @property
    def alive(self) -> bool:
        """Whether it is a sign of life of its sender: a command on an old picture is one."""
        return self.drop in (None, Drop.PICTURE)


@dataclass(slots=True)
class _Sender:
    """The newest command's number and time, and the limits of our time minus its sender's, of two generations; ns."""

    began_ns: int
    sequence: int = -1
    made: float = float("-inf")
    least: list[float] = field(default_factory=lambda: [float("-inf")] * 2)
    most: list[float] = field(default_factory=lambda: [float("inf")] * 2)

    def add(self, now_ns: int, least: float, most: float) -> bool:
        """Take both limits that a command gives. Returns whether they agree with those that are known."""
        if now_ns - self.began_ns > _GENERATION_NS:
            self.began_ns = now_ns
            self.least, self.most = [self.least[1], float("-inf")], [self.most[1], float("inf")]
        self.least[1], self.most[1] = max(self.least[1], least), min(self.most[1], most)
        return max(self.least) <= min(self.most) + _DRIFT_NS

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the most that holds now, whatever the clocks have drifted since they were found."""
        return max(self.least) - _DRIFT_NS, min(self.most) + _DRIFT_NS


class Gate:
    """The gate of all devices. Not for two threads at a time."""

    def __init__(self) -> None:
        self._senders: dict[tuple[str, str], _Sender] = {}
        self.forget()

    def forget(self) -> None:
        """Count from zero again."""
        self.dropped = [0] * len(Drop)

    def admit(self, operator: str, stamp: Stamp | None, picture_ns: int | None, now_ns: int) -> Admission:
        """Judge a command of an operator at now_ns. picture_ns: of which time its picture is, None without one."""
        admission = self._judged(operator, stamp, picture_ns, now_ns)
        if admission.drop is not None:
            self.dropped[admission.drop] += 1
        return admission

    def _judged(self, operator: str, stamp: Stamp | None, picture_ns: int | None, now_ns: int) -> Admission:
        if stamp is None or picture_ns is None:
            return Admission(Drop.OTHER, UNSTAMPED if stamp is None else _UNKNOWN)
        made, seen = 1e6 * stamp.made_ms, 1e6 * stamp.seen_ms
        key = (operator, stamp.sender)
        sender = self._senders.pop(key, None) or _Sender(now_ns)
        self._senders[key] = sender  # the newest one is the last one
        if len(self._senders) > _SENDERS:
            del self._senders[next(iter(self._senders))]
        if stamp.sequence <= sender.sequence or made < sender.made:
            return Admission(Drop.ORDER, _ORDER)
        sender.sequence = stamp.sequence
        if made < seen:
            return Admission(Drop.OTHER, _CLOCK)
        if not sender.add(now_ns, picture_ns - seen, now_ns - made):
            self._senders[key] = _Sender(now_ns, stamp.sequence)
            return Admission(Drop.OTHER, _CLOCK)
        least, most = sender.limits
        age_ns = now_ns - made - least
        if age_ns > OLDEST_COMMAND_S * 1e9:
            return Admission(Drop.OLD, f"it is {age_ns * 1e-6:.0f} ms old, {1e3 * OLDEST_COMMAND_S:.0f} ms are allowed")
        sender.made = made
        middle = 0.5 * (least + most)
        shown_ns = picture_ns if stamp.camera_us is None else min(picture_ns, 1000 * stamp.camera_us)
        said = (stamp.sequence, int(made + middle), stamp.picture, shown_ns, int(seen + middle), int(made + most))
        old_ns = made + most - shown_ns
        if old_ns > OLDEST_PICTURE_S * 1e9:
            text = f"it was made on a picture {old_ns * 1e-6:.0f} ms old, {1e3 * OLDEST_PICTURE_S:.0f} ms are allowed"
            return Admission(Drop.PICTURE, text, *said)
        return Admission(None, "", *said)
