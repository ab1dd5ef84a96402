"""A control box with the robot's own controllers: what each pair of controller and motion generator does."""

from math import sqrt

import numpy as np

from hal.compilation import compiled
from hal.state import RobotMode
from hal.wire import ROBOT_COMMAND
from sim_robot.arm_description import JOINTS
from sim_robot.control_box import ControlBox
from sim_robot.fci import joint_motion
from sim_robot.fci.cartesian_motion import CMG_VELOCITY_JUMP, follow_cartesian, inverse_step, sine_between, turn
from sim_robot.fci.joint_motion import DT, JOINT_VELOCITY
from sim_robot.fci.protocol import Controller, Generator
from sim_robot.fci.robot_state import ELBOW_FLIP, MOTION_RECORD, product
from sim_robot.kinematics import KINEMATICS_RECORD, cholesky, forward_kinematics, gram, solve
from sim_robot.plant import Plant
from sim_robot.plant_parameters import ReflexParameters

# inertia that the damping is critical for, seen at the end effector: kg, kg m^2 (the vendor publishes none)
_MASS, _INERTIA = 4.0, 0.1
# holds the elbow, Nm/rad and Nms/rad, in what motion of the joints leaves the end effector
_NULL_STIFFNESS, _NULL_DAMPING = 20.0, 5.0


@compiled
def cartesian_impedance(state, motion, setting, measured, desired, tau):
    """Set tau (7,), Nm without gravity: J^T (K_x e + D_x de) along the axes of the stiffness frame, and the elbow.

    `measured` and `desired` are scratch KINEMATICS_RECORDs. With a joint generator the pose follows from q_d.
    """
    T, T_d, e = np.empty((4, 4)), np.empty((4, 4)), np.empty(6)
    forward_kinematics(desired, motion.q_d)
    product(desired.T, setting.face_T_K, T_d)
    forward_kinematics(measured, state.q)
    product(measured.T, setting.face_T_K, T)
    J = measured.J
    lever = (T[0, 3] - measured.T[0, 3], T[1, 3] - measured.T[1, 3], T[2, 3] - measured.T[2, 3])
    for j in range(JOINTS):
        ax, ay, az = J[3, j], J[4, j], J[5, j]
        J[0, j] += ay * lever[2] - az * lever[1]
        J[1, j] += az * lever[0] - ax * lever[2]
        J[2, j] += ax * lever[1] - ay * lever[0]
    e[:3] = T_d[:3, 3] - T[:3, 3]
    sine_between(T, T_d, e[3:])  # enough for what a stiff controller leaves
    wrench = np.zeros(6)
    for half in range(2):
        for c in range(3):  # along the axes of K
            error, rate = 0.0, 0.0
            for r in range(3):
                error += T[r, c] * e[3 * half + r]
                for j in range(JOINTS):
                    rate += T[r, c] * J[3 * half + r, j] * (motion.dq_d[j] - state.dq[j])
            K = setting.K_x[3 * half + c]
            force = K * error + 2.0 * sqrt(K * (_MASS if half == 0 else _INERTIA)) * rate
            for r in range(3):
                wrench[3 * half + r] += T[r, c] * force
    null = _NULL_STIFFNESS * (motion.q_d - state.q) + _NULL_DAMPING * (motion.dq_d - state.dq)
    # take out of `null` what pushes the end effector: null - J^T (J J^T + d I)^-1 J null
    b = np.zeros(6)
    for i in range(6):
        for j in range(JOINTS):
            b[i] += J[i, j] * null[j]
    gram(J, measured.JJ)
    cholesky(measured.JJ, 1e-4, measured.factor)  # positive definite by the shift
    solve(measured.factor, b)
    for j in range(JOINTS):
        total = null[j]
        for i in range(6):
            total += J[i, j] * (wrench[i] - b[i])
        most = setting.joint_limits[7, j]
        tau[j] = max(-most, min(most, total))


