"""How the object gets to where a case wants it: the arms carry it there; what they cannot mend, a person does."""

import time
from collections.abc import Callable
from typing import Any

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.experiments.attempts import Kind, aborted
from rtstack.experiments.experiment import CellRun
from rtstack.model.cell_description import CellDescription
from rtstack.trials import placement
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.move import PreparedMove, holds
from rtstack.trials.specification import HandMotion, MoveSpecification, PlacementSpecification
from rtstack.trials.start_motion import WayRefused

ATTEMPTS = 3  # of the arms, before a person is asked
CLEAR = "take the object off the table: the arms need all of it (a simulated robot: start it with --object none)"
STANDS_S = 1.0  # so long the object has to stand in its place, once a person has put it there
Carry = Callable[[PreparedRun[Any], Kind, str], Any]
Wait = Callable[[Callable[[], str], Kind, str], None]


class ResetAborted(TrialError):
    """A run that was to bring the arms or the object to where a case begins was aborted. reason: see `aborted`."""

    def __init__(self, what: str, reason: str) -> None:
        super().__init__(f"{what}: {reason}")
        self.reason = reason


class Reset:
    """Sets the object of a cell in its place.

    carry: carries out a run for a case; wait: tells a person what is to be done for as long as there is something to
    tell; both note it. by_arms: they place the object. put_back: see CellHost. cell: set it anew once it is
    reopened.
    """

    def __init__(
        self, cell: Cell, carry: Carry, wait: Wait, by_arms: bool = True,
        put_back: Callable[[], Cell | None] = lambda: None,
    ) -> None:  # fmt: skip
        self.cell, self._carry, self._wait, self._by_arms, self._put_back = cell, carry, wait, by_arms, put_back
        self._why = ""  # the arms could not place the object

    def go_to_start(self, planned: CellRun, case_id: str) -> None:
        """Have the arms of a cell that was just opened put down what they hold, and go to the start. Raises TrialError.

        What the tracker says is of now afterwards: a simulated robot in lockstep has shown nothing while no arm moved.
        """
        description, name = planned.run.description, planned.run.specification.object
        self._clear(planned, case_id)
        self._put_down(description, name, case_id)
        if placement.blocks_start(self.cell, description, name):
            self.cell = self._put_back() or self.cell
            self._wait(lambda: placement.blocks_start(self.cell, description, name), Kind.PERSON, case_id)
        start = PreparedMove(MoveSpecification(HandMotion.START, name), description)
        if reason := self._carry(start, Kind.START, case_id).failure_reason:
            raise ResetAborted("the arms do not reach the start", reason)

    def set_in_place(self, planned: CellRun, case_id: str) -> None:
        """Have the arms put down what they hold and carry the object to its place; ask a person where they cannot.

        Returns once it stands there, measured. Raises TrialError at a stop, WayRefused where the arms have to go to the
        start first.
        """
        description, name = planned.run.description, planned.run.specification.object
        self._clear(planned, case_id)
        if planned.wanted is None:
            return
        if placement.blocks_start(self.cell, description, name):
            self.go_to_start(planned, case_id)
        self._put_down(description, name, case_id)
        by_arms, first = self._by_arms, True
        while True:
            placed = self._place(description, name, planned.wanted, case_id) if by_arms else False
            if placed:
                return
            if first and by_arms and (cell := self._put_back()) is not None:
                self.cell, first = cell, False
                self.go_to_start(planned, case_id)
                continue
            by_arms &= placed is None  # the arms try again once it is seen to stand upright
            if self._by_a_person(description, name, planned.wanted, case_id, by_arms):
                return

    def _clear(self, planned: CellRun, case_id: str) -> None:
        """Where nothing may stand on the table, wait until the tracker sees nothing."""
        description = planned.run.description
        if planned.clear:
            self._wait(lambda: CLEAR if placement.object_is_seen(self.cell, description) else "", Kind.PERSON, case_id)

    def _put_down(self, description: CellDescription, name: str, case_id: str) -> None:
        if holds(self.cell, description):
            down = PreparedMove(MoveSpecification(HandMotion.PUT_DOWN, name), description)
            if reason := self._carry(down, Kind.PUT_DOWN, case_id).failure_reason:
                raise ResetAborted(f"{name} could not be put down", reason)

    def _place(self, description: CellDescription, name: str, wanted: Displacement, case_id: str) -> bool | None:
        """Return whether the object stands in its place, placed where it did not; None where it is not seen upright."""
        specification = PlacementSpecification(name, 1e3 * wanted.x_m, 1e3 * wanted.y_m, wanted.yaw_deg)
        try:
            stands = placement.object_stands(self.cell, description, name)
        except TrialError:
            return None
        if _near(stands, wanted):
            return True
        try:
            prepared = placement.prepare_placement(specification, description)
            result = placement.place(prepared, ATTEMPTS, lambda attempt: self._carry(attempt, Kind.PLACEMENT, case_id))
        except WayRefused:
            raise
        except TrialError as error:  # it is out of reach
            self._why = str(error)
            return False
        if aborted(result.failure_reason):
            raise ResetAborted(f"placing {name} was aborted", str(result.failure_reason))
        self._why = result.failure_reason or ""
        return result.success

    def _by_a_person(
        self, description: CellDescription, name: str, wanted: Displacement, case_id: str, until_upright: bool
    ) -> bool:
        """Tell a person what is wrong until the object stands in its place for STANDS_S; return whether it does."""
        since_s: float | None = None
        elsewhere = False

        def said() -> str:
            nonlocal since_s, elsewhere
            text, upright = self._deviation(description, name, wanted)
            elsewhere = upright and bool(text) and until_upright
            if elsewhere:
                return ""
            if text:
                since_s = None
                return text
            since_s = since_s or time.monotonic()
            return f"{name} stands in its place" if time.monotonic() - since_s < STANDS_S else ""

        self._wait(said, Kind.PERSON, case_id)
        return not elsewhere

    def _deviation(self, description: CellDescription, name: str, wanted: Displacement) -> tuple[str, bool]:
        """Return in one line what a person has to do, "" for nothing, and whether the object stands upright."""
        try:
            stands = placement.object_stands(self.cell, description, name)
        except TrialError as error:
            return str(error), False
        if _near(stands, wanted):
            return "", True
        why = f" (the arms could not: {self._why})" if self._why else ""
        return instruction(name, stands, wanted, description) + why, True


