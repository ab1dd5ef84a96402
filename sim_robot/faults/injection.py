"""A script of faults at work in one simulated cell. The cell calls it at four places of each millisecond."""

from itertools import chain

import numpy as np
from numpy.typing import NDArray

from hal.robot_errors import error_bit
from hal.state import RobotMode
from hal.tracker import ObjectPose
from sim_robot.arm_description import JOINTS
from sim_robot.control_box import ControlBox
from sim_robot.faults import kinds
from sim_robot.faults.kinds import FrictionChange, JointPush, ObjectLost, ObjectMass, Push, Slip, TauSensorBias
from sim_robot.faults.schedule import Schedule
from sim_robot.plant import Plant
from sim_robot.tracker import SimulatedTracker


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
        return bool(((pairs == self._object).any(axis=1) & np.isin(pairs, list(chain(*self._pads))).any(axis=1)).any())

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


BASE_READING = error_bit("base_acceleration_invalid_reading")
BASE_START = error_bit("base_acceleration_initialization_timeout")
_STEADY = 1.0  # m/s^2: more than this beside gravity is no base at rest. The vendor publishes no number.


class FaultyTracker:
    """A simulated tracker as it is seen through faults: without new frames, or with the last pose at new times."""

    def __init__(self, inner: SimulatedTracker, faults: "Injection") -> None:
        self._inner, self._faults = inner, faults
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        self._frame_t_ns = -1

    def update(self) -> None:
        self._inner.update()
        new = self._inner.latest()
        if new.t_ns == self._frame_t_ns:
            return
        self._frame_t_ns = new.t_ns
        effects = self._faults.schedule.effects
        if effects(kinds.TrackerLost, 0):
            return
        if effects(kinds.TrackerFrozen, 0) and self._seen.record["seen"][0]:
            self._seen.record["t_ns"] = new.record["t_ns"]
        else:
            self._seen.record[:] = new.record

    def latest(self) -> ObjectPose:
        self._given.record[:] = self._seen.record
        return self._given


class Injection:
    """Carries out the faults of the plant, of the robot and of the tracker; those of the link are `link`'s."""

    def __init__(
        self, faults: tuple[kinds.ScriptedFault, ...], plant: Plant, boxes: tuple[ControlBox, ...], empty: bool = False
    ) -> None:
        """empty: the cell has no object, from the start."""
        self.schedule = Schedule(faults)
        self.plant = PlantFaults(plant, self.schedule, empty)
        self._boxes = boxes
        self._left_in: list[RobotMode | None] = [None] * len(boxes)  # the mode that a fault has left the arm in
        self._frozen: list[np.ndarray | None] = [None] * len(boxes)

    def begin_millisecond(self) -> None:
        """Begin what is due, after the boxes have begun the ms and before the plant goes on."""
        contact = self.schedule.awaits_contact and self.plant.pad_touches_object()
        if self.schedule.begin_millisecond(any(box.mode == RobotMode.MOVE for box in self._boxes), contact):
            self.plant.change()

    def pass_still_millisecond(self) -> None:
        """Let 1 ms pass for a plant that stands still, as between two motions in lockstep."""
        if self.schedule.pass_still_millisecond():
            self.plant.change()
            self.judge()

    def judge(self) -> None:
        for side, box in enumerate(self._boxes):
            causes = self.causes(side)
            began = any(isinstance(fault.effect, kinds.Reflex) and side in fault.sides for fault in self.schedule.begun)
            if causes and (box.mode == RobotMode.MOVE or (began and box.mode == RobotMode.IDLE)):
                box.trip(causes)
            mode = self.mode(side)
            if mode is not None:
                if box.mode != mode:
                    box.stop()
                    box.mode = mode
            elif self._left_in[side] == box.mode:
                # released: what was latched before is still there. What Desk has done stays
                box.mode = RobotMode.REFLEX if box.errors else RobotMode.IDLE
            self._left_in[side] = mode

    def mode(self, side: int) -> RobotMode | None:
        """Return the mode that a person has left this arm in, None where it obeys."""
        if self.schedule.effects(kinds.UserStop, side):
            return RobotMode.USER_STOPPED
        return next((effect.robot_mode for effect in self.schedule.effects(kinds.Mode, side)), None)

    def unsafe(self, side: int) -> bool:
        """Whether a safety function is what makes this arm refuse."""
        return any(effect.unsafe for effect in self.schedule.effects(kinds.Mode, side))

    def off(self, side: int) -> bool:
        return any(effect.state == "fci_off" for effect in self.schedule.effects(kinds.Mode, side))

    def causes(self, side: int) -> int:
        """Return the mask of errors whose cause persists by a fault."""
        mask = 0
        for effect in self.schedule.effects(kinds.Reflex, side):
            mask |= error_bit(effect.error)
        if np.linalg.norm(self.base_shaken(side)) > _STEADY:
            mask |= BASE_READING
        return mask

    def base_shaken(self, side: int) -> np.ndarray:
        """Return what is added to the reading of gravity in the arm's base, (3,) m/s^2."""
        shaken = self.schedule.effects(kinds.BaseShaken, side)
        return np.sum([(0.0, 0.0, 0.0), *(effect.acceleration for effect in shaken)], axis=0)

    def distort(self, side: int, state: np.ndarray, time: str, millisecond: int) -> None:
        """Make of this arm's state, (1,), what the faults show. time: its stamp's field, of which a ms has
        `millisecond`."""
        self._freeze(side, state, time)
        for effect in self.schedule.effects(kinds.StateNan, side):
            state[effect.field] = np.nan
        for effect in self.schedule.effects(kinds.TimeBack, side):
            state[time] -= min(round(effect.back_ms) * millisecond, int(state[time][0]))

    def _freeze(self, side: int, state: np.ndarray, time: str) -> None:
        """Repeat the first state of this arm that was shown since it froze, but for the field `time`."""
        if not self.schedule.effects(kinds.StateFrozen, side):
            self._frozen[side] = None
            return
        frozen = self._frozen[side]
        if frozen is None:
            self._frozen[side] = state.copy()
            return
        now = state[time].copy()
        state[:] = frozen
        state[time] = now
