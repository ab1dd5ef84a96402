"""What the robot reports of the plant: encoders, torque sensors and an estimate of external forces.

Signs as in libfranka: tau_ext_hat_filtered and O_F_ext_hat_K are positive where the robot pushes. Floats are rounded to
float32, as the wire carries them.
"""

from math import exp, floor, pi, sqrt

import numpy as np

from hal.base.arrays import Array
from hal.compilation import bound, compiled
from hal.limits import CONTROL_PERIOD_S
from hal.state import ARM_STATE
from sim_robot.arm_description import JOINTS, arm_description
from sim_robot.kinematics import KINEMATICS_RECORD, estimate_wrench, forward_kinematics
from sim_robot.plant import Plant
from sim_robot.plant_parameters import SensorParameters
from sim_robot.profile import LONGEST_DELAY_MS, SLOW_NOISE_DRAW

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
    """The measured part of the arms' states (n,) of ARM_STATE; noise by the seed and the number of milliseconds."""

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