@compiled
def start_motion(motion, body, setting, q_start):
    """Begin at rest at q_start (7,): the pose, the elbow and all rates follow from it."""
    forward_kinematics(body, q_start)
    product(body.T, setting.face_T_EE, motion.O_T_EE_d)
    motion.O_T_EE_c[:] = motion.O_T_EE_d
    motion.q_d[:], motion.dq_d[:], motion.ddq_d[:] = q_start, 0.0, 0.0
    motion.O_dP_EE_d[:], motion.O_dP_EE_c[:], motion.O_ddP_EE_c[:] = 0.0, 0.0, 0.0
    motion.elbow_c[0] = q_start[2]
    motion.elbow_c[1] = 1.0 if q_start[3] > ELBOW_FLIP else -1.0
    motion.delbow_c[:], motion.ddelbow_c[:] = 0.0, 0.0
    motion.first, motion.with_elbow = 1, 0


@compiled
def extrapolate(motion, kind, body, setting):
    """Get over a lost packet with constant acceleration, joints or pose, as the robot does."""
    if kind <= JOINT_VELOCITY:
        motion.dq_d[:] += motion.ddq_d * DT
        motion.q_d[:] += motion.dq_d * DT
        return
    motion.O_dP_EE_c[:] += motion.O_ddP_EE_c * DT
    motion.O_dP_EE_d[:] = motion.O_dP_EE_c
    turn(motion.O_T_EE_d, motion.O_dP_EE_c, DT)
    motion.O_T_EE_c[:] = motion.O_T_EE_d
    if motion.with_elbow != 0:
        motion.delbow_c[0] += motion.ddelbow_c[0] * DT
        motion.elbow_c[0] += motion.delbow_c[0] * DT
    q = motion.q_d.copy()
    for _ in range(3):
        inverse_step(body, setting, motion.O_T_EE_d, motion.elbow_c[0], motion.with_elbow != 0, q)
    dq = (q - motion.q_d) / DT
    motion.ddq_d[:] = (dq - motion.dq_d) / DT
    motion.q_d[:], motion.dq_d[:] = q, dq


JOINT_GENERATORS = (Generator.JOINT_POSITION, Generator.JOINT_VELOCITY)
CARTESIAN_GENERATORS = (Generator.CARTESIAN_POSITION, Generator.CARTESIAN_VELOCITY)
# below this smallest singular value of the Jacobian (m, rad) a Cartesian motion cannot start
SINGULAR = 0.02


