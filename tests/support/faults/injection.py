"""What goes wrong in the controller, in the driver and around the loop, done between a state and its answer."""

import os
import resource
import signal
import time
from types import SimpleNamespace

import numpy as np
import psutil

import rtstack.control.program as solvers
from hal.state import ArmState
from rtstack.control.program import DaqpProgram, ProxqpProgram, SecondOpinion
from rtstack.control.tick import ArmController
from rtstack.samples import Mode, QpStatus
from tests.support.faults.stage import Stage

TICK_NS = 1_000_000


def _after_command(stage: Stage, spoil) -> None:
    """From now on do something to the left arm's desired torque, (7,), after the controller has found it."""
    arm: ArmController = stage.controller.arms[0]
    command = arm.law.command

    def spoilt(mode: Mode) -> QpStatus:
        status = command(mode)
        spoil(arm.sample["tau_desired"][0])
        return status

    arm.law.command = spoilt


# the controller


def exception(stage: Stage) -> None:
    """Raise in the middle of the tick."""

    def broken(mode: Mode) -> QpStatus:
        raise ZeroDivisionError("a defect of the controller")

    stage.controller.arms[0].law.command = broken


def nan_torque(stage: Stage) -> None:
    """Desire a torque that is no number."""

    def spoil(tau: np.ndarray) -> None:
        tau[2] = np.nan

    _after_command(stage, spoil)


def huge_torque(stage: Stage) -> None:
    """Desire 200 Nm of joint 1, for good."""

    def spoil(tau: np.ndarray) -> None:
        tau[0] = 200.0

    _after_command(stage, spoil)


def _solver(stage: Stage, program: solvers.Program) -> None:
    """Give the left arm another solver, and a problem that needs one: limits that its torque cannot keep."""
    arm = stage.controller.arms[0]
    arm.law.program = program
    arm.limits["tau_J_max"] = 1e-3


class _Contradiction:
    """A problem whose bounds contradict each other, for the real solvers."""

    def __init__(self, real: solvers.Program) -> None:
        self._real = real

    def solve(self, H, gradient, lower, upper, A, row_lower, row_upper, x):
        return self._real.solve(H, gradient, lower, lower - 1.0, A, row_lower, row_upper, x)


def qp_infeasible(stage: Stage) -> None:
    """Ask both solvers for what is impossible."""
    _solver(stage, _Contradiction(SecondOpinion(ProxqpProgram(), DaqpProgram())))


def qp_exhausted(stage: Stage) -> None:
    """Give both solvers one iteration."""
    solvers.DAQP_ITERATIONS = 1
    first = ProxqpProgram()
    first._qp.settings.max_iter = first._qp.settings.max_iter_in = 1
    _solver(stage, SecondOpinion(first, DaqpProgram()))


class _LyingProxqp:
    """ProxQP that is wrong, and says that it has solved the problem."""

    def __init__(self, real) -> None:
        self._real = real
        self.init, self.update, self.solve, self.cleanup = real.init, real.update, real.solve, real.cleanup

    @property
    def results(self) -> SimpleNamespace:
        found = self._real.results
        solved = solvers.proxsuite.proxqp.QPSolverOutput.PROXQP_SOLVED
        info = SimpleNamespace(iter=found.info.iter, status=solved)
        return SimpleNamespace(x=found.x + 5.0, z=found.z, info=info)


class _LyingDaqp:
    """daqp, likewise."""

    def __init__(self, real) -> None:
        object.__setattr__(self, "_real", real)

    def __getattr__(self, name):
        return getattr(self._real, name)

    def __setattr__(self, name, value) -> None:
        setattr(self._real, name, value)

    def solve(self):
        x, objective, _, info = self._real.solve()
        return x + 5.0, objective, 1, info


def qp_wrong(stage: Stage) -> None:
    """Let both solvers give wrong answers that they call solved."""
    first, second = ProxqpProgram(), DaqpProgram()
    first._qp, second._model = _LyingProxqp(first._qp), _LyingDaqp(second._model)
    _solver(stage, SecondOpinion(first, second))


def overrun(stage: Stage) -> None:
    """Let each tick take 30 ms from now on."""
    arm = stage.controller.arms[0]
    command = arm.law.command

    def slow(mode: Mode) -> QpStatus:
        time.sleep(0.03)  # the fault itself
        return command(mode)

    arm.law.command = slow


# the driver


def driver_time_back(stage: Stage) -> None:
    """Stamp the left arm's states 5 ms earlier from now on, as a driver that confuses two clocks would."""
    arm = stage.cell.arms[0]
    read = arm.read

    def confused() -> ArmState:
        state = read()
        state.record["t_ns"] -= 5 * TICK_NS
        return state

    arm.read = confused
    stage.seen_from = stage.tick + 1


# around the loop


def _end_by_force(process: psutil.Process, stage: Stage) -> None:
    process.send_signal(signal.SIGKILL)
    while not stage.apart and process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
        time.sleep(1e-3)


def kill_robot(stage: Stage) -> None:
    """Kill the simulated robot."""
    _end_by_force(psutil.Process(stage.simulator.pid), stage)
    stage.seen_from = stage.tick + 1


def kill_log(stage: Stage) -> None:
    """Kill the log process."""
    _end_by_force(stage.log_process, stage)
    stage.seen_from = stage.tick + 1


def stop_log(stage: Stage) -> None:
    """Freeze the log process: it lives, and reads nothing any more."""
    stage.log_process.send_signal(signal.SIGSTOP)
    stage.frozen.append(stage.log_process)


def fill_disk(stage: Stage) -> None:
    """Let the log's file grow no further."""
    size = os.path.getsize(stage.log_path)
    resource.prlimit(stage.log_process.pid, resource.RLIMIT_FSIZE, (size, size))


def operator_gone(stage: Stage) -> None:
    """The operator's last sign of life is longer ago than the lease allows."""
    stage.signs.operator_leaves()


def console_gone(stage: Stage) -> None:
    """The console's last sign of life is longer ago than it may be."""
    stage.signs.console_leaves()


def stop_asked(stage: Stage) -> None:
    """Somebody presses stop."""
    stage.mailbox.request_stop()


def parent_gone(stage: Stage) -> None:
    """Kill who has started this process: the matrix puts a process between itself and each case for that."""
    parent = os.getppid()
    os.kill(parent, signal.SIGKILL)
    while os.getppid() == parent:
        time.sleep(1e-3)
