"""The two arms that the suite talks to."""

from dataclasses import dataclass

from hal.fci import FciPair, open_pair
from hal.limits import CollisionBehaviour
from hal.pad import Pad
from rtstack.cells import default_cell_file
from rtstack.cells.fci import approach_collisions
from rtstack.model.cell_description import load_cell_description

COLLISIONS: CollisionBehaviour = approach_collisions(load_cell_description(default_cell_file()))


@dataclass(frozen=True, slots=True)
class Robot:
    """Two arms. simulated: ours, in lockstep, where nothing depends on the machine; marks: assert them."""

    left: str
    right: str
    simulated: bool
    marks: bool
    tracker: str

    @property
    def kind(self) -> str:
        """As the command line spells it."""
        return f"fci:{self.left},{self.right}"

    def pair(self, tool: Pad | None = None) -> FciPair:
        """Connect to both arms, with the thresholds of an approach."""
        return open_pair(self.left, self.right, (tool, tool), COLLISIONS, shared_clock=self.simulated)