class DrivenBox(ControlBox):
    """A ControlBox that also takes joint and Cartesian motions. `attach` it before the first command."""

    def __init__(self, plant: Plant, side: int, tolerances: ReflexParameters) -> None:
        super().__init__(plant, side, tolerances)
        self._controller, self._generator = Controller.EXTERNAL, Generator.NONE
        self._default_stiffness = np.array(plant.joints[side]["hold_stiffness"])
        self.own_clock = False  # True: the plant's ms are not this box's, whose own come with `sample`

    def attach(self, state: np.void, motion: np.void, setting: np.void, kinematics: np.void) -> None:
        """Give it the arm's ARM_STATE, MOTION_RECORD, SETTINGS_RECORD and a KINEMATICS_RECORD to copy."""
        self._state, self._motion, self._setting = state, motion, setting
        self._scratch = np.zeros(2, KINEMATICS_RECORD)
        self._scratch[:] = kinematics
        self._default_stiffness = np.array(setting["K_theta"])
        # compile, or load from the cache, before a clock runs
        body = self._scratch[0]
        start_motion(motion, body, setting, np.array(state["q"]))
        self._torques()
        spare, command = np.zeros(1, MOTION_RECORD)[0], np.zeros(1, ROBOT_COMMAND)[0]
        joint_motion.follow_joints(spare, command, int(Generator.JOINT_POSITION), setting, state["q"])
        follow_cartesian(spare, command, int(Generator.CARTESIAN_VELOCITY), body, setting, state["q"])
        extrapolate(spare, int(Generator.JOINT_POSITION), body, setting)
        joint_motion.ends_too_fast(spare)
        joint_motion.take_target(spare, command, setting)
        joint_motion.approach_target(spare)

    @property
    def desires_torque(self) -> bool:
        """True from Move on where the torque is the robot's own controller's."""
        own = self.mode == RobotMode.MOVE and self._controller != Controller.EXTERNAL
        return own or super().desires_torque

    def begin_millisecond(self) -> None:
        """Begin a ms of the plant, which is one of this box's too unless it has its own clock."""
        if not self.own_clock:
            self.sample()

    def sample(self) -> None:
        """Begin a ms of this box; by its own clock: what it applies, the plant feels from its next ms on."""
        if self._motion["asynchronous"] and self.mode == RobotMode.MOVE:  # it needs no command each ms
            joint_motion.approach_target(self._motion)
            self._waiting = True
        super().begin_millisecond()

    @property
    def sampled_torque(self) -> np.ndarray | None:
        """The client's torque (7,) that counts by this box's own clock; None without one of either."""
        client = self.own_clock and self._controller == Controller.EXTERNAL and self.desires_torque
        return self._tau if client else None

    def _torques(self) -> np.ndarray:
        tau = np.zeros(7)
        cartesian_impedance(self._state, self._motion, self._setting, self._scratch[0], self._scratch[1], tau)
        return tau

    def singular(self) -> bool:
        body = self._scratch[0]
        forward_kinematics(body, np.array(self._state["q"]))
        return bool(np.linalg.svd(body["J"], compute_uv=False).min() < SINGULAR)

    def begin(
        self, controller: Controller, generator: Generator, largest_velocity: tuple[float, ...] | None = None
    ) -> None:
        """Begin a motion from where the arm is held; an asynchronous one with a largest_velocity, (7,) rad/s."""
        self._controller, self._generator = controller, generator
        motion = self._motion
        motion["following"] = generator == Generator.NONE
        motion["cartesian"] = generator in CARTESIAN_GENERATORS
        start_motion(motion, self._scratch[0], self._setting, np.array(motion["q_d"]))
        motion["asynchronous"] = largest_velocity is not None
        if largest_velocity is not None:
            motion["target"], motion["largest_velocity"] = motion["q_d"], largest_velocity
        if controller == Controller.JOINT_IMPEDANCE:
            self._plant.set_hold(self._side, np.array(self._setting["K_theta"]))
            self._plant.track(self._side, np.array(motion["q_d"]), np.zeros(7))
        self.start()

    def take_command(self, command: np.void) -> None:
        """Take a ROBOT_COMMAND for the next ms; a bad one is a reflex and never reaches the plant."""
        motion, setting, kind, q, errors = self._motion, self._setting, int(self._generator), self._state["q"], 0
        if motion["asynchronous"]:
            errors = joint_motion.take_target(motion, command, setting)
        elif self._generator in JOINT_GENERATORS:
            errors = joint_motion.follow_joints(motion, command, kind, setting, q)
        elif self._generator in CARTESIAN_GENERATORS:
            errors = follow_cartesian(motion, command, kind, self._scratch[0], setting, q)
        if errors:
            self.trip(errors)
        elif self._controller == Controller.EXTERNAL:
            self.take(np.array(command["tau_J_d"]))
        else:
            self._waiting = True

    def finish(self) -> None:
        """End the motion as asked for; one that ends while it moves is a discontinuity."""
        commanded = self._generator != Generator.NONE and not self._motion["asynchronous"]
        if commanded and joint_motion.ends_too_fast(self._motion):
            self.trip(joint_motion.JMG_VELOCITY_JUMP if self._generator in JOINT_GENERATORS else CMG_VELOCITY_JUMP)
            return
        self.stop()
        if self._controller == Controller.JOINT_IMPEDANCE:
            self._plant.track(self._side, np.array(self._motion["q_d"]), np.zeros(7))

    def _apply(self) -> None:
        if self._controller == Controller.EXTERNAL:
            super()._apply()
        elif self._controller == Controller.JOINT_IMPEDANCE:
            self._plant.track(self._side, np.array(self._motion["q_d"]), np.array(self._motion["dq_d"]))
        else:
            self._plant.command(self._side, self._torques())

    def _bridge(self) -> None:
        if self._generator != Generator.NONE:
            extrapolate(self._motion, int(self._generator), self._scratch[0], self._setting)
        if self._controller != Controller.EXTERNAL:
            self._apply()

    def _to(self, mode: RobotMode) -> None:
        super()._to(mode)
        if mode != RobotMode.MOVE:
            self._plant.set_hold(self._side, self._default_stiffness)
