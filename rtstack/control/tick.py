"""The tick: an arm's state and its setpoint become a torque. Pure: no I/O, no clock, no allocation, no exception.

`ArmController` is one arm's tick in two halves, observe and command; `CellController` joins a cell's arms, one or two,
by the shared mode. Where both states carry one time stamp both are observed before either is commanded, so that the
order cannot matter.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.compilation import bound
from rtstack.control.completion import CompletionDetector
from rtstack.control.controller import ArmLaw, Detector
from rtstack.control.detector import ImpactDetector
from rtstack.control.impedance import note_setpoints
from rtstack.control.modes import ModeMachine
from rtstack.control.observation import force_norm, observe, remember_torque
from rtstack.control.parameters import (
    CompletionParameters,
    ControlParameters,
    DetectorParameters,
    FrictionParameters,
    InertiaParameters,
)
from rtstack.control.qp_law import QpLaw
from rtstack.control.reaction import ReactionMotion
from rtstack.control.records import OBSERVER_PARAMETERS, POINT, SETPOINT, WORKSPACE
from rtstack.control.setpoint import choose
from rtstack.control.watch import TrialMonitor
from rtstack.model.arm_model import ArmModel
from rtstack.safety.limits import HARDWARE, SafetyLimits, control_limits
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, Mode, QpSolver, QpStatus, Reaction

ANTE, INTERIM, POST = 0, 1, 2
NEVER_NS = 2**62
_STOPPING = Mode.STOPPING
_ON_THE_WAY = (Mode.ANTE_IMPACT, Mode.INTERIM, Mode.POST_IMPACT)
# by mode: which references count, -1 where none do
_BLEND = tuple(
    {
        Mode.TELEOPERATION: ANTE,
        Mode.ANTE_IMPACT: ANTE,
        Mode.INTERIM: INTERIM,
        Mode.POST_IMPACT: POST,
        Mode.HOLDING: ANTE,
        Mode.RETREATING: ANTE,
    }.get(mode, -1)
    for mode in Mode
)


def _observer_parameters(
    model: ArmModel, period_s: float, detector: DetectorParameters, inertia: InertiaParameters, own: FrictionParameters
) -> NDArray[np.void]:
    """Return the OBSERVER_PARAMETERS (1,). own: the arm's friction."""
    record = np.zeros(1, OBSERVER_PARAMETERS)
    p = record[0]
    p["face"], p["R_joint_ee"], p["R_world_base"] = model.face, model.R_joint_ee, model.T_world_base[:3, :3]
    p["B_theta"] = inertia.added
    p["p1"], p["p2"], p["p3"], p["friction_scale"] = own.p1, own.p2, own.p3, own.scale
    p["gravity_share"], p["observer_gain_hz"], p["period_s"] = own.gravity_share, inertia.observer_gain_hz, period_s
    for name in ("force_low_n", "force_high_n", "velocity_m_s", "tare_n", "largest_tare_n"):
        p[name] = getattr(detector, name)
    return record


