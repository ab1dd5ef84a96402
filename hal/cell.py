"""A cell: two arms and what watches the object between them."""

from dataclasses import dataclass

from hal.arm import Arm
from hal.tracker import ObjectTracker


@dataclass(frozen=True, slots=True)
class Cell:
    """What a trial runs on. `name` is the kind as the command line spells it (direct, realtime, fci:LEFT,RIGHT)."""

    name: str
    left: Arm
    right: Arm
    tracker: ObjectTracker

    def close(self) -> None:
        """Stop both arms and release them. Never raises."""
        self.left.close()
        self.right.close()
