"""What an arm is told before it moves: what it carries, where its end effector is, how hard it may touch."""

from collections.abc import Sequence

import numpy as np
import pylibfranka as franka

from hal.base.arrays import Array
from hal.errors import HardwareError
from hal.limits import CollisionBehaviour
from hal.pad import Pad

_EXACT = 1e-6  # m: closer than this a frame of the robot (float32 on the wire) is the one that was asked for
# what the box holds an arm with before and after torque control, Nm/rad: libfranka's setDefaultBehavior
# (examples_common.cpp). Who used the robot last may have left another one
_JOINT_IMPEDANCE = [3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0]
_MASS_TOLERANCE_KG = 1e-3
_MOMENT_TOLERANCE_KGM = 0.01  # ours: of the centre of mass, 0.1 Nm of its weight


def tell_collisions(robot: franka.Robot, collisions: CollisionBehaviour) -> None:
    """Tell an idle robot its thresholds. Raises what pylibfranka raises."""
    robot.set_collision_behavior(
        collisions.contact_torques, collisions.collision_torques, collisions.contact_forces, collisions.collision_forces
    )


def configure(robot: franka.Robot, tool: Pad | None, collisions: CollisionBehaviour) -> None:
    """Tell an idle robot its thresholds and, unless it is None, its tool. Raises HardwareError, and pylibfranka's.

    The tool's outer face becomes the end effector, and the stiffness frame K. The robot may know the tool already (as
    the end effector set in Desk), or nothing of it: then it is a load.
    """
    tell_collisions(robot, collisions)
    robot.set_joint_impedance(_JOINT_IMPEDANCE)
    if tool is None:
        return
    state = robot.read_once()
    told = abs(state.m_ee - tool.mass) < _MASS_TOLERANCE_KG
    if not told and state.m_ee >= _MASS_TOLERANCE_KG:
        raise HardwareError(
            f"Desk has an end effector of {state.m_ee:.3f} kg, the tool weighs {tool.mass:.3f} kg: "
            "set the tool in Desk, or no end effector"
        )
    if told and tool.mass * np.linalg.norm(np.array(state.F_x_Cee) - tool.F_x_centre) > _MOMENT_TOLERANCE_KGM:
        raise HardwareError(
            f"Desk has the end effector's centre of mass at {_mm(state.F_x_Cee)} mm of the flange, the tool's is at "
            f"{_mm(tool.F_x_centre)} mm: set the tool in Desk as the cell's file has it"
        )
    NE_T_EE = np.linalg.inv(np.reshape(state.F_T_NE, (4, 4)).T) @ tool.F_T_face
    if np.abs(NE_T_EE - np.eye(4)).max() < _EXACT:
        NE_T_EE = np.eye(4)
    robot.set_EE(_wire(NE_T_EE))
    robot.set_K(_wire(np.eye(4)))
    if told:
        robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
    else:
        robot.set_load(tool.mass, tool.F_x_centre.tolist(), tool.I_centre.T.ravel().tolist())


def _mm(place: Sequence[float] | Array) -> str:
    return ", ".join(f"{1e3 * metres:.0f}" for metres in place)


def _wire(T: Array) -> list[float]:
    """16 numbers, column-major."""
    return T.T.ravel().tolist()
