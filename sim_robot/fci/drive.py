"""A control box with the robot's own controllers: what each pair of controller and motion generator does."""

import numpy as np

from hal.state import RobotMode
from sim_robot.control_box import ControlBox
from sim_robot.fci import joint_motion
from sim_robot.fci.cartesian_motion import CMG_VELOCITY_JUMP, follow_cartesian
from sim_robot.fci.generators import extrapolate, start_motion
from sim_robot.fci.impedance import cartesian_impedance
from sim_robot.fci.protocol import ROBOT_COMMAND, Controller, Generator
from sim_robot.fci.robot_state import MOTION_RECORD
from sim_robot.kinematics import KINEMATICS_RECORD, forward_kinematics
from sim_robot.plant import Plant
from sim_robot.plant_parameters import ReflexParameters

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

    def begin_millisecond(self, on_time: bool) -> None:
        """Begin a ms of the plant, which is one of this box's too unless it has its own clock."""
        if not self.own_clock:
            self._begin(on_time)

    def sample(self) -> None:
        """Begin a ms of this box's own clock: what it applies, the plant feels from its next ms on."""
        self._begin(on_time=True)

    @property
    def sampled_torque(self) -> np.ndarray | None:
        """The client's torque (7,) that counts by this box's own clock; None without one of either."""
        client = self.own_clock and self._controller == Controller.EXTERNAL and self.desires_torque
        return self._tau if client else None

    def _begin(self, on_time: bool) -> None:
        if self._motion["asynchronous"] and self.mode == RobotMode.MOVE:  # it needs no command each ms
            joint_motion.approach_target(self._motion)
            self._waiting = on_time = True
        super().begin_millisecond(on_time)

    def _torques(self) -> np.ndarray:
        tau = np.zeros(7)
        cartesian_impedance(self._state, self._motion, self._setting, self._scratch[0], self._scratch[1], tau)
        return tau

    def singular(self) -> bool:
        """True where the robot cannot start a Cartesian motion."""
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
        errors = 0
        if self._motion["asynchronous"]:
            errors = joint_motion.take_target(self._motion, command, self._setting)
        elif self._generator in JOINT_GENERATORS:
            errors = joint_motion.follow_joints(
                self._motion, command, int(self._generator), self._setting, self._state["q"]
            )
        elif self._generator in CARTESIAN_GENERATORS:
            errors = follow_cartesian(
                self._motion, command, int(self._generator), self._scratch[0], self._setting, self._state["q"]
            )
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
