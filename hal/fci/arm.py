"""One arm over pylibfranka: a hal.arm.Arm. It sends what it is given: no filter, no clip, no repair."""

import contextlib
import os
import select
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator

import numpy as np
import pylibfranka as franka

from hal.base.arrays import Array
from hal.errors import CommandRejected, ConnectionLost, HardwareError, RecoveryRefused
from hal.fci import recovery
from hal.fci.call_limit import CALL, CALL_S, FIRED, CallLimit
from hal.fci.cycle_times import CycleTimes
from hal.fci.faults import VENDOR, as_hardware_error, names_in, vendor_errors
from hal.fci.peeked_state import JUMPED, LAST, MOST_MS, PeekedState, stamp_arrivals
from hal.fci.setup import configure, tell_collisions
from hal.fci.sockets import give_up_after, numeric, open_sockets, receive_from, shut_down
from hal.limits import CollisionBehaviour
from hal.pad import Pad
from hal.robot_errors import error_bit
from hal.state import ARM_STATE, NEEDS_PERSON, ArmState, RobotMode
from hal.wire import ROBOT_STATE

# ARM_STATE as one C struct: filling it in one go costs a fifth of filling it field by field
_RECORD = struct.Struct("=q56d16d6dd2q")
assert _RECORD.size == ARM_STATE.itemsize
REQUEST_PATIENCE_S = 3.0  # a robot acknowledges at once; a machine under load may take a second
_LATER_STATES = 2000  # after a stop, until one shows the end of the motion: a box whose states stand still for 2 s
_SENDER_S = 0.1  # until a state shows where the box sends from
_SILENT_S = 1.0  # libfranka's own patience for a state
_KINDS = (socket.SOCK_DGRAM, socket.SOCK_STREAM)