def instruction(name: str, stands: Displacement, wanted: Displacement, description: CellDescription) -> str:
    """Return how an object has to be moved, in the words of someone who stands in front of the arms' table."""
    x_mm, y_mm = 1e3 * (wanted.x_m - stands.x_m), 1e3 * (wanted.y_m - stands.y_m)
    turn_deg = (wanted.yaw_deg - stands.yaw_deg + 90.0) % 180.0 - 90.0  # half a turn looks the same
    left_y = description.arms[0].base_position[1] - description.arms[-1].base_position[1]
    side = "left" if y_mm * left_y > 0.0 else "right"
    turning = f"{'counter' * (turn_deg > 0.0)}clockwise, seen from above"
    parts = (
        (y_mm, f"{abs(y_mm):.0f} mm towards the {side} arm"),
        (x_mm, f"{abs(x_mm):.0f} mm {'along' if x_mm > 0.0 else 'against'} x"),
        (turn_deg, f"turn it by {abs(turn_deg):.0f} degrees {turning}"),
    )
    return f"{name}: move it " + ", ".join(words for away, words in parts if abs(away) >= 1.0)


def _near(stands: Displacement, wanted: Displacement) -> bool:
    off_mm, off_deg = placement.difference(stands, wanted)
    return off_mm <= placement.NEAR_MM and off_deg <= placement.NEAR_DEG
