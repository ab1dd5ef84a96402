"""A cell: one arm or two, and what watches the object."""

from dataclasses import dataclass
from typing import Protocol

from hal.arm import Arm
from hal.cycle import Cycles
from hal.errors import RecoveryRefused
from hal.limits import CollisionBehaviour, OwnLimits
from hal.sensor import Sensor
from hal.tracker import ObjectTracker

LEFT, RIGHT = 1, 2  # of the mask that `ArmLink.wait` returns: the first arm's bit, and the second one's


class ArmLink(Protocol):
    """What the arms of a cell need together, where each of them is a machine of its own.

    What is given for each arm is in the order of the arms, left before right. A cell's only arm is the first one.
    """

    def start(self) -> None:
        """Take torque control of all arms at once. Raises CommandRejected, ConnectionLost."""

    def wait(self) -> int:
        """Block until a state has arrived; return the mask of LEFT and RIGHT whose `read` returns at once.

        Raises ConnectionLost when an arm has sent nothing for too long.
        """
        ...

    def set_collisions(self, *arms: CollisionBehaviour) -> None:
        """Tell each arm how hard it may be touched in the next motion. Raises CommandRejected, ConnectionLost."""

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End torque control, one arm after the other, beginning with LEFT or RIGHT. Never raises.

        at_rest: the arms stand still; then the second one is answered for as long as the first one takes.
        """

    def recover(self) -> tuple[str, ...]:
        """Recover the arms that are in reflex, all before saying no; return one line for each that was.

        Raises RecoveryRefused with the reasons of all that refuse, ConnectionLost.
        """
        ...

    def close(self) -> None:
        """Release what belongs to the arms together. Never raises."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What a trial runs on. `name` is the kind as the command line spells it (direct, realtime, fci:LEFT,RIGHT).

    left, right: None where the cell has no such arm; it has at least one. link: None where arms start with their first
    torque. own_clocks: the arms' states do not arrive together, and each has to be answered when its own arrives;
    otherwise `read` gives all arms' states of one time stamp.
    paced: arms that wait, but keep the pace of the host's clock: it depends on who serves them.
    warning: what its user must know, in one line; empty for nothing. sensors: of no topic twice.
    own_limits: of each robot, as it says itself; None where they were not asked. cycles: of each arm, where they are
    measured.
    """

    name: str
    left: Arm | None
    right: Arm | None
    tracker: ObjectTracker
    link: ArmLink | None = None
    own_clocks: bool = False
    paced: bool = False
    warning: str = ""
    sensors: tuple[Sensor, ...] = ()
    own_limits: tuple[OwnLimits, ...] | None = None
    cycles: tuple[Cycles, ...] | None = None

    def __post_init__(self) -> None:
        if self.left is None and self.right is None:
            raise ValueError("a cell has at least one arm")

    @property
    def arms(self) -> tuple[Arm, ...]:
        """The arms that are there, left before right."""
        return tuple(arm for arm in (self.left, self.right) if arm is not None)

    @property
    def sides(self) -> tuple[str, ...]:
        """The side of each arm."""
        return tuple(side for side, arm in (("left", self.left), ("right", self.right)) if arm is not None)

    @property
    def waits(self) -> bool:
        """Whether the arms are of one robot on the wire that waits for its answer."""
        return self.link is not None and not self.own_clocks

    def set_collisions(self, *arms: CollisionBehaviour) -> None:
        """See ArmLink; the plant in this process has no thresholds."""
        if self.link is not None:
            self.link.set_collisions(*arms)

    def start(self) -> None:
        """Take torque control, where it has to be asked for. Raises CommandRejected, ConnectionLost."""
        if self.link is not None:
            self.link.start()

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End torque control; see ArmLink. Never raises."""
        if self.link is not None:
            self.link.stop(first, at_rest=at_rest)
            return
        for arm in self.arms if first == LEFT else reversed(self.arms):
            arm.stop()

    def recover(self) -> None:
        """Recover the arms, all before saying no. Raises RecoveryRefused with what each of them says."""
        if self.link is not None:
            self.link.recover()
            return
        refused: list[str] = []
        for arm in self.arms:
            try:
                arm.recover()
            except RecoveryRefused as error:
                refused.append(str(error))
        if refused:
            raise RecoveryRefused("; ".join(refused))

    def close(self) -> None:
        """Stop the arms and release them. Never raises."""
        for arm in self.arms:
            arm.close()
        if self.link is not None:
            self.link.close()
