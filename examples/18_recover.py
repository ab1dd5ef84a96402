"""Recovery without a restart: a reflex, its name, the refusal while its cause lasts, and the next motion.

Recovery is a call that is made after the error. It cannot be armed in advance, so it never fires on the next one.
"""

from contextlib import closing

import numpy as np

from hal.errors import CommandRejected
from hal.fci import FciArm
from rtstack.testing import serve_arms


def hold(arm, ticks):
    """Damp the arm where it is."""
    for _ in range(ticks):
        arm.write(-5.0 * arm.read().dq)


with serve_arms() as served, closing(FciArm(served.left)) as arm:
    hold(arm, 50)
    try:
        for _ in range(50):
            arm.read()
            arm.write(np.full(7, 30.0))  # a step: a robot accepts 1 Nm a tick
    except CommandRejected as reflex:
        print(reflex)
        print("errors:", ", ".join(reflex.errors))
    arm.recover()
    print("after recovery:", arm.read().robot_mode.name)
    hold(arm, 50)
    print("in motion again:", arm.read().robot_mode.name)
