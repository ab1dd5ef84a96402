"""Collision thresholds that live with contact: the robot's own, set before a motion, by what the motion is to meet.

In a trial the judge's limits follow the phase, and the robots are told thresholds behind them.
"""

from contextlib import closing
from dataclasses import replace

import numpy as np

from hal.errors import CommandRejected
from hal.fci import FciArm
from hal.limits import CollisionBehaviour
from rtstack.cells import load_description
from rtstack.safety.limits import ForcePhase
from rtstack.testing import serve_arms
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial

left, _ = prepare_trial(TrialSpecification("ref.mcap"), load_description(None)[0]).limits
for phase in ForcePhase:
    told = left.collisions(phase)
    print(f"{phase.name:<8} pad {told.collision_forces[0]:.0f} N, joint 1 {told.collision_torques[0]:.0f} Nm")


def swing(arm):
    """Swing the pad against the box with joint 1, for a second. Returns how it ended."""
    try:
        for tick in range(1000):
            arm.write(min(tick / 200, 1.0) * -6.0 * np.eye(7)[0] - 4.0 * arm.read().dq)
    except CommandRejected as reflex:
        return f"stopped after {tick} ms: {', '.join(reflex.errors)}"
    return "pushed the box, and went on"


with serve_arms() as served, closing(FciArm(served.left)) as arm:
    for newtons in (10.0, 65.0):
        arm.set_collisions(replace(CollisionBehaviour(), collision_forces=(newtons,) * 6))
        print(f"at {newtons:.0f} N: {swing(arm)}")
        arm.recover()
