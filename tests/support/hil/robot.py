"""The two arms that the suite talks to."""

from dataclasses import dataclass

from hal.fci import FciPair, open_pair
from hal.pad import Pad


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
        """Connect to both arms."""
        return open_pair(self.left, self.right, (tool, tool), shared_clock=self.simulated)
