"""Faults of the physical cell: forces, friction, the object, what the torque sensors feel. They change one plant."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim_robot.arm_description import JOINTS
from sim_robot.faults.kinds import FrictionChange, JointPush, ObjectLost, ObjectMass, Push, Slip, TauSensorBias
from sim_robot.faults.schedule import Schedule
from sim_robot.model import SIDES
from sim_robot.plant import Plant

# far from everything that collides, beyond what motion capture could see: m along the world's x
AWAY_M = 10.0


class PlantFaults:
    """Carries out what a schedule says about a plant. While a push is active, no other pad force can be applied."""

    def __init__(self, plant: Plant, schedule: Schedule, empty: bool = False) -> None:
        """empty: the object was never there."""
        self._plant, self._schedule, self._empty = plant, schedule, empty
        model = plant.model
        ends = [plant.finger_bodies[side] or (plant.pad_bodies[side],) for side in range(len(SIDES))]
        # each arm's geoms that hold an object: a pad, or a hand's two fingers
        self._pads = [[int(model.body_geomadr[body]) for body in bodies] for bodies in ends]
        self._object = model.geom("object").id
        self._body = model.body("object").id
        self._mass, self._inertia = float(model.body_mass[self._body]), model.body_inertia[self._body].copy()
        self._jacobian = np.zeros((3, model.nv))
        self._pad_friction = [model.geom_friction[geoms, 0].copy() for geoms in self._pads]
        self._joints = plant.joints.copy()
        self._pushes = [np.zeros(3) for _ in SIDES]
        self._joint_pushes = [np.zeros(JOINTS) for _ in SIDES]
        self._pushed = False
        self._biases = np.zeros((2, JOINTS))
        self._biased, self.object_lost = False, empty
        self._true = {name: plant.motors[name].copy() for name in ("tau_J", "tau_ext")}

    def pad_touches_object(self) -> bool:
        """True while a pad touches the object."""
        data = self._plant.data
        if not data.ncon:
            return False
        pairs = data.contact.geom
        return bool(
            np.any((pairs == self._object).any(axis=1) & np.isin(pairs, [*self._pads[0], *self._pads[1]]).any(axis=1))
        )

    def change(self) -> None:
        """Take over what the schedule now says."""
        effects, plant = self._schedule.effects, self._plant
        for side in range(2):
            self._pushes[side] = _total((effect.force_N for effect in effects(Push, side)), 3)
            self._joint_pushes[side] = _total((effect.torque_Nm for effect in effects(JointPush, side)), JOINTS)
            self._biases[side] = _total((effect.bias_Nm for effect in effects(TauSensorBias, side)), JOINTS)
            grip = np.prod([effect.friction_factor for effect in effects(Slip, side)])
            plant.model.geom_friction[self._pads[side], 0] = grip * self._pad_friction[side]
            friction = np.prod([effect.friction_factor for effect in effects(FrictionChange, side)])
            joint, nominal = plant.joints[side], self._joints[side]
            joint["friction_p1"] = friction * nominal["friction_p1"]
            # the torque loop feeds the measured torque back: B_theta ddtheta = ... + (B_theta / B - 1) bias, which
            # is as good as a constant friction torque
            heeded = (nominal["B_theta"] / nominal["B"] - 1.0) * self._biases[side]
            joint["friction_offset"] = friction * nominal["friction_offset"] + heeded
        # the contacts stay as they were compiled: stiffness and damping in N/m and Ns/m are of the surfaces
        mass = np.prod([effect.mass_factor for effect in effects(ObjectMass, 0)])
        plant.model.body_mass[self._body], plant.model.body_inertia[self._body] = (
            mass * self._mass,
            mass * self._inertia,
        )
        self._biased = bool(self._biases.any())
        self.object_lost = self._empty or bool(effects(ObjectLost, 0))

    def begin_millisecond(self) -> None:
        """Push, and keep the object away, for the next ms of the plant."""
        if self.object_lost:
            position, velocity = self._plant.data.qpos[2 * JOINTS :], self._plant.data.qvel[2 * JOINTS :]
            position[:3], velocity[:] = (AWAY_M, 0.0, 0.0), 0.0
        pushed = any(push.any() for push in (*self._pushes, *self._joint_pushes))
        if pushed or self._pushed:
            for side in range(2):
                self._push(side)
        self._pushed = pushed

    def _push(self, side: int) -> None:
        data, body = self._plant.data, self._plant.pad_bodies[side]
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ self._plant.face_in_pad[side]
        mujoco.mj_jac(self._plant.model, data, self._jacobian, None, point, body)
        dofs = slice(JOINTS * side, JOINTS * (side + 1))
        motor = self._plant.motors[side]
        motor["tau_applied"] = self._jacobian[:, dofs].T @ self._pushes[side] + self._joint_pushes[side]

    def mislead_sensors(self) -> None:
        """Let the sensors measure the biased torques, until `enlighten_sensors`."""
        if self._biased:
            for name, true in self._true.items():
                true[:] = self._plant.motors[name]
                self._plant.motors[name] += self._biases

    def enlighten_sensors(self) -> None:
        """Give the plant its true torques back."""
        if self._biased:
            for name, true in self._true.items():
                self._plant.motors[name] = true


def _total(values, size: int) -> NDArray[np.float64]:
    return sum((np.array(value) for value in values), np.zeros(size))
