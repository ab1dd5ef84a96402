"""A robot without the robot: the simulated arm at 1 kHz, driven by the vendor's own client, pylibfranka.

The server says how well it kept real time when it ends (on stderr). In lockstep, which is the default here, it waits
for each answer instead: then the outcome does not depend on the machine.
"""

import numpy as np
import pylibfranka

from rtstack.testing import serve_arms

with serve_arms() as served:
    robot = pylibfranka.Robot(served.left, pylibfranka.RealtimeConfig.kIgnore)
    start = np.array(robot.read_once().q)
    control = robot.start_torque_control()
    for tick in range(1000):
        state, _ = control.readOnce()
        goal = start + 0.1 * (0.5 - 0.5 * np.cos(np.pi * min(tick / 800, 1.0))) * np.eye(7)[3]  # 0.1 rad at joint 4
        tau = 200.0 * (goal - state.q) - 20.0 * np.array(state.dq)
        control.writeOnce(pylibfranka.Torques(tau.tolist()))
    robot.stop()
    print(f"joint 4 moved by {np.array(robot.read_once().q)[3] - start[3]:.3f} rad")

with serve_arms(lockstep=False) as served:
    robot = pylibfranka.Robot(served.left, pylibfranka.RealtimeConfig.kIgnore)
    times_s = [robot.read_once().time.to_sec() for _ in range(300)]
    print(f"in real time: {times_s[-1] - times_s[0]:.3f} s of the robot passed in {len(times_s)} states")
