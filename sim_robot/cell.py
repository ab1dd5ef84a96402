"""The simulated cell behind hal's contract: one arm or two and a tracker on one plant, in one process.

A read by an arm that has seen the present state advances the plant by 1 ms for all arms: their order does not matter,
and an arm that did not write keeps its last torque. The first reads return the state at t = 0.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import exp, floor, pi, sqrt
from pathlib import Path
from typing import NoReturn

import numpy as np

from hal.base.arrays import Array
from hal.base.configuration import ConfigurationError
from hal.cell import Cell
from hal.compilation import bound, compiled
from hal.displacement import Displacement
from hal.errors import CommandRejected, ConnectionLost, ObjectOutOfReach, RecoveryRefused
from hal.limits import CONTROL_PERIOD_S
from hal.robot_errors import error_names
from hal.state import ARM_STATE, NEEDS_PERSON, ArmState, RobotMode
from sim_robot import reflexes
from sim_robot.arm_description import JOINTS, arm_description
from sim_robot.clock import PacedLockstep
from sim_robot.control_box import ControlBox
from sim_robot.faults.file import refuse_link_faults, tilt_of
from sim_robot.faults.injection import BASE_READING, BASE_START, FaultyTracker, Injection
from sim_robot.faults.kinds import ScriptedFault
from sim_robot.gripper import SimulatedGripper
from sim_robot.hand import Hand
from sim_robot.kinematics import KINEMATICS_RECORD, estimate_wrench, forward_kinematics
from sim_robot.lab_objects import with_lab_objects
from sim_robot.plant import Plant, faces
from sim_robot.plant_parameters import PlantParameters, SensorParameters, load_plant_parameters
from sim_robot.profile import IDEAL, LONGEST_DELAY_MS, SLOW_NOISE_DRAW, load_profile
from sim_robot.scene import NO_OBJECT, Scene, load_scene
from sim_robot.tracker import tracker_of

CHANNELS = 6  # q, dq, theta, dtheta, tau_J, tau_ext
BLOCK = 512  # ms of noise drawn at a time

SENSOR_RECORD = np.dtype(
    [
        ("q_quantum", "f8"),
        ("noise", "f8", (CHANNELS, JOINTS)),  # standard deviations
        ("dtau_J_gain", "f8"),
        ("tau_ext_gain", "f8"),
        ("smallest_singular_value", "f8"),
        ("wrench_damping", "f8"),
        ("tau_J_last", "f8", JOINTS),
        ("dtau_J", "f8", JOINTS),
        ("tau_ext", "f8", JOINTS),  # filtered, before its noise
        ("tau_ext_measured", "f8", JOINTS),
        ("offset", "f8", JOINTS),  # of the estimate, and of its gravity torque a share: sim_robot.profile
        ("gravity_error", "f8", JOINTS),
        ("slow_keep", "f8"),  # of the slow noise from one ms to the next, and what comes anew
        ("slow_fresh", "f8", JOINTS),
        ("slow", "f8", JOINTS),
        ("delay", "i8"),  # ms
        ("newest", "i8"),
        ("past", "f8", (LONGEST_DELAY_MS + 1, JOINTS)),
        ("started", "i8"),
    ]
)


@compiled
def _wire(value):
    return np.float64(np.float32(value))


@compiled
def _sense(qpos, qvel, motors, sensors, kinematics, draws, slow_draws, states, k, t_ns):
    """Fill the measured fields of all states (n,). draws[k] (n, CHANNELS, 7), slow_draws[k] (n, 7): standard normal."""
    for arm in range(states.shape[0]):
        state, sensor, motor, draw = states[arm], sensors[arm], motors[arm], draws[k, arm]
        state.t_ns = t_ns
        noise = sensor.noise
        sensor.newest = (sensor.newest + 1) % (LONGEST_DELAY_MS + 1)
        oldest = (sensor.newest - sensor.delay) % (LONGEST_DELAY_MS + 1)
        for j in range(JOINTS):
            i = arm * JOINTS + j
            q = qpos[i] + noise[0, j] * draw[0, j]
            if sensor.q_quantum > 0.0:
                q = sensor.q_quantum * floor(q / sensor.q_quantum + 0.5)
            tau_J = motor.tau_J[j] + noise[4, j] * draw[4, j]
            if sensor.started != 0:
                rate = (tau_J - sensor.tau_J_last[j]) / CONTROL_PERIOD_S
                sensor.dtau_J[j] += sensor.dtau_J_gain * (rate - sensor.dtau_J[j])
            sensor.tau_J_last[j] = tau_J
            sensor.tau_ext[j] += sensor.tau_ext_gain * (motor.tau_ext[j] - sensor.tau_ext[j])
            sensor.slow[j] = sensor.slow_keep * sensor.slow[j] + sensor.slow_fresh[j] * slow_draws[k, arm, j]
            error = sensor.offset[j] + sensor.gravity_error[j] * motor.tau_gravity[j] + sensor.slow[j]
            sensor.past[sensor.newest, j] = sensor.tau_ext[j] + error
            if sensor.started == 0:
                for ms in range(LONGEST_DELAY_MS + 1):
                    sensor.past[ms, j] = sensor.tau_ext[j] + error
            tau_ext = sensor.past[oldest, j] + noise[5, j] * draw[5, j]
            sensor.tau_ext_measured[j] = tau_ext
            state.q[j] = _wire(q)
            state.dq[j] = _wire(qvel[i] + noise[1, j] * draw[1, j])
            state.theta[j] = _wire(motor.theta[j] + noise[2, j] * draw[2, j])
            state.dtheta[j] = _wire(motor.dtheta[j] + noise[3, j] * draw[3, j])
            state.tau_J[j] = _wire(tau_J)
            state.dtau_J[j] = _wire(sensor.dtau_J[j])
            state.tau_J_d[j] = _wire(motor.tau_desired[j])
            state.tau_ext_hat_filtered[j] = _wire(tau_ext)
        sensor.started = 1
        body = kinematics[arm]
        forward_kinematics(body, state.q)
        estimate_wrench(body, sensor.tau_ext_measured, sensor.smallest_singular_value, sensor.wrench_damping)
        for r in range(6):
            state.O_F_ext_hat_K[r] = _wire(body.wrench[r])
        for r in range(3):
            for c in range(4):
                state.O_T_EE[r, c] = _wire(body.T[r, c])


class Sensors:
    """The measured part of the arms' states (n,) of ARM_STATE; noise by the seed and the number of milliseconds.

    It is encoders, torque sensors and an estimate of external forces.

    Signs as in libfranka: tau_ext_hat_filtered and O_F_ext_hat_K are positive where the robot pushes. Floats are
    rounded to float32, as the wire carries them.
    """

    def __init__(self, plant: Plant, parameters: SensorParameters, faces: Array, seed: int) -> None:
        """faces: (n, 4, 4), the end effectors in the frames of joint 7."""
        arms = len(faces)
        self.states = np.zeros(arms, ARM_STATE)
        self.states["O_T_EE"][:] = np.eye(4)
        self._plant = plant
        self._generator = np.random.default_rng(np.random.SeedSequence([seed, 1]))
        self._draws = np.zeros((BLOCK, arms, CHANNELS, JOINTS))
        self._next = BLOCK
        self.kinematics = np.zeros(arms, KINEMATICS_RECORD)
        self.kinematics["T_parent_joint"] = [arm_description(model).T_parent_joint for model in plant.robots]
        self.kinematics["joint_T_face"] = faces
        self._records = np.zeros(arms, SENSOR_RECORD)
        record = self._records
        for name in ("q_quantum", "smallest_singular_value", "wrench_damping"):
            record[name] = getattr(parameters, name)
        scalar = (parameters.q_noise, parameters.dq_noise, parameters.theta_noise, parameters.dtheta_noise)
        record["noise"][:, :4] = np.array(scalar)[:, None]
        record["noise"][:, 4], record["noise"][:, 5] = parameters.tau_J_noise, parameters.tau_ext_noise
        record["dtau_J_gain"] = 1.0 - exp(-2.0 * pi * parameters.dtau_J_cutoff_hz * CONTROL_PERIOD_S)
        record["tau_ext_gain"] = 1.0 - exp(-2.0 * pi * parameters.tau_ext_cutoff_hz * CONTROL_PERIOD_S)
        force = plant.profile.force
        for side, error in enumerate(plant.estimate_errors):
            record[side]["offset"], record[side]["gravity_error"] = error.offset, error.gravity
            record[side]["delay"] = error.delay_ms
        keep = exp(-2.0 * pi * force.noise_hz * CONTROL_PERIOD_S)
        record["slow_keep"], record["slow_fresh"] = keep, np.array(force.noise) * sqrt(1.0 - keep * keep)
        self._slow: np.random.Generator | None = None
        if any(force.noise):
            self._slow = np.random.default_rng(np.random.SeedSequence([seed, SLOW_NOISE_DRAW]))
            record["slow"] = np.array(force.noise) * self._slow.standard_normal((arms, JOINTS))
        self._slow_draws = np.zeros((BLOCK, arms, JOINTS))
        self._measure = bound(
            _sense, plant.data.qpos, plant.data.qvel, plant.motors, record, self.kinematics, self._draws,
            self._slow_draws, self.states, later=(0, 0),
        )  # fmt: skip

    def sense(self) -> None:
        """Measure the plant now: once a millisecond, since the filters and the noise count the calls."""
        if self._next == BLOCK:
            self._generator.standard_normal(out=self._draws)
            if self._slow is not None:
                self._slow.standard_normal(out=self._slow_draws)
            self._next = 0
        self._measure(self._next, self._plant.ticks * 1_000_000)
        self._next += 1


_REFUSING = (RobotMode.REFLEX, *NEEDS_PERSON)
_MOVE = RobotMode.MOVE  # looked up once: an enumeration's member costs 0.1 us


class SimulatedArm:
    """One arm of a simulated cell: a hal.arm.Arm. In a reflex a read is refused, and the plant goes on."""

    def __init__(self, cell: "SimulatedCell", side: int) -> None:
        self._cell, self._side, self._name = cell, side, f"{cell.scene.sides[side]} arm"
        self._state = ArmState.empty()
        self._seen_tick = -1
        self._closed = False
        self._box, self._plant = cell.boxes[side], cell.plant
        # copied as bytes: a record copies field by field
        self._bytes = self._state.record.view(np.uint8)
        self._source = cell.states[side : side + 1].view(np.uint8)

    def read(self) -> ArmState:
        if self._closed:
            self._refuse_closed()
        if self._seen_tick == self._plant.ticks:
            self._cell.next_state()
        self._seen_tick = self._plant.ticks
        self._bytes[:] = self._source
        if self._cell.faults is not None:
            self._cell.faults.distort(self._side, self._state.record, "t_ns", 1_000_000)
        if self._box.mode is not _MOVE and self._box.mode in _REFUSING:
            self._refuse()
        return self._state

    def write(self, tau: Array) -> None:
        if self._closed:
            self._refuse_closed()
        if self._box.mode is not _MOVE and self._box.mode in _REFUSING:
            self._refuse()
        self._box.take(np.ascontiguousarray(tau, dtype=np.float64))

    def stop(self) -> None:
        if self._box.mode not in NEEDS_PERSON:
            self._box.stop()

    def recover(self) -> None:
        if self._closed:
            self._refuse_closed()
        self._cell.recover(self._side)

    def close(self) -> None:
        self.stop()
        self._closed = True

    def _refuse_closed(self) -> NoReturn:
        raise ConnectionLost(f"the {self._name} was closed; open the cell again")

    def _refuse(self) -> NoReturn:
        if self._box.mode == RobotMode.REFLEX:
            names = error_names(self._box.errors)
            raise CommandRejected(f"{self._name} in reflex: {', '.join(names)}; recover it first", names)
        if self._box.mode == RobotMode.USER_STOPPED:
            raise CommandRejected(f"{self._name}: user stop pressed; release the activation device first")
        raise CommandRejected(f"{self._name}: {NEEDS_PERSON[self._box.mode]}")


class SimulatedCell:
    """The scene's arms, a tracker, one plant. arms: in the order of `Scene.sides`; left, right: by name, or None."""

    def __init__(
        self, plant: Plant, scene: Scene, parameters: PlantParameters, seed: int, clock: PacedLockstep | None = None,
        box_kind: type[ControlBox] = ControlBox, faults: tuple[ScriptedFault, ...] = (), empty: bool = False,
    ) -> None:  # fmt: skip
        """empty: the plant's object is out of reach and out of sight, from the start."""
        self.plant, self.clock, self.seed, self.scene = plant, clock, seed, scene
        self.sensors = Sensors(plant, parameters.sensors, faces(scene), seed)
        self.states = self.sensors.states  # the arms' present states, dtype ARM_STATE, (n,)
        count = len(self.states)
        self._shown: list[tuple[RobotMode, int, float] | None] = [None] * count  # of each box
        self._masks = np.zeros(count, dtype=np.int64)
        self._judged = np.zeros(count, reflexes.JUDGED_RECORD)
        self._judge_states = reflexes.judge_of_states(
            self.states, self.sensors.kinematics, self._judged, plant.robots, parameters.reflexes, self._masks
        )
        first_command_ms = plant.profile.box.first_command_ms or parameters.reflexes.first_command_timeout_ms
        tolerances = replace(parameters.reflexes, first_command_timeout_ms=first_command_ms)
        self.boxes = tuple(box_kind(plant, side, tolerances) for side in range(count))
        self.faults = Injection(faults, plant, self.boxes, empty) if faults or empty else None
        tracker = tracker_of(plant, parameters.tracker, seed)
        self.tracker = tracker if self.faults is None else FaultyTracker(tracker, self.faults)
        # None: no hand is mounted
        self.hands = tuple(place.hand and Hand(plant, side, place.hand) for side, place in enumerate(scene.arms))
        self._mounted = tuple(hand for hand in self.hands if hand is not None)
        self.arms = tuple(SimulatedArm(self, side) for side in range(count))
        by_name = dict(zip(scene.sides, self.arms, strict=True))
        self.left, self.right = by_name.get("left"), by_name.get("right")
        # views of single fields: looking a field up costs more than writing it
        self._modes, self._errors, self._rates, self._tau_J_d = (
            self.states[name] for name in ("robot_mode", "current_errors", "control_command_success_rate", "tau_J_d")
        )
        self._observe()

    def next_state(self) -> None:
        """Advance by 1 ms, once the clock says so."""
        if self.clock is not None:
            self.clock.wait()
        for box in self.boxes:
            box.begin_millisecond()
        if self.faults is not None:
            self.faults.begin_millisecond()
        self.plant.advance()
        for hand in self._mounted:
            hand.advance()
        self._observe()

    def _observe(self) -> None:
        if self.faults is None:
            self.sensors.sense()
        else:
            self.faults.plant.mislead_sensors()
            self.sensors.sense()
            self.faults.plant.enlighten_sensors()
        self.tracker.update()
        if self._judge_states():
            for side, box in enumerate(self.boxes):
                self._react(side, box, int(self._masks[side]))
        if self.faults is not None:
            self.faults.judge()
        for side, box in enumerate(self.boxes):
            shown = (box.mode, box.errors, box.success_rate)
            if shown != self._shown[side]:
                self._shown[side] = shown
                self._modes[side], self._errors[side], self._rates[side] = shown
            if not box.desires_torque:  # the torque that holds the arm is not a client's command
                self._tau_J_d[side] = 0.0

    def _react(self, side: int, box: ControlBox, mask: int) -> None:
        """Stop at what the state shows; in a reflex only what gets worse counts."""
        if box.mode == RobotMode.MOVE and mask:
            box.trip(mask)
            if mask & reflexes.POSITION_LIMITS:
                self._judged[side]["q_stopped"], self._judged[side]["beyond"] = self.states[side]["q"], 1
        elif box.mode == RobotMode.REFLEX and mask & reflexes.WRONG_DIRECTION:
            box.trip(reflexes.WRONG_DIRECTION)

    def recover(self, side: int) -> None:
        """Clear the reflex of an arm, by its index. Raises RecoveryRefused while its cause persists."""
        box, causes, name = self.boxes[side], int(self._masks[side]), f"{self.scene.sides[side]} arm"
        if box.mode == RobotMode.USER_STOPPED:
            raise RecoveryRefused(f"the user stop of the {name} is pressed; release it first")
        if box.mode in NEEDS_PERSON:
            raise RecoveryRefused(f"the {name} cannot recover, {NEEDS_PERSON[box.mode]} first")
        if self.faults is not None:
            causes |= self.faults.causes(side)
        if box.errors & causes & BASE_READING:  # a recovery measures gravity anew
            box.trip(BASE_START)
            causes |= BASE_START
        persisting = error_names(box.errors & causes)
        if persisting:
            raise RecoveryRefused(f"the cause persists: {', '.join(persisting)}; move the {name} back first")
        box.recover()
        self._judged[side]["beyond"] = 0

    def as_cell(self, name: str) -> Cell:
        """Return the cell as hal knows it. `name` is the kind as the command line spells it."""
        return Cell(name, self.left, self.right, self.tracker, paced=self.clock is not None)

    def gripper(self, side: int) -> SimulatedGripper:
        """Return the hand of an arm, by its index. Raises NoGripper."""
        return SimulatedGripper(self, side)

    def close(self) -> None:
        for arm in self.arms:
            arm.close()


