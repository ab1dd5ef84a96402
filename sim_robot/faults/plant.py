"""Faults of the physical cell: forces, friction, the object, what the torque sensors feel. They change one plant."""

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from sim_robot.arm_description import JOINTS
from sim_robot.faults.kinds import FrictionChange, JointPush, ObjectLost, ObjectMass, Push, Slip, TauSensorBias
from sim_robot.faults.schedule import Schedule
from sim_robot.plant import Plant


class PlantFaults:
    """Carries out what a schedule says about a plant. While one pushes an arm, nothing else can."""

    def __init__(self, plant: Plant, schedule: Schedule, empty: bool = False) -> None:
        """empty: the object was never there."""
        self._plant, self._schedule = plant, schedule
        model = plant.model
        ends = [fingers or (pad,) for fingers, pad in zip(plant.finger_bodies, plant.pad_bodies, strict=True)]
        # each arm's geoms that hold an object: a pad, or a hand's two fingers
        self._pads = [[int(model.body_geomadr[body]) for body in bodies] for bodies in ends]
        self._object = model.geom("object").id
        self._body = model.body("object").id
        self._mass, self._inertia = float(model.body_mass[self._body]), model.body_inertia[self._body].copy()
        self._pad_friction = [model.geom_friction[geoms, 0].copy() for geoms in self._pads]
        self._joints = plant.joints.copy()
        self._pushed = [False] * len(ends)
        self._biases = np.zeros((len(ends), JOINTS))
        self._biased = False
        plant.away = plant.gone = empty
        self._true = {name: plant.motors[name].copy() for name in ("tau_J", "tau_ext")}

    def pad_touches_object(self) -> bool:
        data = self._plant.data
        if not data.ncon:
            return False
        pairs = data.contact.geom
        touching = (pairs == self._object).any(axis=1) & np.isin(pairs, list(chain(*self._pads))).any(axis=1)
        return bool(touching.any())

    def change(self) -> None:
        """Take over what the schedule now says."""
        effects, plant = self._schedule.effects, self._plant
        for side in range(len(self._pads)):
            pushes, joint_pushes = effects(Push, side), effects(JointPush, side)
            if pushes or joint_pushes or self._pushed[side]:
                force = _total((effect.force_N for effect in pushes), 3)
                plant.push(side, force, _total((effect.torque_Nm for effect in joint_pushes), JOINTS))
            self._pushed[side] = bool(pushes or joint_pushes)
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
        plant.model.body_mass[self._body] = mass * self._mass
        plant.model.body_inertia[self._body] = mass * self._inertia
        self._biased = bool(self._biases.any())
        if effects(ObjectLost, 0):
            plant.away = plant.gone = True

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
