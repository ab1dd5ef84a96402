"""An analysis of logs: how hard both pads squeeze what is between them, and for how long."""

import numpy as np

from rtstack.log.analysis.offered import Analysis, Curve, Number
from rtstack.log.reader import Log

HELD_N = 5.0  # below it a squeeze is the noise of the estimate


def squeeze(log: Log) -> Analysis:
    """Return the smaller one of both pads' forces, N, its largest value, and how long it was above HELD_N, s."""
    left, right = (log.topic(f"/{side}/arm") for side in ("left", "right"))
    both = min(len(left), len(right))  # none of a cell with one arm
    forces = [np.linalg.norm(arm["O_F_ext_hat_K"][:both, :3], axis=1) for arm in (left, right)]
    smaller = np.minimum(*forces)
    numbers = (
        Number("largest", "N", float(smaller.max(initial=0.0))),
        Number("held", "s", 1e-3 * int((smaller > HELD_N).sum())),
    )
    return Analysis((Curve("force", "N", left["t_ns"][:both], smaller),), numbers)
