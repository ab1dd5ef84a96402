"""A cell: two arms and what watches the object between them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from hal.arm import Arm
from hal.arrays import Array
from hal.collisions import CollisionBehaviour
from hal.cycle import Cycles
from hal.errors import RecoveryRefused
from hal.joint_path import JointSpeed
from hal.limits import OwnLimits
from hal.sensor import Sensor
from hal.tracker import ObjectTracker

LEFT, RIGHT = 1, 2  # of the mask that `ArmLink.wait` returns


class ArmLink(Protocol):
    """What both arms of a cell need together, where each of them is a machine of its own."""

    def start(self) -> None:
        """Take torque control of both at once. Raises CommandRejected, ConnectionLost."""
        ...

    def wait(self) -> int:
        """Block until a state has arrived; return the mask of LEFT and RIGHT whose `read` returns at once.

        Raises ConnectionLost when an arm has sent nothing for too long.
        """
        ...

    def set_collisions(self, left: CollisionBehaviour, right: CollisionBehaviour) -> None:
        """Tell both arms how hard they may be touched in the next motion. Raises CommandRejected, ConnectionLost."""
        ...

    def move(self, goal: Array, limit: JointSpeed, stop: Callable[[], bool]) -> bool:
        """Move both arms together, from rest to rest, to the postures goal (2, 7), rad, no joint faster than the limit.

        `stop` is asked once a millisecond; then both brake where they are. Returns whether they have arrived.
        Raises CommandRejected, ConnectionLost.
        """
        ...

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End torque control of both, one after the other, beginning with LEFT or RIGHT. Never raises.

        at_rest: both stand still; then the second one is answered for as long as the first one takes.
        """
        ...

    def recover(self) -> tuple[str, ...]:
        """Recover the arms that are in reflex, both before saying no; return one line for each that was.

        Raises RecoveryRefused with the reasons of all that refuse, ConnectionLost.
        """
        ...

    def close(self) -> None:
        """Release what belongs to both. Never raises."""
        ...


@dataclass(frozen=True, slots=True)
class Cell:
    """What a trial runs on. `name` is the kind as the command line spells it (direct, realtime, fci:LEFT,RIGHT).

    link: None where arms start with their first torque. own_clocks: the arms' states do not arrive together, and
    each has to be answered when its own arrives; otherwise `read` gives both arms' states of one time stamp.
    paced: arms that wait, but keep the pace of the host's clock: it depends on who serves them.
    warning: what its user must know, in one line; empty for nothing. sensors: of no topic twice.
    own_limits: of the left and the right robot, as they say themselves; None where they were not asked.
    cycles: of the left and the right arm, where they are measured.
    """

    name: str
    left: Arm
    right: Arm
    tracker: ObjectTracker
    link: ArmLink | None = None
    own_clocks: bool = False
    paced: bool = False
    warning: str = ""
    sensors: tuple[Sensor, ...] = ()
    own_limits: tuple[OwnLimits, OwnLimits] | None = None
    cycles: tuple[Cycles, Cycles] | None = None

    @property
    def waits(self) -> bool:
        """Whether the arms are of one robot on the wire that waits for its answer."""
        return self.link is not None and not self.own_clocks

    def set_collisions(self, left: CollisionBehaviour, right: CollisionBehaviour) -> None:
        """See ArmLink; the plant in this process has no thresholds."""
        if self.link is not None:
            self.link.set_collisions(left, right)

    def start(self) -> None:
        """Take torque control, where it has to be asked for. Raises CommandRejected, ConnectionLost."""
        if self.link is not None:
            self.link.start()

    def stop(self, first: int = LEFT, *, at_rest: bool = False) -> None:
        """End torque control of both; see ArmLink. Never raises."""
        if self.link is not None:
            self.link.stop(first, at_rest=at_rest)
            return
        for arm in (self.left, self.right) if first == LEFT else (self.right, self.left):
            arm.stop()

    def recover(self) -> None:
        """Recover both arms, both before saying no. Raises RecoveryRefused with what each of them says."""
        if self.link is not None:
            self.link.recover()
            return
        refused: list[str] = []
        for arm in (self.left, self.right):
            try:
                arm.recover()
            except RecoveryRefused as error:
                refused.append(str(error))
        if refused:
            raise RecoveryRefused("; ".join(refused))

    def close(self) -> None:
        """Stop both arms and release them. Never raises."""
        self.left.close()
        self.right.close()
        if self.link is not None:
            self.link.close()
