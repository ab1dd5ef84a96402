"""Friction: the simulated joints have some that the controller does not know, and it compensates a model of its own.

`rtstack identify-friction` finds the model of your arms, joint by joint. Here the same trial with the model, with which
it was recorded, and without it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import rtstack
from rtstack.cells import load_description
from rtstack.identification.fit import sigmoid
from rtstack.log.reader import read_log
from rtstack.model.cell_description import base_poses

parameters = rtstack.Simulation().parameters
model = parameters.friction[0]
print("at 0.5 rad/s the model says", sigmoid(np.full(7, 0.5), model.p1, model.p2, model.p3).round(2), "Nm")

base = base_poses(load_description(None)[0])[0]
none = tuple(replace(each, p1=np.zeros(7)) for each in parameters.friction)
for name, friction in (("compensated", parameters.friction), ("not compensated", none)):
    log = Path(f"{name.replace(' ', '-')}.mcap")
    rtstack.run_trial("ref.mcap", parameters=replace(parameters, friction=friction), log=log)
    samples = read_log(log)
    wanted = samples.topic("/left/control")["pose_ref"][:1000, :3]  # before the impact, in the world
    pad = samples.topic("/left/arm")["O_T_EE"][:1000, :3, 3] @ base[:3, :3].T + base[:3, 3]
    off_mm = 1e3 * np.linalg.norm(wanted - pad, axis=1)
    print(f"{name}: the left pad is {off_mm.mean():.3f} mm beside its reference")
