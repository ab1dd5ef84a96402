"""Serves one arm of franka-sim, in that package's own environment: ADDRESS ASSETS FOLDER SLOWNESS.

Its checks of motions and of lost packets are on. Its own arm model would be downloaded: it gets franky-sim's (ASSETS),
whose MJCF is made to find its meshes. SLOWNESS stretches the time that it lives by: how many milliseconds one of its
robot's takes.
"""

import os
import sys
import time
from pathlib import Path

address, assets, folder, slowness = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4])
perf_counter, wall, sleep = time.perf_counter, time.time, time.sleep
time.perf_counter = lambda: perf_counter() / slowness
time.time = lambda: wall() / slowness
time.sleep = lambda seconds: sleep(seconds * slowness)

model = folder / "fr3.xml"
model.write_text((assets / "fr3.xml").read_text().replace('meshdir="assets"', f'meshdir="{assets / "meshes"}"'))
os.environ["FR3_MJCF"] = str(model)

from franka_sim.franka_sim_server import FrankaSimServer  # noqa: E402 (it takes the time from the module)

FrankaSimServer(
    host=address, enable_gripper=False, physics="mujoco", enforce_comm_constraints=True, enforce_motion_limits=True
).start()
