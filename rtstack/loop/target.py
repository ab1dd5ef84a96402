"""What an operator asks of the loop, and what a policy does: the blocks of words that the mailbox carries."""

from enum import IntEnum

import numpy as np


class Release(IntEnum):
    """Why the clutch is not held."""

    NOT_YET = 0  # it was not held since the session began
    RELEASED = 1  # by the operator
    LOST = 2  # the page was hidden, closed, or lost the keyboard focus


# clutch_ns: host's time.monotonic_ns() of the last sign of life of a clutch that is held, 0 while it is not; release:
# Release; finish: not 0 to end the session; policy: number of the lease of the policy that leads while the clutch is
# not held, 0 for none; speed m/s; stiffness N/m; pose T_world_ee of (left, right): m, wxyz.
# Of the last command that was applied: its sequence, when it was made and came, the picture that it answers, when that
# was of the robot and when it was seen (ns of the same clock, 0 before the first one). dropped: how many were not
# applied: too old, out of order, made on an old picture, for another reason
TARGET = np.dtype(
    [
        ("job", "i8"),
        ("clutch_ns", "i8"),
        ("release", "i8"),
        ("finish", "i8"),
        ("policy", "i8"),
        ("speed", "f8"),
        ("stiffness", "f8"),
        ("pose", "f8", (2, 7)),
        ("sequence", "i8"),
        ("made_ns", "i8"),
        ("came_ns", "i8"),
        ("picture", "i8"),
        ("picture_ns", "i8"),
        ("seen_ns", "i8"),
        ("dropped", "i8", 4),
    ]
)

CHUNK_POSES = 16  # in one answer

# One answer of a policy. lease: the one that it was made under; beat_ns: host's time.monotonic_ns() when it came, a
# sign of life; observed_ns: robot's time of the left arm's state that it answers; pose k of `count` is due (k + 1)
# step_ns later. xi: of the posture joint, rad, not a number where the posture is left as it is
CHUNK = np.dtype(
    [
        ("job", "i8"),
        ("lease", "i8"),
        ("beat_ns", "i8"),
        ("observed_ns", "i8"),
        ("step_ns", "i8"),
        ("count", "i8"),
        ("pose", "f8", (CHUNK_POSES, 2, 7)),
        ("xi", "f8", (CHUNK_POSES, 2)),
    ]
)