class FciArm:
    """The arm at `address`. Torque control begins with `start`, or with the first `write`."""

    def __init__(
        self, address: str, tool: Pad | None = None, collisions: CollisionBehaviour | None = None, *,
        name: str = "arm", enforce_realtime: bool = False,
    ) -> None:  # fmt: skip
        """Connect and set up; an arm in reflex is set up by its recovery.

        tool: None leaves what is set in Desk. name: in messages. enforce_realtime: refuse a kernel that is not
        real-time. Raises ConnectionLost, CommandRejected, HardwareError.
        """
        self.address = address
        self.called = f"the {name} at {address}"
        self.state = ArmState.empty()  # that was read last
        self._bytes = self.state.record.view(np.uint8).data
        self._torques = franka.Torques([0.0] * 7)
        self._control: franka.ActiveControlBase | None = None
        self._lost = False
        self.unread = False  # True: the next read returns the last state once more, without waiting
        self.peeked: PeekedState | None = None  # where the arm is answered by a clock of its own
        self.cycles: CycleTimes | None = None  # where they are to be measured
        self.let_go = ""  # see hal.fci.hold.Held
        self._config = franka.RealtimeConfig.kEnforce if enforce_realtime else franka.RealtimeConfig.kIgnore
        self._robot: franka.Robot | None = None
        self.reconnected: Callable[[], None] = lambda: None  # told when `socket` is another one
        self._setup = (tool, collisions or CollisionBehaviour())
        self.hold_bounds = self._setup[1].hold_bounds
        self._reads, self._waits = 0, False  # a state waits that was looked at, and follows the last one
        self._requests, self._limit = -1, CallLimit(numeric(address))
        try:
            self._connect()
            if not self.reflex():
                self._configure()
        except BaseException:
            self._limit.close()
            if self._requests >= 0:  # the traceback may keep the vendor's object alive, and its robot has one client
                shut_down(self._requests)
            raise

    def _connect(self) -> None:
        before, peer = [open_sockets(kind) for kind in _KINDS], numeric(self.address)
        self._limit.words[FIRED] = 0
        with self._call():
            self._robot = franka.Robot(self.address, self._config)
        new = [open_sockets(kind, peer) - known for kind, known in zip(_KINDS, before, strict=True)]
        if [len(found) for found in new] != [1, 1]:
            raise HardwareError(f"{self.called}: not one socket for its states and one for requests, but {new}")
        # descriptor that becomes readable when a state has arrived, never to be read here; and the one for requests
        (self.socket, _), (self._requests, _) = (found.pop() for found in new)
        give_up_after(self._requests, REQUEST_PATIENCE_S)
        stamp_arrivals(self.socket)
        receive_from(self.socket, peer, ROBOT_STATE.itemsize, _SENDER_S)
        if self.peeked is not None:
            self.peeked.words[LAST] = -1
        self.reconnected()

    @contextlib.contextmanager
    def _call(self) -> Iterator[None]:
        """Return the context of a call to libfranka outside of the loop: it ends, and raises hal's errors."""
        with vendor_errors(self.called, self._explained), _own_schedule(), self._limit.within():
            yield

    def _explained(self, error: Exception, called: str) -> HardwareError:
        if not self._limit.words[FIRED]:
            return as_hardware_error(error, called)
        self._lost, why = True, f"no end of a call within {CALL_S:g} s"
        return ConnectionLost(f"{called} does not answer: {why}; check power, cable and FCI mode in Desk")

    def _configure(self) -> None:
        with self._call():
            configure(self._open_robot(), *self._setup, self.called)

    def set_collisions(self, collisions: CollisionBehaviour) -> None:
        """Tell other thresholds of the next motion; an arm in reflex is told by its recovery.

        Raises CommandRejected while the arm moves, ConnectionLost.
        """
        tool, before = self._setup
        self._setup, self.hold_bounds = (tool, collisions), collisions.hold_bounds
        if collisions != before and not self.reflex():
            with self._call():
                tell_collisions(self._open_robot(), collisions)

    def reflex(self) -> tuple[str, ...]:
        """Return the vendor's names of the errors that an idle arm has latched. Raises ConnectionLost."""
        return _latched(self._read_idle())

    def _read_idle(self) -> franka.RobotState:
        with self._call():
            return self._open_robot().read_once()

    @property
    def in_motion(self) -> bool:
        """Whether the robot wants an answer each millisecond."""
        return self._control is not None and not self._lost

    def last_torque(self) -> Array:
        """Return what to go on with, see hal.fci.hold.Held."""
        return np.array(self._torques.tau_J)

    def start(self) -> None:
        """Take torque control, if it was not taken: from now on the robot wants an answer each millisecond.

        Lasts as long as the control box takes, in which this process answers no other arm: see hal.fci.hold. Raises
        CommandRejected.
        """
        if self._control is None:
            robot = self._open_robot()
            self._waits = False
            with self._call():
                self._control = robot.start_torque_control()
            self._torques.tau_J = [0.0] * 7
            self.let_go = ""

    @property
    def t_ns(self) -> int:
        """Robot's time of the state that was read last, ns."""
        return self.state.t_ns

    def arrived(self) -> bool:
        """Return whether `read` returns at once. What does not follow the last state is dropped."""
        self._waits = self.peeked is None or bool(self.peeked.look(self.socket))
        return self._waits

    def _await(self) -> None:
        """Wait until `arrived`. Raises ConnectionLost."""
        poll, due_s = select.poll(), time.monotonic() + _SILENT_S
        poll.register(self.socket, select.POLLIN)
        while not self.arrived():
            left_s = due_s - time.monotonic()
            if left_s <= 0.0:
                raise self.lose(f"has sent no state for {_SILENT_S:g} s")
            poll.poll(1e3 * left_s)

    def read(self) -> ArmState:
        """Block until the next state, see hal.arm.Arm. Raises ConnectionLost after 1 s, CommandRejected in a reflex."""
        robot = self._open_robot()
        if self.unread:
            self.unread = False
            return self.state
        peeked, calls = self.peeked, self._limit.words
        if peeked is not None and not self._waits:
            self._await()
        self._waits = False
        self._reads += 1
        calls[CALL] = self._reads
        try:
            # no local name for the control: the traceback of an error would keep it, and the robot busy, alive
            state = robot.read_once() if self._control is None else self._control.readOnce()[0]
        except VENDOR as error:
            raise self._fault(error) from None
        finally:
            calls[CALL] = 0
        number = round(1e3 * state.time.to_sec())
        mode = -1
        if peeked is not None:
            if self.cycles is not None:
                self.cycles.read()
            mode = peeked.take(min(number, MOST_MS))
        if mode == JUMPED or number >= MOST_MS:
            raise self.lose(f"has sent a state with number {number}, which is not its next one")
        if mode < 0:
            mode = int(state.robot_mode)
            self._take(state, number, mode)
        if mode == RobotMode.REFLEX:
            names, arm = _reasons(state), self.called + self.let_go
            raise CommandRejected(f"{arm} is in reflex: {', '.join(names)}; recover it first", names)
        return self.state

    def _take(self, state: franka.RobotState, number: int, mode: int) -> None:
        errors = state.current_errors
        T = state.O_T_EE  # column-major on the wire
        _RECORD.pack_into(
            self._bytes, 0, number * 1_000_000,
            *state.q, *state.dq, *state.tau_J, *state.tau_J_d, *state.dtau_J, *state.theta, *state.dtheta,
            *state.tau_ext_hat_filtered, *T[0::4], *T[1::4], *T[2::4], *T[3::4], *state.O_F_ext_hat_K,
            state.control_command_success_rate, mode,
            sum(map(error_bit, names_in(str(errors)))) if errors else 0,
        )  # fmt: skip

    def write(self, tau: Array) -> None:
        """Answer the last state with a torque, (7,), Nm, gravity excluded. See hal.arm.Arm.

        Raises ValueError for what is not seven numbers: no torque was sent, and the state still waits for an answer.
        """
        if self._control is None:
            self._set_torques(tau)  # before the robot starts
            self.start()
        self._set_torques(tau)
        assert self._control is not None
        try:
            self._control.writeOnce(self._torques)
        except VENDOR as error:
            raise self._fault(error) from None
        if self.cycles is not None:
            self.cycles.answer(self.state.t_ns)

    def _set_torques(self, tau: Array) -> None:
        try:
            self._torques.tau_J = tau  # pyright: ignore[reportAttributeAccessIssue]
        except TypeError:
            raise ValueError(
                f"{self.called}: a torque is seven numbers, shape (7,), Nm; found {np.shape(tau)} of "
                f"{type(tau).__name__}: correct what is given to write"
            ) from None

    def stop(self) -> None:
        """End torque control: the robot brakes and holds. A reflex stays latched."""
        self.unread = self._waits = False
        robot, alive = self._robot, not self._lost
        if robot is None or self._control is None:
            return
        with self._limit.within(), contextlib.suppress(*VENDOR):
            try:
                if alive:
                    robot.stop()
            except VENDOR as error:
                alive = not isinstance(error, franka.NetworkException)
            # without it libfranka asks for a stop once more; where the box refuses that, it takes the motion to go on
            # until it has seen a later state, and starts no other one
            self._control = None
            for _ in range(_LATER_STATES * alive):
                if int(robot.read_once().robot_mode) != RobotMode.MOVE:
                    break

    def recover(self) -> None:
        """Clear a reflex.

        An arm in none is asked nothing: a recovery must not wait there for the next error. Raises RecoveryRefused while
        its cause persists or a person has to act, ConnectionLost.
        """
        begun = self.begin_recovery()
        if begun is not None:
            self.end_recovery(*begun)

    def begin_recovery(self) -> "tuple[subprocess.Popen[str], tuple[str, ...]] | None":
        """Begin what `recover` does; return what `end_recovery` takes, None for an arm in no reflex.

        Until then this arm is not connected: a robot has one client, and a process of its own asks it.
        """
        self._open_robot()
        self.stop()
        state = self._read_idle()
        person = NEEDS_PERSON.get(RobotMode(int(state.robot_mode)))
        if person is not None:
            raise RecoveryRefused(f"{self.called} cannot recover, {person} first")
        names = _latched(state)
        if not names:
            return None
        shut_down(self._requests)  # the traceback of an error may keep the vendor's object alive
        self._robot = None
        return recovery.begin(self.address), names

    def end_recovery(self, process: "subprocess.Popen[str]", names: tuple[str, ...]) -> None:
        """Wait for the end of a recovery from these errors, while other threads go on. Raises as `recover` does."""
        status, said = recovery.end(process)
        self._connect()
        if status == recovery.REFUSED:
            cause = ", ".join(names)
            raise RecoveryRefused(f"{self.called} refused: {said}; the cause persists: {cause}; move the arm out of it")
        if status != recovery.DONE:
            raise HardwareError(f"{self.called} could not be asked to recover: {said}")
        self._configure()

    def close(self) -> None:
        self.stop()
        self._robot = None
        self._limit.close()

    def lose(self, why: str) -> ConnectionLost:
        """Give the arm up, and return what to raise. libfranka would wait for ever for its answer to a stop."""
        shut_down(self._requests)
        self._lost = True
        strange = "" if self.peeked is None else self.peeked.strange
        return ConnectionLost(f"{self.called} {why}{strange}; check power, cable and network, then open it again")

    def _open_robot(self) -> franka.Robot:
        if self._robot is None:
            raise ConnectionLost(f"{self.called} was closed; open it again")
        if self._lost:
            raise ConnectionLost(f"{self.called} was lost; open it again")
        return self._robot

    def _fault(self, error: Exception) -> HardwareError:
        """Leave torque control, as the robot has, and return what to raise."""
        self._lost = isinstance(error, franka.NetworkException)
        with self._limit.within():
            self._control = None
        return self._explained(error, self.called + self.let_go)


def _latched(state: franka.RobotState) -> tuple[str, ...]:
    if int(state.robot_mode) != RobotMode.REFLEX:
        return ()
    return _reasons(state) or ("unknown",)


def _reasons(state: franka.RobotState) -> tuple[str, ...]:
    return names_in(str(state.current_errors)) or names_in(str(state.last_motion_errors))


@contextlib.contextmanager
def _own_schedule() -> Iterator[None]:
    """Undo that libfranka raises its caller to FIFO 99: how a process is scheduled is the process's own business."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, policy, parameters)
