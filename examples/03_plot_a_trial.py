"""Draw what both pads felt, and how hard the controller pushed, into `trial.png`."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rtstack.log.reader import read_log
from rtstack.samples import SIDES, Mode

log = read_log(Path("trial.mcap"))
figure = Figure((8.0, 5.0), layout="constrained")
force, effort = figure.subplots(2, 1, sharex=True)

for side in SIDES:
    arm = log.topic(f"/{side}/arm")
    t_s = (arm["t_ns"] - log.start_ns) * 1e-9
    # O_F_ext_hat_K: what the robot does to its environment, force first
    force.plot(t_s, np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1), label=f"{side} pad")
force.set_ylabel("force, N")
force.legend()

control = log.topic("/left/control")
t_s = (control["t_ns"] - log.start_ns) * 1e-9
effort.plot(t_s, control["force_norm"], color="k")  # (33), over both arms
effort.fill_between(t_s, 0.0, control["force_norm"].max(), control["mode"] == Mode.INTERIM, color="gold", alpha=0.5)
effort.set_ylabel("norm of the wanted wrenches")
effort.set_xlabel("time, s (gold: interim mode)")

figure.savefig("trial.png", dpi=120)
print("wrote trial.png")
