"""Payload: the robot is told what the arm carries, and its gravity compensation lifts that. A wrong number shows.

In a cell's file it is `[pad]`, or `[left.pad]`; rtstack tells it to the robots when it connects. `rtstack check` holds
an arm and says how many kilograms are missing.
"""

import numpy as np
import pylibfranka

from rtstack.testing import serve_arms

INERTIA = np.diag([1e-3] * 3).ravel().tolist()  # kg m^2, column-major
CENTRE = [0.0, 0.0, 0.05]  # m, in the flange's frame

with serve_arms() as served:
    robot = pylibfranka.Robot(served.left, pylibfranka.RealtimeConfig.kIgnore)
    for mass in (0.0, 0.5):  # the simulated arm carries its pad, and nothing else
        robot.set_load(mass, CENTRE, INERTIA)
        start = robot.read_once().O_T_EE[14]
        control = robot.start_torque_control()
        for _ in range(500):
            state, _ = control.readOnce()
            control.writeOnce(pylibfranka.Torques([-10.0 * dq for dq in state.dq]))
        robot.stop()
        del control  # one at a time
        print(f"told {mass:.1f} kg: the pad went up by {1e3 * (state.O_T_EE[14] - start):+.0f} mm in half a second")
