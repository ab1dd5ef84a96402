"""Rigid-body model of one arm, by Pinocchio, in the world frame and without allocation in `update`."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hal.base.arrays import Array
from hal.compilation import bound, compiled
from hal.pad import Pad
from hal.robots import RobotModel
from hal.robots.description import FLANGE
from rtstack.model.cell_description import ArmMounting, base_frame


@cache
def _flange_model(robot: RobotModel) -> pin.Model:
    return pin.buildModelFromXML(robot.urdf)


def flange_pose(robot: RobotModel, q: Array) -> Array:
    """Return T_base_flange (4, 4), row-major, m, of a robot at q (7,), rad."""
    model = _flange_model(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.asarray(q, dtype=float))
    return data.oMf[model.getFrameId(FLANGE)].homogeneous.copy()


def build_model(mounting: ArmMounting, pad: Pad) -> pin.Model:
    """Return the Pinocchio model of an arm on its base, with its own pad, or this one, fixed to the flange."""
    model = pin.Model(_flange_model(mounting.robot))
    frame = base_frame(mounting)
    model.jointPlacements[1] = pin.SE3(frame.rotation, frame.translation) * model.jointPlacements[1]
    flange = model.frames[model.getFrameId(FLANGE)]
    pad = mounting.pad or pad
    inertia, at = pin.Inertia.FromBox(pad.mass, *pad.size), flange.placement * pin.SE3(pad.F_T_box)
    if pad.centre is not None or pad.inertia is not None:
        inertia, at = pin.Inertia(pad.mass, pad.F_x_centre, pad.I_centre), flange.placement
    model.appendBodyToJoint(flange.parentJoint, inertia, at)
    return model


def face_placement(mounting: ArmMounting, pad: Pad, model: pin.Model) -> pin.SE3:
    """Return the frame of the face of an arm's own pad, or of this one, in the frame of its last joint."""
    flange = model.frames[model.getFrameId(FLANGE)]
    return flange.placement * pin.SE3((mounting.pad or pad).F_T_face)


class ModelArrays(NamedTuple):
    """What compiled code reads of an ArmModel, by the names of its attributes."""

    M: Array
    C: Array
    g: Array
    J0: Array
    dJ0: Array
    R7: Array
    p7: Array


@compiled
def mass_and_gravity(J0, momenta, acceleration, M, g):
    """Write M (7, 7), symmetric, and g (7,) of a chain: M_ij = J_i^T h_j for i <= j, g_j = -a^T h_j.

    momenta (6, 7): h_j = Y_j J_j, the momentum, about the world's origin, of all links from joint j on where j alone
    moves, at 1 rad/s; Y_j is their inertia: the composite rigid bodies of Featherstone, RBDA, 6.2. acceleration (3,):
    a, of gravity, m/s^2.
    """
    for j in range(7):
        g[j] = -(acceleration[0] * momenta[0, j] + acceleration[1] * momenta[1, j] + acceleration[2] * momenta[2, j])
        for i in range(j + 1):
            s = 0.0
            for k in range(6):
                s += J0[k, i] * momenta[k, j]
            M[i, j] = s
            M[j, i] = s


class ArmModel:
    """Dynamics of one arm at its last `update`. Most arrays are views of Pinocchio's memory: read them, never write.

    M (7, 7) mass matrix of the links, C (7, 7) Coriolis matrix, g (7,) gravity torque, J0 and dJ0
    (6, 7) Jacobian and its time derivative at the world's origin along the world's axes (linear first), R7 (3, 3)
    and p7 (3,) pose of the last joint, face (3,) and R_joint_ee (3, 3) the pad's face in the last joint's frame.

    pad: of the cell, which counts where the arm has none of its own.
    """

    def __init__(self, mounting: ArmMounting, pad: Pad) -> None:
        self.robot = mounting.robot
        self.pin_model = build_model(mounting, pad)
        self._data = self.pin_model.createData()
        frame = base_frame(mounting)
        self.T_world_base = np.eye(4)
        self.T_world_base[:3, :3] = frame.rotation
        self.T_world_base[:3, 3] = frame.translation
        face = face_placement(mounting, pad, self.pin_model)
        self.face: Array = face.translation.copy()
        self.R_joint_ee: Array = np.ascontiguousarray(face.rotation)
        self.M: Array = np.zeros((7, 7))
        self.g: Array = np.zeros(7)
        self.C: Array = self._data.C
        self.J0: Array = self._data.J
        self.dJ0: Array = self._data.dJ
        self.R7: Array = self._data.oMi[7].rotation
        self.p7: Array = self._data.oMi[7].translation
        gravity = self.pin_model.gravity.linear.copy()
        self._mass_and_gravity = bound(mass_and_gravity, self.J0, self._data.Ag, gravity, self.M, self.g)
        home = np.array(mounting.home)
        self.update(home, np.zeros(7))
        M = pin.crba(self.pin_model, self.pin_model.createData(), home, pin.Convention.WORLD)
        if not np.allclose(np.triu(self.M), np.triu(M), rtol=0.0, atol=1e-9):  # the momenta are nowhere promised
            raise RuntimeError(
                f"Pinocchio {pin.__version__} leaves no momenta in Ag: install the one of constraints.txt"
            )

    @property
    def arrays(self) -> ModelArrays:
        return ModelArrays(self.M, self.C, self.g, self.J0, self.dJ0, self.R7, self.p7)

    def joint_placement(self, joint: int) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,), m, of a joint's frame in the world, joint 1 to 7; both follow
        `update`."""
        return self._data.oMi[joint].rotation, self._data.oMi[joint].translation

    def update(self, q: Array, dq: Array) -> None:
        """Compute everything at q (7,) rad and dq (7,) rad/s."""
        # C, J, dJ, the joints' placements, and in Ag the momenta of which M and g are one product each: Pinocchio's
        # own calls for them would go through the links again
        pin.computeCoriolisMatrix(self.pin_model, self._data, q, dq)
        self._mass_and_gravity()
