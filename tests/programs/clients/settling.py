"""When a motion is over: for clients whose clock need not be the robot's."""

import time
from collections.abc import Callable

LONGEST_S = 30.0


def settles(error: Callable[[], float], allowed: float) -> bool:
    """Wait until an error is small and stays so."""
    end_s, since = time.monotonic() + LONGEST_S, 0
    while time.monotonic() < end_s and since < 20:
        time.sleep(0.01)
        since = since + 1 if error() < allowed else 0
    return since == 20