class ArmController:
    """One arm: its model, observer and detector, and as `law` the paper's QP.

    `sample` and `control` are what the log sees of a tick.
    """

    def __init__(
        self,
        model: ArmModel,
        parameters: ControlParameters,
        detector: DetectorParameters,
        inertia: InertiaParameters,
        friction: FrictionParameters,
        solver: QpSolver = QpSolver.PROXQP,
        completion: CompletionParameters | None = None,
        limits: SafetyLimits = HARDWARE,
    ) -> None:
        """limits: the judge's; the controller's are inside them."""
        self.model = model
        self.sample = np.zeros(1, ARM_SAMPLE)
        self.control = np.zeros(1, CONTROL_SAMPLE)
        self.setpoint = np.zeros(1, SETPOINT)
        self.workspace = np.zeros(1, WORKSPACE)
        self.impact = False
        self.detector: Detector | None = None  # in the place of Appendix B's
        self.limits = control_limits(limits, parameters.period_s)
        self.parameters = parameters
        self._observer = _observer_parameters(model, parameters.period_s, detector, inertia, friction)
        self._memory = ImpactDetector(detector, parameters.period_s).memory
        self.tare, self.tared = self._memory.tare, self._memory.frozen
        self.completion = CompletionDetector(completion or CompletionParameters())
        self._blend_interim = parameters.blend_interim
        self._stiffness_after = parameters.stiffness_after_impact
        self._stiffness = self.setpoint["stiffness"][0]
        # views of single fields: looking a field up costs more than writing it
        sample = self.sample[0]
        self._q, self._dq = sample["q"], sample["dq"]
        self._tau_desired, self._tau_applied = sample["tau_desired"], sample["tau_applied"]
        self._t_ns = self.sample["t_ns"]
        self._control_t_ns, self._mode, self._gamma = (self.control[n] for n in ("t_ns", "mode", "gamma"))
        self._qp_status, self._qp_iterations = self.control["qp_status"], self.control["qp_iterations"]
        self._wrench_desired = self.control["wrench_desired"][0]
        work = self.workspace[0]
        self._tau_previous = work["tau_previous"]
        self.follow(np.zeros(1, POINT), np.zeros(1, POINT))
        self.velocity, self._mirrored = work["twist"][:3], np.zeros(3)
        self._force_world, self._rotation = work["force_world"], work["rotation"]
        self._observe = bound(
            observe, self.sample, self.workspace, self.control, self.model.arrays, self._observer, self._memory
        )
        self._remember = bound(remember_torque, self._tau_applied, self._tau_previous)
        self.law = QpLaw(self, solver=solver)

    def observe(self) -> None:
        """Compute kinematics, dynamics, external force, residual and impact of the state in `sample`."""
        self.model.update(self._q, self._dq)
        self.impact = self._observe()
        if self.detector is not None:
            self.impact = self.detector.update(self)

    def observed_at(self, q: Array, dq: Array | None = None) -> np.void:
        """Observe the arm at q (7,) rad and dq (7,) rad/s, by default as in `sample`; return its workspace. Never in a
        tick."""
        self._q[:] = q
        if dq is not None:
            self._dq[:] = dq
        self.observe()
        return self.workspace[0]

    def in_contact(self, t_s: float, other: "ArmController | None") -> bool:
        """Whether this arm's pad, as last observed, is in lasting contact. Evaluated in each tick that waits for it.

        other: whose pad presses on the same object; None: the pad presses on something that stands still.
        """
        against = self._mirrored if other is None else other.velocity
        if other is None:  # the whole speed counts, as that of two pads that meet in the middle
            np.negative(self.velocity, out=against)
        return self.completion.update(t_s, self._force_world, self._rotation, self.velocity, against)

    def command(self, mode: Mode) -> QpStatus:
        """Find tau_desired in `sample` for the setpoint by the paper's QP; `rest` in modes without references."""
        return self.rest() if _BLEND[mode] < 0 else self.law.command(mode)

    def rest(self) -> QpStatus:
        """Keep the last torque."""
        self._qp_status[0] = QpStatus.NOT_USED
        self._qp_iterations[0] = 0
        self._wrench_desired[:] = 0.0
        self._tau_desired[:] = self._tau_previous
        return QpStatus.NOT_USED

    def pursue(self, stiffness: Array, posture_gain: float) -> None:
        """Set how hard setpoints are pursued from now on: stiffness (6,) N/m and Nm/rad (1/s^2 for acceleration tasks),
        posture gain 1/s^2."""
        self.setpoint["stiffness"][0] = stiffness
        self.setpoint["acceleration_tasks"] = self.parameters.acceleration_tasks
        self.setpoint["posture_gain"][0] = posture_gain

    def choose(self, index: int, machine: ModeMachine) -> None:
        """Write the setpoint from the references that are followed, at the tick `index`, held at the end."""
        mode = machine.mode
        blend = _BLEND[mode]
        if blend == INTERIM and not self._blend_interim:
            blend = POST
        if blend > ANTE and self._stiffness_after is not None:
            self._stiffness[:] = self._stiffness_after
        index = index if index < self._last else self._last
        self._choose(index, blend if blend > ANTE else ANTE, mode, machine.gamma, machine.velocity_weight)

    def follow(self, ante: NDArray[np.void], post: NDArray[np.void]) -> None:
        """Follow the references ante and post, (n,) of POINT, from now on. Before a clock runs: they are looked up."""
        self._last = len(ante) - 1
        self._choose = bound(
            choose, self.setpoint, self.workspace, self.sample, self.control, ante, post, later=(0, 0, 0, 0.0, 0.0)
        )

    def pursue_reaction(self, reaction: ReactionMotion, side: int, t_s: float) -> None:
        """Write the setpoint from a reaction to an unexpected impact."""
        reaction.ask(side, self.setpoint, t_s)
        self._mode[0] = reaction.mode
        self._gamma[0] = 0.0
        self._control_t_ns[0] = self._t_ns[0]

    def applied(self) -> None:
        """Remember what the safety judge let through: the next torque starts from there."""
        self._remember()


