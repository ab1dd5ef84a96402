"""01 link: both arms answer, show what they should, and belong to one client."""

import numpy as np
import pylibfranka
import pytest

from hal.errors import HardwareError
from hal.fci import FciArm
from hal.state import RobotMode
from rtstack.model.arm_model import ArmModel

STATES = 300
NEAR_M, NEAR_RAD = 2e-3, 5e-3  # what calibration leaves between a real arm and the published geometry


def test_both_arms_stream_states(robot, record_property) -> None:
    pair = robot.pair()
    try:
        for side, arm in (("left", pair.left), ("right", pair.right)):
            t_ns = []
            for _ in range(STATES):
                state = arm.read()
                t_ns.append(state.t_ns)
            steps = np.diff(t_ns)
            assert steps.min() > 0
            assert state.robot_mode == RobotMode.IDLE
            assert np.isfinite(state.q).all()
            record_property(f"{side} states missed", int((steps // 1_000_000 - 1).sum()))
    finally:
        pair.close()
    record_property("client", f"libfranka {pylibfranka.__version__}, server version 10")


def test_the_arms_geometry_is_ours(robot, cell, record_property) -> None:
    """The pose of the flange by the robot's own account, and by our model of its joints."""
    pair = robot.pair()
    try:
        for side, arm in (("left", pair.left), ("right", pair.right)):
            mounting = getattr(cell, side)
            model = ArmModel(mounting, cell.pad)
            # the way between two postures of a model is compared, so that whatever is set as end effector cancels
            state = arm.read()
            model.update(np.array(state.q), np.zeros(7))
            ours = np.eye(4)
            ours[:3, :3] = model.R7 @ model.R_joint_ee
            ours[:3, 3] = model.p7 + model.R7 @ model.face
            theirs = model.T_world_base @ state.O_T_EE
            distance = float(np.linalg.norm(ours[:3, 3] - theirs[:3, 3]))
            turn = float(np.arccos(np.clip((np.trace(ours[:3, :3].T @ theirs[:3, :3]) - 1) / 2, -1, 1)))
            record_property(f"{side} mm", 1e3 * distance)
            assert distance < NEAR_M
            assert turn < NEAR_RAD
    finally:
        pair.close()


def test_an_arm_has_one_client(robot) -> None:
    first = FciArm(robot.left)
    try:
        with pytest.raises(HardwareError):
            FciArm(robot.left)
        assert first.read().robot_mode == RobotMode.IDLE  # and the first one keeps it
    finally:
        first.close()
    FciArm(robot.left).close()
