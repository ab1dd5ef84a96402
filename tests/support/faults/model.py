"""What a fault of the matrix is: data. How it comes about, what has to happen, and what came of it."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from rtstack.samples import Mode

if TYPE_CHECKING:
    from tests.support.faults.stage import Stage

MOST_TICKS = 2  # from where the loop can see a fault to the first stopping torque


class Moment(StrEnum):
    """When a fault comes."""

    IDLE = "idle"
    TELEOPERATION = "teleoperation"
    ANTE = "ante"
    INTERIM = "interim"
    POST = "post"
    STOPPING = "stopping"


# the session's mode that the moment is, and how many ticks after its beginning the fault comes: the ante-impact mode in
# full motion, a seventh of a second before the impact, the post-impact mode while the box is lifted
MODES = {
    Moment.TELEOPERATION: (Mode.TELEOPERATION, 400),
    Moment.ANTE: (Mode.ANTE_IMPACT, 1160),
    Moment.INTERIM: (Mode.INTERIM, 30),
    Moment.POST: (Mode.POST_IMPACT, 400),
    Moment.STOPPING: (Mode.STOPPING, 20),
}
MOVING = (Moment.TELEOPERATION, Moment.ANTE, Moment.INTERIM, Moment.POST)


class Reaction(StrEnum):
    """What may be right. Each with a reason that has to be said."""

    STOP = "controlled stop"  # the judge's braking profile to rest, and torque control ends
    LEAVE = "torque control ends"  # the robot brakes and holds by itself, on its own or because the loop lets go of it
    GO_ON = "goes on"
    NO_MOTION = "nothing moves"
    FIRST_REASON = "the stop goes on, its first reason stays"


@dataclass(frozen=True, slots=True)
class Expected:
    """The right reaction. says: regular expression, searched in what the run said.

    sees_after: ticks from the fault until the loop can see it, where it needs time to tell a fault from a hiccup.
    """

    reactions: tuple[Reaction, ...]
    says: str
    sees_after: int = 0

    @property
    def text(self) -> str:
        """One line for the table."""
        return " or ".join(self.reactions)


@dataclass(frozen=True, slots=True)
class Scripted:
    """A fault of the simulated robot: keys of a [[fault]] table but for the moment (sim_robot/faults/kinds.py).

    lasts_s: None to the end. What has to be there still when an idle cell is asked for a run lasts longer there:
    lasts_idle_s, of the host's time.
    """

    keys: str
    lasts_s: float | None = None
    lasts_idle_s: float | None = None

    def script(self, when: str, idle: bool, longer_s: float = 0.0) -> str:
        """Return the faults file. when: keys of the moment; longer_s: added to what does not last to the end."""
        lasts_s = self.lasts_idle_s if idle and self.lasts_idle_s is not None else self.lasts_s
        lasts_s = None if lasts_s is None else lasts_s + longer_s
        duration = "" if lasts_s is None else f"duration_s = {lasts_s}\n"
        return f"[[fault]]\n{when}\n{self.keys}\n{duration}"


@dataclass(frozen=True, slots=True)
class Performed:
    """A fault that a function brings about between a state and its answer, in the process of the loop."""

    act: Callable[["Stage"], None]


class Recovery(StrEnum):
    """How one gets out of it."""

    AGAIN = "the next motion runs"
    RESET = "error recovery, refused while the cause persists"
    RECONNECT = "open the arms again"
    NEW_ROBOT = "refused while the robot is gone; with a new one the next motion runs"


@dataclass(frozen=True, slots=True)
class Fault:
    """One row of the matrix, a cell for each moment.

    physical: the loop can see it once a measured value is beyond a limit of the judge, or the robot says so.
    reflex: the robot may stop itself, too. small_ring: the log's rings hold a second, not eight. own_clocks: each arm
    is served when its own state arrives, as two control boxes are. proof: what shows that the fault was there, for one
    that leaves no other trace. log_dies: up to 0.5 s of the log may be missing. shared_clock: it is another fault, with
    a row of its own, where each arm has its own clock. apart: of moving arms that do not wait for the loop, where that
    differs; they may stop themselves, too.
    """

    name: str
    what: str
    how: Scripted | Performed
    moving: Expected
    idle: Expected
    stopping: Expected = Expected((Reaction.FIRST_REASON,), "the operator has gone")
    recovery: Recovery = Recovery.AGAIN
    own_clocks: bool = False
    physical: bool = False
    reflex: bool = False
    small_ring: bool = False
    log_dies: bool = False
    shared_clock: bool = False
    proof: Callable[["Stage"], bool] | None = None
    apart: Expected | None = None

    def expected(self, moment: Moment, apart: bool = False) -> Expected:
        """Return what has to happen at a moment. apart: where the arms do not wait for the loop."""
        if apart and self.apart is not None and moment in MOVING:
            return self.apart
        return {Moment.IDLE: self.idle, Moment.STOPPING: self.stopping}.get(moment, self.moving)


@dataclass(slots=True)
class CaseResult:
    """One cell of the table. misses: what was not as it has to be, empty where all was."""

    fault: str
    moment: str
    expected: str
    seen: str = ""
    said: str = ""
    latency_ticks: int | None = None
    allowed_ticks: int | None = None
    robot: str = ""
    log: str = ""
    recovered: str = ""
    seconds: float = 0.0
    misses: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)
