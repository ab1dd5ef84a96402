"""A hand of the simulated cell in one process: a hal.gripper.Gripper. Its commands let the cell's time go on."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from hal.errors import ConnectionLost, GripperAborted, GripperFailed, NoGripper
from hal.gripper import GripperState
from hal.state import RobotMode
from sim_robot.hand import Order, Outcome

if TYPE_CHECKING:
    from sim_robot.cell import SimulatedCell

ROOM_TEMPERATURE = 25  # deg C, and it stays so


class SimulatedGripper:
    """The hand of an arm, by its index: see hal.gripper.Gripper. For arms that hold, whose states are not answered."""

    def __init__(self, cell: "SimulatedCell", side: int) -> None:
        hand, name = cell.hands[side], cell.scene.sides[side]
        if hand is None:
            raise NoGripper(f"the {name} arm has no hand: load a scene with [{name}.hand]")
        self._cell, self._hand, self._name = cell, hand, f"the {name} hand"
        self._closed = False

    def state(self) -> GripperState:
        self._check_open()
        hand = self._hand
        return GripperState(hand.ticks * 1_000_000, hand.width, hand.max_width, hand.is_grasped, ROOM_TEMPERATURE)

    def homing(self) -> bool:
        return self._carry_out(self._hand.homing)

    def move(self, width: float, speed: float) -> bool:
        return self._carry_out(self._hand.move, width, speed)

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float = 0.005, epsilon_outer: float = 0.005
    ) -> bool:
        return self._carry_out(self._hand.grasp, width, speed, force, epsilon_inner, epsilon_outer)

    def stop(self) -> bool:
        return self._carry_out(self._hand.stop)

    def close(self) -> None:
        self._closed = True

    def _check_open(self) -> None:
        if self._closed:
            raise ConnectionLost(f"{self._name} was closed; open it again")

    def _carry_out(self, ordered: Callable[..., Order], *numbers: float) -> bool:
        self._check_open()
        if any(box.mode == RobotMode.MOVE for box in self._cell.boxes):
            raise GripperFailed(
                f"{self._name} moves in one process with its arms, and they would lose packets: stop them"
            )

        order = ordered(*numbers)
        while order.outcome is None:
            self._cell.next_state()
        if order.outcome == Outcome.FAIL:
            raise GripperFailed(f"{self._name} refused. Is it homed, the width within its range, the speed positive?")
        if order.outcome == Outcome.ABORTED:
            raise GripperAborted(f"{self._name}: another command or stop ended it")
        return order.outcome == Outcome.SUCCESS
