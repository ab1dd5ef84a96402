"""What an arm is told before it moves: what it carries, where its end effector is, how hard it may touch."""

from collections.abc import Sequence

import numpy as np
import pylibfranka as franka

from hal.base.arrays import Array
from hal.errors import HardwareError
from hal.limits import CollisionBehaviour
from hal.pad import Pad

_EXACT = 1e-6  # m: closer than this a frame of the robot (float32 on the wire) is the one that was asked for
# what a robot reports of a setting: float32, and F_T_EE is its product of two transforms
_SAME = 1e-5
_LOOKS = 50  # states, 50 ms, until a setting shows: they are sent beside the answer to a request
# what the box holds an arm with before and after torque control, Nm/rad: libfranka's setDefaultBehavior
# (examples_common.cpp). Who used the robot last may have left another one
_JOINT_IMPEDANCE = [3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0]
_MASS_TOLERANCE_KG = 1e-3
_MOMENT_TOLERANCE_KGM = 0.01  # ours: of the centre of mass, 0.1 Nm of its weight


def tell_collisions(robot: franka.Robot, collisions: CollisionBehaviour) -> None:
    """Tell an idle robot its thresholds. Raises what pylibfranka raises."""
    c = collisions
    robot.set_collision_behavior(c.contact_torques, c.collision_torques, c.contact_forces, c.collision_forces)


def configure(robot: franka.Robot, tool: Pad | None, collisions: CollisionBehaviour, called: str) -> None:
    """Set an idle robot's thresholds and, unless it is None, its tool, and read the tool back.

    The tool's outer face becomes the end effector, and the stiffness frame K. Where Desk does not know it as the end
    effector it is a load. Frames, masses and the load's centre are compared with the state, as what an earlier client
    has set must not remain; thresholds and joint impedance cannot be read back. called: the arm in messages. Raises
    HardwareError where Desk has another tool, or the robot does not report what was set; and pylibfranka's.
    """
    tell_collisions(robot, collisions)
    robot.set_joint_impedance(_JOINT_IMPEDANCE)
    if tool is None:
        return
    state = robot.read_once()
    told = abs(state.m_ee - tool.mass) < _MASS_TOLERANCE_KG
    if not told and state.m_ee >= _MASS_TOLERANCE_KG:
        raise HardwareError(
            f"{called}: Desk has an end effector of {state.m_ee:.3f} kg, the tool weighs {tool.mass:.3f} kg: "
            "set the tool in Desk, or no end effector"
        )
    if told and tool.mass * np.linalg.norm(np.array(state.F_x_Cee) - tool.F_x_centre) > _MOMENT_TOLERANCE_KGM:
        raise HardwareError(
            f"{called}: Desk has the end effector's centre of mass at {_mm(state.F_x_Cee)} mm of the flange, the "
            f"tool's is at {_mm(tool.F_x_centre)} mm: set the tool in Desk as the cell's file has it"
        )
    NE_T_EE = np.linalg.inv(np.reshape(state.F_T_NE, (4, 4)).T) @ tool.F_T_face
    if np.abs(NE_T_EE - np.eye(4)).max() < _EXACT:
        NE_T_EE = np.eye(4)
    robot.set_EE(_wire(NE_T_EE))
    robot.set_K(_wire(np.eye(4)))
    load = (0.0, [0.0] * 3, [0.0] * 9)
    if not told:
        load = (tool.mass, tool.F_x_centre.tolist(), tool.I_centre.T.ravel().tolist())
    robot.set_load(*load)
    wanted = {"F_T_EE": _wire(tool.F_T_face), "EE_T_K": _wire(np.eye(4)), "m_ee": state.m_ee, "m_load": load[0]}
    wanted |= {} if told else {"F_x_Cload": load[1]}
    differs = []
    for _ in range(_LOOKS):
        state = robot.read_once()
        differs = [name for name in wanted if not np.allclose(getattr(state, name), wanted[name], rtol=0.0, atol=_SAME)]
        if not differs:
            return
    reported, was_set = (
        np.array2string(np.asarray(each), precision=4, suppress_small=True, max_line_width=1000)
        for each in (getattr(state, differs[0]), wanted[differs[0]])
    )
    raise HardwareError(
        f"{called} reports {differs[0]} as {reported}, it was set to {was_set}: what an earlier client has set "
        "may still hold; restart the control box, then connect again"
    )


def _mm(place: Sequence[float] | Array) -> str:
    return ", ".join(f"{1e3 * metres:.0f}" for metres in place)


def _wire(T: Array) -> list[float]:
    """16 numbers, column-major."""
    return T.T.ravel().tolist()