def cell_scene(scene: Path | None, cell_file: Path | None, sides: Sequence[str] | None = None) -> Scene:
    """Return the scene of a file, by default the grabbing one, with a lab's objects, of the arms in sides.

    Raises ConfigurationError, naming the key or the arm that is not there."""
    layout = load_scene(scene)
    if cell_file is not None:
        layout = with_lab_objects(layout, cell_file)
    return layout if sides is None else layout.only(sides)


def simulated_cell(
    object_name: str, displacement: Displacement | float, seed: int, *, scene: Path | None = None,
    cell_file: Path | None = None, parameters: PlantParameters | None = None, clock: PacedLockstep | None = None,
    box_kind: type[ControlBox] = ControlBox, faults: tuple[ScriptedFault, ...] = (), on_the_wire: bool = False,
    arms_seed: int | None = None, profile: str = IDEAL, sides: tuple[str, ...] | None = None,
) -> SimulatedCell:  # fmt: skip
    """Build the cell with this object, displaced from its place (a number: along y, m); NO_OBJECT: an empty cell.

    cell_file: a lab's own, for its objects. arms_seed: of the arms alone. Without a clock it is lockstep: a seed gives
    bit-identical states. on_the_wire: an FCI server carries out the faults of the link. profile: its name. sides: left,
    right or both, by default those of scene and cell_file. Raises UnknownObject, ObjectOutOfReach, ConfigurationError,
    FaultNeedsLink.
    """
    if not on_the_wire:
        refuse_link_faults(faults)
    layout, parameters = cell_scene(scene, cell_file, sides), parameters or load_plant_parameters()
    empty = object_name == NO_OBJECT
    if empty and Displacement.of(displacement) != Displacement():
        raise ObjectOutOfReach(f"an empty cell (object {NO_OBJECT!r}) has nothing that could be displaced")
    name = next(iter(layout.objects)) if empty else object_name
    how = load_profile(profile)
    if how.built.moved_tracker and not on_the_wire:
        raise ConfigurationError(
            f"profile {profile}: a tracker in another frame is one behind the wire: lockstep, realtime"
        )
    layout = how.built.scene(layout)
    plant = Plant(layout, parameters, name, displacement, seed, arms_seed, tilt_of(faults), how)
    return SimulatedCell(plant, layout, parameters, seed, clock, box_kind, faults, empty)