class CellController:
    """A cell's arms, one or two, and the mode that they share. laws: of each arm's torque, by default its own QP."""

    def __init__(
        self,
        arms: Sequence[ArmController],
        machine: ModeMachine,
        monitor: TrialMonitor | None = None,
        reaction: ReactionMotion | None = None,
        laws: Sequence[ArmLaw] | None = None,
    ) -> None:
        self.laws = laws
        self.arms = tuple(arms)
        self._laws: tuple[ArmLaw, ...] = tuple(laws or (arm.law for arm in self.arms))
        self.machine = machine
        self.monitor = monitor
        self.impact_s = [-1.0] * len(self.arms)  # when each arm's detector first fired, s; negative: it has not
        self.first_impact_s = -1.0
        self.reaction_over = False
        self._reaction = reaction
        # the detector's force is counted from its mean before the window in which the impact is awaited
        until_s = machine.nominal_impact_s - machine.parameters.exclusion_s
        self._tare_until_ns = round(until_s * 1e9) if until_s > 0.0 else NEVER_NS
        self._note = tuple(bound(note_setpoints, arm.setpoint, arm.control) for arm in self.arms)
        self._force_norm = bound(force_norm, tuple(arm.control for arm in self.arms))
        if monitor is not None:
            for side, arm in enumerate(self.arms):
                monitor.bind(side, arm.sample, arm.workspace, arm.control)

    def follow(self, ante: NDArray[np.void], post: NDArray[np.void], stiffness: Array) -> None:
        """Look up where the references (arms, n) are, before a clock runs; see `pursue`."""
        for side, arm in enumerate(self.arms):
            arm.pursue(stiffness, arm.parameters.posture_gain)
            arm.follow(ante[side], post[side])
            if self.laws is not None:
                self.laws[side].follow(ante[side], post[side])

    def observe(self, side: int, elapsed_ns: int) -> None:
        """Observe one arm: read the state from its sample. elapsed_ns: since the start."""
        arm = self.arms[side]
        if elapsed_ns >= self._tare_until_ns:
            arm.tared[0] = 1
        arm.observe()
        if self.laws is not None:
            self.laws[side].observe()
        self.watch(side, elapsed_ns)

    def watch(self, side: int, elapsed_ns: int) -> None:
        """Let the monitor see what an arm has observed, so long after its start, unless the arms stop."""
        if self.monitor is not None and self.machine.mode is not _STOPPING:
            self.monitor.watch[side](elapsed_ns)

    def decide(self, t_s: float) -> None:
        """Advance the shared mode after the observations of this tick. t_s: time since the start of the reference."""
        impact = False
        for arm in self.arms:
            impact = impact or arm.impact
        if impact:
            self._remember_impact(t_s)
        machine = self.machine
        machine.update(t_s, impact, machine.waiting and self.contact_complete(t_s))
        if self.monitor is not None and self._reaction is not None and self.monitor.unexpected:
            self._react(t_s, self._reaction, self.monitor)

    def _remember_impact(self, t_s: float) -> None:
        if self.first_impact_s < 0.0:
            self.first_impact_s = t_s
        for side, arm in enumerate(self.arms):
            if arm.impact and self.impact_s[side] < 0.0:
                self.impact_s[side] = t_s

    def _react(self, t_s: float, reaction: ReactionMotion, monitor: TrialMonitor) -> None:
        """React in the tick of the verdict, once."""
        if self.machine.reacting:
            self.reaction_over = reaction.over(t_s)
        elif self.machine.mode in _ON_THE_WAY:
            if reaction.reaction is Reaction.STOP:
                self.reaction_over = True  # the session brakes, in this tick
            elif reaction.reaction is not Reaction.CONTINUE:
                self.machine.react(reaction.begin(t_s, monitor.since_contact_s(t_s)))
                for side, arm in enumerate(self.arms):
                    reaction.take_over(side, arm.setpoint)

    def choose(self, side: int, elapsed_ns: int, index: int) -> None:
        """Write the setpoint of an arm: of the references at the tick `index`, or of a reaction."""
        arm = self.arms[side]
        if self._reaction is not None and self.machine.reacting:
            arm.pursue_reaction(self._reaction, side, elapsed_ns * 1e-9)
        else:
            arm.choose(index, self.machine)

    def command(self, side: int, elapsed_ns: int, index: int) -> QpStatus:
        """Choose an arm's setpoint at the reference's tick `index`, and write its tau_desired."""
        self.choose(side, elapsed_ns, index)
        mode = self.machine.mode
        if _BLEND[mode] < 0:
            return self.arms[side].rest()
        if self.laws is not None:
            self._note[side]()
        return self._laws[side].command(mode)

    def contact_complete(self, t_s: float) -> bool:
        """Whether each pad is in lasting contact, with the other one's newest state where there are two."""
        first, last = self.arms[0], self.arms[-1]
        if first is last:
            return first.in_contact(t_s, None)
        return first.in_contact(t_s, last) & last.in_contact(t_s, first)  # both are asked: each keeps its own time

    def finish(self) -> None:
        """Write what concerns the arms together."""
        self._force_norm()
