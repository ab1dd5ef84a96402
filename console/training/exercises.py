"""The faults that an operator can be trained with, and what is to be done about each of them.

Each is a scripted fault of the simulated robot (docs/fault_scripts.md), with a moment that is filled in.
"""

from dataclasses import dataclass
from enum import StrEnum


class Action(StrEnum):
    """What an operator can do about a fault."""

    STOP = "stop"  # nothing else stops the arms
    RECOVER = "recover"  # they have stopped by themselves
    GO_ON = "go on"  # it is none


@dataclass(frozen=True, slots=True)
class Exercise:
    """A fault. script: of it, without its moment; todo: in one line; row: what the runbook's row is
    about that says more, empty for none.
    """

    name: str
    words: str
    script: str
    action: Action
    todo: str
    row: str

    def faults(self, at_s: float) -> str:
        """Return the text of a faults file in which it comes at_s after the first motion."""
        return f"[[fault]]\nat_s = {at_s:.3f}\n{self.script}\n"


_STOPPED = "stop requested by the operator"
EXERCISES = (
    Exercise(
        "joint_reflex", "an arm stops by a reflex", 'kind = "reflex"\narm = "right"\nerror = "joint_reflex"',
        Action.RECOVER, "Look for what was hit, free the arm, then Recover and Arm.", "joint_reflex",
    ),
    Exercise(
        "user_stop", "the external activation device is pressed", 'kind = "user_stop"\narm = "left"\nduration_s = 3.0',
        Action.RECOVER, "Ask who pressed it and why; once it is released: Recover and Arm.",
        "the robot left torque control",
    ),
    Exercise(
        "state_nan", "an arm reports values that are no numbers",
        'kind = "state_nan"\narm = "left"\nfield = "dq"\nduration_s = 0.2',
        Action.RECOVER, "The judge has stopped both arms: Recover, and report it with the log.",
        "a value of the state or the desired torque is not finite",
    ),
    Exercise(
        "object_lost", "the object falls out of the cell", 'kind = "object_lost"',
        Action.STOP, "Press STOP: the arms go on around nothing. Put the object back.", _STOPPED,
    ),
    Exercise(
        "slip", "the object slips out of a pad", 'kind = "slip"\narm = "both"\nfriction_factor = 0.02',
        Action.STOP, "Press STOP before it falls further; then clean the pads, or press harder.", _STOPPED,
    ),
    Exercise(
        "tracker_lost", "the cameras lose the object for a second", 'kind = "tracker_lost"\nduration_s = 1.0',
        Action.GO_ON, "Nothing: the arms do not follow the cameras. Do not stop a good trial.", "",
    ),
)  # fmt: skip
