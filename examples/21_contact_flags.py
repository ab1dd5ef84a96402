"""Contact flags and the external wrench, in simulation as on the robot: the left pad swings against the box.

`cartesian_contact` and `joint_contact` are set where a filtered estimate exceeds the contact thresholds. The wrench is
positive where the robot pushes its environment, along the axes of its base.
"""

import numpy as np
import pylibfranka

from rtstack.testing import serve_arms

TOUCH = [5.0] * 6  # N and Nm: from here on it is a contact

with serve_arms() as served:
    robot = pylibfranka.Robot(served.left, pylibfranka.RealtimeConfig.kIgnore)
    robot.set_collision_behavior([20.0] * 7, [100.0] * 7, TOUCH, [200.0] * 6)
    control = robot.start_torque_control()
    forces, flags = [], []
    for tick in range(1000):
        state, _ = control.readOnce()
        forces.append(state.O_F_ext_hat_K[:3])
        flags.append(any(state.cartesian_contact))
        push = min(tick / 200, 1.0) * -6.0 * np.eye(7)[0]  # joint 1 leads the pad to the box
        control.writeOnce(pylibfranka.Torques((push - 4.0 * np.array(state.dq)).tolist()))
    robot.stop()

size = np.linalg.norm(forces, axis=1)
print(f"contact from {flags.index(True)} ms on, for {sum(flags)} ms")
print(f"at most {size.max():.0f} N, at {size.argmax()} ms, along {np.round(forces[size.argmax()], 1)}")
