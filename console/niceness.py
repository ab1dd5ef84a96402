"""How programs that the page starts stand back behind the robot's loop, which may run on the same machine."""

import os

# A third of the processor time of a program of niceness 0 beside it (kernel/sched: weights 1024 and 335).
# At 10 it is a tenth: what the operator waits for took minutes where other programs keep both cores busy.
NICENESS = 5


def stand_back() -> None:
    """Lower this process's priority."""
    os.nice(NICENESS)
