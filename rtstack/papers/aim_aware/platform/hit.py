"""One hit: the tick of the real arms for one of them, with the monitor in the loop that switches its references."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic.dataclasses import dataclass as checked

from hal.arm import Arm
from hal.configuration import STRICT, NotNegative, Positive
from hal.errors import HardwareError
from hal.pad import Pad
from hal.state import ARM_STATE
from rtstack.control.modes import ModeMachine, Strategy
from rtstack.control.parameters import ControlParameters
from rtstack.control.tick import ArmController, make_arm_controller
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting, tool_of
from rtstack.monitor.monitor import Monitor
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.platform.plan import HitPlan
from rtstack.safety.judge import Cause, SafetyJudge
from rtstack.safety.limits import hardware_limits
from rtstack.samples import Mode, QpStatus

Six = tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]

# what a tick leaves: time ns since the first one; rad, rad/s; residual Nm; the pad's face m, m/s and rad/s; torque Nm;
# post: 1 once the references have switched
TICK = np.dtype(
    [
        ("t_ns", "i8"),
        ("q", "f8", 7),
        ("dq", "f8", 7),
        ("residual", "f8", 7),
        ("position", "f8", 3),
        ("twist", "f8", 6),
        ("tau_d", "f8", 7),
        ("post", "i8"),
    ]
)


@checked(frozen=True, slots=True, config=STRICT)
class HitGains:
    """Stiffness (6,) N/m, Nm/rad of the impedance before and after the impact; of the posture 1/s^2.

    What has no stiffness has no damping: along it the arm presses, or gives way.
    """

    stiffness: Six
    pressing: Six
    posture: Positive


@dataclass(frozen=True, slots=True)
class Hit:
    """ticks (n,) of TICK; stopped: why the robot or the safety judge has ended it, empty where it was not stopped."""

    ticks: NDArray[np.void]
    stopped: str = ""


@dataclass(frozen=True, slots=True)
class Hitter:
    """The arm as its user describes it."""

    mounting: ArmMounting
    pad: Pad
    gains: HitGains

    def controller(self) -> ArmController:
        """Return a fresh controller, which knows nothing of the arm's own parameters."""
        return make_arm_controller(ArmModel(self.mounting, self.pad), ControlParameters())

    def judge(self) -> SafetyJudge:
        """Return a fresh judge, within the hardware's limits."""
        limits = hardware_limits(self.mounting.robot)
        return SafetyJudge(limits, self.mounting.base, tool_of(self.pad))


def hit(arm: Arm, hitter: Hitter, plan: HitPlan, monitoring: MonitorParameters, until: int | None = None) -> Hit:
    """Follow the plan on the arm, which waits at its start, for `until` ticks at most.

    The references switch in the tick in which the monitor sees the first impact (9); from then on the pad presses down.
    """
    controller, judge = hitter.controller(), hitter.judge()
    machine = ModeMachine(Strategy.NO_INTERIM, controller.parameters, plan.t_d_s)
    monitor = Monitor(monitoring)
    monitor.expect(round(plan.t_d_s * 1e9), plan.q_d)
    machine.begin(Mode.ANTE_IMPACT)
    gains = hitter.gains
    controller.pursue(np.array(gains.stiffness), gains.posture)
    controller.follow(plan.ante, plan.post)
    sample, control, work = controller.sample, controller.control, controller.workspace
    state = sample.view(np.uint8)[: ARM_STATE.itemsize]
    residual = control["momentum_residual"][0]
    ticks = np.zeros(len(plan.dq_post) if until is None else until, TICK)
    start_ns = -1
    for k in range(len(ticks)):
        try:
            state[:] = arm.read().record.view(np.uint8)
        except HardwareError as error:
            return Hit(ticks[:k], str(error))
        start_ns = int(sample["t_ns"][0]) if start_ns < 0 else start_ns
        t_ns = int(sample["t_ns"][0]) - start_ns
        controller.observe()
        monitor.update(t_ns, residual, sample["q"][0], sample["dq"][0], plan.dq_post[k])
        machine.update(t_ns * 1e-9, bool(monitor.state["impact"][0]))
        if machine.mode is Mode.POST_IMPACT:
            controller.pursue(np.array(gains.pressing), gains.posture)
        controller.choose(k, machine)
        status = controller.command(machine.mode)
        judge.judge(sample, Cause.CONTROLLER if status > QpStatus.SOLVED else Cause.NONE, residual)
        if judge.stopping:
            return Hit(ticks[:k], judge.explanation)
        try:
            arm.write(sample["tau_applied"][0])
        except HardwareError as error:
            return Hit(ticks[:k], str(error))
        controller.applied()
        tick = ticks[k]
        tick["t_ns"], tick["post"] = t_ns, machine.mode is Mode.POST_IMPACT
        for name in ("q", "dq"):
            tick[name] = sample[name][0]
        tick["residual"], tick["tau_d"] = residual, sample["tau_applied"][0]
        tick["position"], tick["twist"] = work["position"][0], work["twist"][0]
    return Hit(ticks)
