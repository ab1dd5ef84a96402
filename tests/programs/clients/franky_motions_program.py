"""Every kind of motion that franky-control offers, as its own examples do it. Prints a line for each that went well.

The Cartesian ones run at a fifth of its dynamics: its limits are the FER's, and at full speed the joints that follow a
pose would need more than an FR3's accelerations.
"""

import contextlib
import sys
import time
from collections.abc import Callable

import franky
import numpy as np

UP = 0.1 * np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])


class Program:
    """One robot; each public method is one program."""

    def __init__(self, address: str) -> None:
        self.robot = franky.Robot(address, realtime_config=franky.RealtimeConfig.Ignore)
        self.robot.recover_from_errors()
        self.robot.relative_dynamics_factor = 0.2
        self.home = np.array(self.robot.current_joint_state.position) + UP

    def at_home(self) -> None:
        self.robot.move(franky.JointMotion(list(self.home)))
        assert np.abs(np.array(self.robot.current_joint_state.position) - self.home).max() < 3e-3

    def joints_at_full_speed(self) -> None:
        self.robot.relative_dynamics_factor = 1.0
        away, further = self.home + 3 * UP, self.home + 2 * UP
        self.robot.move(franky.JointWaypointMotion([franky.JointWaypoint(list(way)) for way in (away, further)]))
        self.robot.move(franky.JointMotion(list(self.home)))
        self.robot.relative_dynamics_factor = 0.2

    def joint_velocities(self) -> None:
        self.robot.move(franky.JointVelocityMotion(list(UP), duration=franky.Duration(300)))
        self.robot.move(franky.JointVelocityStopMotion())

    def poses(self) -> None:
        pose = self.robot.current_cartesian_state.pose.end_effector_pose
        relative = franky.ReferenceType.Relative
        self.robot.move(franky.CartesianMotion(franky.Affine([0.05, 0.0, 0.0]), relative))
        self.robot.move(franky.CartesianMotion(franky.Affine(pose.translation + [0.0, 0.02, 0.05], pose.quaternion)))
        self.robot.move(franky.CartesianMotion(pose))
        arrived = self.robot.current_cartesian_state.pose.end_effector_pose
        assert np.linalg.norm(arrived.translation - pose.translation) < 3e-3

    def elbow(self) -> None:
        pose = self.robot.current_cartesian_state.pose
        assert pose.elbow_state is not None
        joint_3 = pose.elbow_state.joint_3_pos + 0.1
        self.robot.move(franky.CartesianMotion(franky.RobotPose(pose.end_effector_pose, franky.ElbowState(joint_3))))
        assert abs(self.robot.current_joint_state.position[2] - joint_3) < 3e-3

    def twists(self) -> None:
        twist = franky.Twist([0.05, -0.02, 0.05], [0.1, 0.0, 0.1])
        self.robot.move(franky.CartesianVelocityMotion(twist, duration=franky.Duration(300)))
        self.robot.move(franky.CartesianVelocityStopMotion())

    def reaction(self) -> None:
        fired = []
        motion = franky.CartesianMotion(franky.Affine([0.0, 0.0, -0.05]), franky.ReferenceType.Relative)
        stop = franky.CartesianPoseReaction(franky.Measure.FORCE_Z > -100.0, franky.CartesianStopMotion())
        stop.register_callback(lambda *_: fired.append(1))
        motion.add_reaction(stop)
        self.robot.move(motion)
        assert fired

    def preempted(self) -> None:
        self.robot.move(franky.JointMotion(list(self.home + UP)), asynchronous=True)
        time.sleep(0.02)
        self.robot.move(franky.JointMotion(list(self.home)), asynchronous=True)
        self.robot.join_motion()

    def torques(self) -> None:
        pose = self.robot.current_cartesian_state.pose.end_effector_pose
        simple = franky.SimpleTorqueMotion()
        for motion in (franky.CartesianImpedanceMotion(pose), franky.JointImpedanceMotion(list(self.home)), simple):
            self.robot.move(motion, asynchronous=True)
            for _ in range(20):
                simple.set_torque([0.0] * 7)
                time.sleep(0.005)
            self.robot.move(franky.TorqueStopMotion())
            self.robot.join_motion()

    def error_and_recovery(self) -> None:
        with contextlib.suppress(franky.ControlException):
            self.robot.move(franky.JointMotion([*self.home[:6], 3.1]))  # beyond joint 7
        assert self.robot.has_errors
        self.robot.recover_from_errors()


def main(address: str) -> None:
    """Run them all on the arm at this address; back home after each."""
    program = Program(address)
    names = [name for name in vars(Program) if not name.startswith("_")]
    for name in names:
        run: Callable[[], None] = getattr(program, name)
        run()
        program.at_home()
        print(name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
