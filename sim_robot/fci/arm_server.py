"""One arm as its control box shows it to a client: requests, motions, modes, and what it answers."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import cast

import numpy as np

from hal.errors import RecoveryRefused
from hal.robot_errors import ROBOT_ERRORS, error_bit
from hal.state import RobotMode
from sim_robot.cell import SimulatedCell
from sim_robot.fci.answer_times import AnswerTimes
from sim_robot.fci.drive import CARTESIAN_GENERATORS, DrivenBox
from sim_robot.fci.link import Link
from sim_robot.fci.move import GOAL_DEVIATION, PATH_DEVIATION, MoveRequest, Tolerances, deviates
from sim_robot.fci.pace import LONGEST_SILENCE, PERIOD_NS
from sim_robot.fci.protocol import (
    GENERATOR_IDLE,
    Command,
    Controller,
    Generator,
    MoveStatus,
    RecoveryStatus,
    SetStatus,
    StopStatus,
)
from sim_robot.fci.robot_state import CARTESIAN_COLLISION, JOINT_COLLISION
from sim_robot.fci.settings import InvalidSetting, Settings
from sim_robot.profile import BOX_DRAW, LINK_DRAW, Spread
from sim_robot.proximity import Proximity

_NEVER_NS = 1 << 62
# a recovery is answered once the arm stands, rad/s, and nothing pushes it; or so many ms after the reflex
_STANDS, _LONGEST_BRAKING_MS = 0.02, 500
_STOPPED = {RobotMode.REFLEX: StopStatus.REFLEX_ABORTED, RobotMode.USER_STOPPED: StopStatus.EMERGENCY_ABORTED}
JOINT_REFLEX, CARTESIAN_REFLEX = error_bit("joint_reflex"), error_bit("cartesian_reflex")


def _flags(mask: int) -> np.ndarray:
    return np.array([mask >> bit & 1 for bit in range(len(ROBOT_ERRORS))], dtype=np.uint8)


def _possible(request: MoveRequest) -> bool:
    external, generator = request.controller == Controller.EXTERNAL, request.generator
    if request.controller > Controller.EXTERNAL or generator > Generator.NONE:
        return False
    if request.asynchronous and (generator != Generator.JOINT_POSITION or external):
        return False
    return generator != Generator.NONE or external


class ArmServer:
    """One arm behind its link. `wire` is its RobotState, `motion` what it is to do, `settings` what was set."""

    def __init__(
        self, cell: SimulatedCell, side: int, link: Link, settings: Settings, motion: np.void, wire: np.ndarray,
        proximity: Proximity, refresh: Callable[[], None],
    ) -> None:  # fmt: skip
        self._refresh = refresh
        self._replies: list[tuple[int, Command, int, int]] = []  # from which state on, and what
        self._requests: list[tuple[int, Command, int, tuple]] = []  # the box will carry out with that state
        self._shown = 0  # states so far: the box's time, ms
        box, seed = cell.plant.profile.box, (cell.seed, BOX_DRAW, side)
        recovery = Spread(*box.recovery_ms)
        self._latencies = {Command.MOVE: Spread(*box.move_ms), Command.AUTOMATIC_ERROR_RECOVERY: recovery}
        self._stopping, self._setting = Spread(*box.stop_ms), Spread(*box.set_ms)
        self._draws = np.random.default_rng(np.random.SeedSequence(seed))
        self.hold_replies = False  # in lockstep: until the plant is at rest
        self.proximity = proximity
        self.link, self.settings, self.motion = link, settings, motion
        self.box = cast(DrivenBox, cell.boxes[side])  # the box_kind of a served cell
        self.box.attach(cell.states[side], motion, settings.record, cell.sensors.kinematics[side])
        self.message_id = 0
        self.first_id = 0  # an answer to an older message is too late
        # True: any answer to a message that was not answered yet will do. A client with two arms in one thread may be
        # one message behind on one arm, and would wait for the other one for ever if its answer were lost.
        self.patient = False
        self.period_ns = PERIOD_NS  # of the host's clock, a ms of the robot's
        self.repeats, self.repeat_due_s = 0, 0.0  # states shown since Move without an answer, and when the next is due
        self.answered = False  # the client has answered that state
        self.punctual = False  # and the state before
        self.silent = 0  # states in a row before that one that it has not answered
        self.due_ns = _NEVER_NS  # until when an answer to that state counts, ns of time.time_ns
        self.joined = False  # the client has answered at least once since Move
        self.answers, self._shown_ns, self._shown_before_ns = AnswerTimes(), 0, 0
        self._cell, self._side, self._robot = cell, side, cell.plant.robots[side]
        self._wire, self._bytes = wire, wire.view(np.uint8).data
        self._shown_errors = self._shown_reason = self._reason = 0
        self._move_id: int | None = None
        self._recovery_id: int | None = None  # asked for while the arm still brakes
        self._braking_ms = 0  # since the reflex
        self._mode_shown = (int(Controller.OTHER), GENERATOR_IDLE)
        self._tolerances = Tolerances()
        self._rest()

    # what the server asks

    def link_late(self) -> tuple[Sequence[float], tuple[int, int, int]]:
        """How late this arm's states reach a client, us, where the profile says it (see Link.be_late), and the seed."""
        plant, seed = self._cell.plant, (self._cell.seed, LINK_DRAW, self._side)
        return plant.profile.twins(plant.sides)[self._side].link_late_us or (), seed

    @property
    def moving(self) -> bool:
        """True from Move until the end of the motion."""
        return self.box.mode == RobotMode.MOVE

    @property
    def unsafe(self) -> bool:
        """True while a safety function of the robot refuses every request that changes something."""
        return False

    @property
    def awaited(self) -> bool:
        """True while a client that is moving this arm has not answered the present state."""
        return self.moving and not self.answered and not self.asynchronous and self.link.client is not None

    @property
    def asynchronous(self) -> bool:
        """True while the client owes this arm no answer: it sends targets when it likes."""
        return self.moving and bool(self.motion["asynchronous"])

    # commands

    def take(self, command: np.void) -> None:
        """Take a datagram of the client. One that answers an older state came too late and is lost."""
        message_id = int(command["message_id"])
        if not self.moving or self.answered or not self.first_id <= message_id <= self.message_id:
            return
        if not self.asynchronous:
            shown_ns = self._shown_ns
            if self.patient:
                self.first_id = message_id + 1
            elif message_id < self.message_id:
                shown_ns = self._shown_before_ns
                if self.link.arrived_ns > shown_ns + self.period_ns:
                    return
            elif self.link.arrived_ns > self.due_ns:
                stalled = time.time_ns() - self.due_ns >= self.period_ns
                if not stalled or self.silent >= LONGEST_SILENCE:
                    return
            self.answered = self.joined = True
            self.answers.note(max(0, self.link.arrived_ns - shown_ns))
        if command["torque_command_finished"] or command["motion_generation_finished"]:
            self._finish(MoveStatus.SUCCESS)  # an asynchronous motion's carries no target
        else:
            self.box.take_command(command)
            self.settle_outcome()

    def _finish(self, status: MoveStatus) -> None:
        goal = self._tolerances.goal
        if status == MoveStatus.SUCCESS and goal is not None and deviates(self._wire[0], goal):
            self.box.trip(GOAL_DEVIATION)
        elif status == MoveStatus.SUCCESS:
            self.box.finish()
        else:
            self.box.stop()
        if self.box.mode == RobotMode.REFLEX:
            self.settle_outcome()
            return
        self._rest(keep_goal=status == MoveStatus.SUCCESS and self._mode_shown[0] == Controller.JOINT_IMPEDANCE)
        self._end_move(status)

    def _end_move(self, status: MoveStatus) -> None:
        self._mode_shown = (int(Controller.OTHER), GENERATOR_IDLE)
        if self._move_id is not None:
            asked = status in (MoveStatus.SUCCESS, MoveStatus.PREEMPTED)
            self._reply_later(Command.MOVE, self._move_id, status, self._stopping if asked else None)
            self._move_id = None

    def _reply_later(self, command: Command, command_id: int, status: int, latency: Spread | None = None) -> None:
        """Answer after the next state, so that a client that reads then sees what it asked for; or as late as that."""
        self._refresh()
        # one after the other: a client takes an answer for that to its last request
        self._replies.append((self._due(latency, self._replies), command, command_id, status))

    def _due(self, latency: Spread | None, queue: Sequence[tuple]) -> int:
        """Return the state with which the box comes to what is asked now, after what it has in the queue."""
        wait_ms = 0 if latency is None else round(latency.draw(self._draws))
        return max([self._shown + wait_ms, *(each[0] for each in queue)])

    def abandon(self) -> None:
        """Forget the client: its successor must not get its answers."""
        self._replies.clear()
        self._requests.clear()
        self._move_id = self._recovery_id = None

    def _rest(self, keep_goal: bool = False) -> None:
        """Nothing is desired but to hold this place, or the motion's last goal."""
        motion, state = self.motion, self._cell.states[self._side]
        motion["following"] = motion["cartesian"] = motion["watching"] = 0
        if not keep_goal:
            motion["q_d"] = state["q"]
        motion["dq_d"], motion["ddq_d"] = 0.0, 0.0

    # what Desk is told by a person

    def preempt(self) -> None:
        """End a motion, if there is one, as Desk does."""
        if self.moving:
            self._finish(MoveStatus.PREEMPTED_SAFETY)

    def lock_brakes(self) -> None:
        """Stand on the brakes: no motion is possible."""
        self.box.lock()
        self._rest()

    # after each ms of the plant

    def judge(self, collisions: int, proximity: int) -> None:
        """Stop at a collision, a mask of robot_state, or near another arm or the table."""
        errors = proximity
        if collisions & JOINT_COLLISION:
            errors |= JOINT_REFLEX
        if collisions & CARTESIAN_COLLISION:
            errors |= CARTESIAN_REFLEX
        if self._tolerances.path is not None and self.moving and deviates(self._wire[0], self._tolerances.path):
            errors |= PATH_DEVIATION
        if errors and self.moving:
            self.box.trip(errors)
        self.settle_outcome()
        self._braking_ms += 1
        if self._recovery_id is not None:
            self._recover_at_rest(self._recovery_id)

    def settle_outcome(self) -> None:
        """Answer the Move request of a motion that a reflex has ended."""
        if self.box.mode == RobotMode.REFLEX and self.box.errors != self._reason:
            if not self._reason:
                self._rest()
                self._braking_ms = 0
            self._reason = self.box.errors
            self._end_move(MoveStatus.REFLEX_ABORTED)

    def show(self) -> None:
        """Send the present state, under the next message id."""
        wire, box = self._wire[0], self.box
        self.message_id += 1
        wire["message_id"] = self.message_id
        wire["controller_mode"], wire["motion_generator_mode"] = self._mode_shown
        recovers = any(request[1] == Command.AUTOMATIC_ERROR_RECOVERY for request in self._requests)
        wire["robot_mode"] = RobotMode.AUTOMATIC_ERROR_RECOVERY if recovers else box.mode
        wire["control_command_success_rate"] = box.success_rate
        sampled = box.sampled_torque
        if sampled is not None:  # the plant's last ms may have been before this torque came
            wire["tau_J_d"] = sampled
        if box.errors != self._shown_errors:
            self._shown_errors = box.errors
            wire["errors"] = _flags(box.errors)
        if self._reason != self._shown_reason:
            self._shown_reason = self._reason
            wire["reflex_reason"] = _flags(self._reason)
        self.link.send_state(self._bytes)
        self._shown += 1
        if self._replies and not self.hold_replies:
            while self._replies and self._replies[0][0] < self._shown:
                _, command, command_id, status = self._replies.pop(0)
                self.link.reply(command, command_id, bytes((status,)))
        while self._requests and self._requests[0][0] < self._shown:
            _, command, command_id, values = self._requests.pop(0)
            self._carry_out(command, command_id, values)

    def show_new(self) -> None:
        """Send a state that the plant has not shown before: only an answer to it counts from now on."""
        self.answers.lost += self.awaited and self.joined
        if not (self.patient or self.asynchronous):
            # a torque within a ms of the last state counts though this one is out, for this one's ms; a motion's point
            # would come a ms behind what has been bridged meanwhile
            late_counts = not self.answered and self.motion["following"]
            self.first_id = max(self.first_id, self.message_id + (not late_counts))
        self.silent = 0 if self.answered or not self.moving else self.silent + 1
        self.punctual, self.answered = self.answered, False
        self._shown_before_ns, self._shown_ns = self._shown_ns, time.time_ns()
        self.show()

    # requests

    def handle(self, command: Command, command_id: int, values: tuple) -> None:
        """Carry out a request, as late as the box is, and answer it. Every request gets an answer."""
        due = self._due(self._latencies.get(command), self._requests)
        if due > self._shown or self._requests:
            self._requests.append((due, command, command_id, values))
        else:
            self._carry_out(command, command_id, values)

    def _carry_out(self, command: Command, command_id: int, values: tuple) -> None:
        if command == Command.MOVE:
            self._move(command_id, values)
        elif command == Command.STOP_MOVE:
            self._reply_later(command, command_id, self._stop())
        elif command != Command.GET_ROBOT_MODEL and self.moving:
            # in lockstep no state follows until the client has answered the last one: this cannot wait for it
            self.link.reply(command, command_id, bytes((SetStatus.NOT_POSSIBLE,)))
        elif command == Command.GET_ROBOT_MODEL:
            self.link.reply(command, command_id, bytes((SetStatus.SUCCESS,)) + self._robot.urdf.encode())
        elif command == Command.AUTOMATIC_ERROR_RECOVERY:
            self._recover_at_rest(command_id)
        else:
            self._reply_later(command, command_id, self._set(command, values), self._setting)

    def _stop(self) -> StopStatus:
        """End a motion; return what the mode allows, in libfranka's words for each status (robot_impl.h)."""
        status = StopStatus.SAFETY if self.unsafe else StopStatus.NOT_POSSIBLE
        if self.moving:
            self._finish(MoveStatus.PREEMPTED)
            status = StopStatus.SUCCESS
        return _STOPPED.get(self.box.mode, status) if status != StopStatus.SAFETY else status

    def _move(self, command_id: int, values: tuple) -> None:
        request = MoveRequest.of(values)
        controller, generator = request.controller, request.generator
        status = MoveStatus.MOTION_STARTED
        if self.unsafe:
            status = MoveStatus.REJECTED_SAFETY
        elif self.box.mode != RobotMode.IDLE:
            status = MoveStatus.NOT_POSSIBLE
        elif not (_possible(request) and request.valid(self._robot.limits)):
            status = MoveStatus.INVALID_ARGUMENT
        elif generator in CARTESIAN_GENERATORS and self.box.singular():
            status = MoveStatus.SINGULAR_START
        self.link.reply(Command.MOVE, command_id, bytes((status,)))
        if status != MoveStatus.MOTION_STARTED:
            return
        self._move_id = command_id
        self._mode_shown = (controller, generator + 1)
        self._reason = 0
        self.answered, self.joined = False, request.asynchronous
        self.repeats, self.repeat_due_s = 0, 0.0
        if not self.patient:  # the plant has stood still since: an answer to a state from before Move is as good
            self.first_id = self.message_id + 1
        self.motion["watching"] = 1
        largest_velocity = request.largest_velocity(self._robot.limits) if request.asynchronous else None
        self.box.begin(Controller(controller), Generator(generator), largest_velocity)
        self._tolerances = request.tolerances
        self._refresh()

    def _recover_at_rest(self, command_id: int) -> None:
        """Recover, and answer, where the arm has come to rest; else look again after the next ms of the plant."""
        if self.box.mode == RobotMode.REFLEX and self._braking_ms < _LONGEST_BRAKING_MS:
            moves = np.abs(self._cell.states[self._side]["dq"]).max() > _STANDS
            if moves or self._pushed():
                self._recovery_id = command_id
                return
        self._recovery_id = None
        self._reply_later(Command.AUTOMATIC_ERROR_RECOVERY, command_id, self._recover())

    def _recover(self) -> RecoveryStatus:
        if self.unsafe:
            return RecoveryStatus.SAFETY
        if self.box.mode in (RobotMode.OTHER, RobotMode.GUIDING):
            return RecoveryStatus.NOT_POSSIBLE
        if self.proximity.too_near(self._side) or self._pushed():
            return RecoveryStatus.MANUAL_REQUIRED
        try:
            self._cell.recover(self._side)
        except RecoveryRefused:
            return RecoveryStatus.MANUAL_REQUIRED
        self.motion["joint_collision"], self.motion["cartesian_collision"] = 0.0, 0.0
        self._rest()  # the place where the reflex came may lie beyond a limit
        return RecoveryStatus.SUCCESS

    def _pushed(self) -> bool:
        """True while what was a collision lasts, by the thresholds at constant velocity."""
        wire, record, errors = self._wire[0], self.settings.record, self.box.errors
        torque = np.any(np.abs(wire["tau_ext_hat_filtered"]) > record["torque_thresholds"][3])
        force = np.any(np.abs(wire["K_F_ext_hat_K"]) > record["force_thresholds"][3])
        return bool((errors & JOINT_REFLEX and torque) or (errors & CARTESIAN_REFLEX and force))

    def _set(self, command: Command, values: tuple) -> SetStatus:
        if self.unsafe:
            return SetStatus.SAFETY
        settings = self.settings
        setters = {
            Command.SET_COLLISION_BEHAVIOR: settings.set_collision_behavior,
            Command.SET_JOINT_IMPEDANCE: settings.set_joint_impedance,
            Command.SET_CARTESIAN_IMPEDANCE: settings.set_cartesian_impedance,
            Command.SET_EE_TO_K: partial(settings.set_frame, "EE_T_K"),
            Command.SET_NE_TO_EE: partial(settings.set_frame, "NE_T_EE"),
            Command.SET_LOAD: settings.set_load,
            # says which axes a hand may guide; no hand guides a simulated arm, so the mode Guiding never comes
            Command.SET_GUIDING_MODE: lambda guided: None,
        }
        try:
            setters[command](values)
        except InvalidSetting:
            return SetStatus.INVALID_ARGUMENT
        return SetStatus.SUCCESS
