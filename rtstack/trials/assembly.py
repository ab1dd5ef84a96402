"""Puts a controller together: models, arms, judges, with everything compiled before the robot is armed."""

from dataclasses import asdict, dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rtstack.control.modes import ModeMachine, Strategy
from rtstack.control.parameters import (
    CompletionParameters,
    ControlParameters,
    DetectorParameters,
    FrictionParameters,
    InertiaParameters,
)
from rtstack.control.reaction import ReactionMotion
from rtstack.control.records import POINT
from rtstack.control.tick import ArmController, DualArmController
from rtstack.control.watch import TrialMonitor
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.monitor.expected import ExpectedImpact
from rtstack.monitor.pair import PairParameters
from rtstack.safety.judge import Base, SafetyJudge, Tool, pair_of_judges
from rtstack.safety.limits import SafetyLimits
from rtstack.samples import Mode, QpSolver, Reaction
from rtstack.trials.friction import load_friction
from rtstack.trials.specification import Controller
from rtstack.trials.tightening import safety_limits

STRATEGIES = {
    Controller.PROPOSED: Strategy.PROPOSED,
    Controller.NO_REFERENCE_SPREADING: Strategy.NO_REFERENCE_SPREADING,
    Controller.NO_VELOCITY_FEEDBACK: Strategy.NO_VELOCITY_FEEDBACK,
    Controller.NO_INTERIM: Strategy.NO_INTERIM,
    Controller.CONTACT_COMPLETION: Strategy.CONTACT_COMPLETION,
}
_WARM: set[bool] = set()  # whether the code has run in this process, without and with a monitor


@dataclass(frozen=True, slots=True)
class Watched:
    """What a trial's monitor needs: its tuning, what to expect, and what an unexpected impact leads to.

    approach (2, 3): m/s, of the pads where they meet the object; start (2, 3): m, where they begin.
    """

    tuning: PairParameters
    impact: ExpectedImpact
    reaction: Reaction
    approach: NDArray[np.float64]
    start: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameters:
    """All numbers of a controller. friction: of the left and of the right arm."""

    control: ControlParameters
    detector: DetectorParameters
    inertia: InertiaParameters
    friction: tuple[FrictionParameters, FrictionParameters]
    solver: QpSolver = QpSolver.PROXQP
    completion: CompletionParameters = field(default_factory=CompletionParameters)


def default_parameters() -> Parameters:
    """Return the papers' numbers."""
    published = FrictionParameters()
    return Parameters(ControlParameters(), DetectorParameters(), InertiaParameters(), (published, published))


def cell_parameters(description: CellDescription) -> Parameters:
    """Return the papers' numbers, with the cell's own gains and identified friction where its description has them.

    Raises ConfigurationError.
    """
    parameters = default_parameters()
    gains = {name: value for name, value in asdict(description.gains).items() if value is not None}
    arrays = {name: np.array(value) if isinstance(value, tuple) else value for name, value in gains.items()}
    parameters = replace(parameters, control=replace(parameters.control, **arrays))
    if description.joint_friction is None:
        return parameters
    return replace(parameters, friction=load_friction(description.joint_friction))


def arm_controllers(cell: CellDescription, parameters: Parameters) -> tuple[ArmController, ArmController]:
    """Return the left and the right arm's controllers."""
    left, right = (
        ArmController(
            ArmModel(mounting, cell.pad),
            parameters.control,
            parameters.detector,
            parameters.inertia,
            friction,
            parameters.solver,
            parameters.completion,
        )
        for mounting, friction in zip((cell.left, cell.right), parameters.friction, strict=True)
    )
    return left, right


def safety_judges(cell: CellDescription, limits: SafetyLimits | None = None) -> tuple[SafetyJudge, SafetyJudge]:
    """Return the left and the right arm's judges, by default within the hardware's limits as the cell tightens them."""
    left, right = (Base(m.base_position, m.base_orientation_wxyz) for m in (cell.left, cell.right))
    tool = Tool(cell.pad.size, cell.pad.flange_to_face)
    return pair_of_judges(limits or safety_limits(cell), left, right, tool)


def dual_arm_controller(
    cell: CellDescription, parameters: Parameters, strategy: Strategy, nominal_impact_s: float,
    watched: Watched | None = None,
) -> DualArmController:  # fmt: skip
    """Return a fresh controller, warm: its code has run once in this process, on another one that is then forgotten."""
    period_s = parameters.control.period_s

    def controller(impact_s: float) -> DualArmController:
        machine = ModeMachine(strategy, parameters.control, impact_s)
        arms = arm_controllers(cell, parameters)
        if watched is None:
            return DualArmController(*arms, machine)
        monitor = TrialMonitor(watched.tuning, watched.impact, period_s)
        return DualArmController(
            *arms, machine, monitor, ReactionMotion(watched.reaction, watched.approach, watched.start)
        )

    if (watched is None) not in _WARM:
        _warm_up(controller(0.0), cell)
        _WARM.add(watched is None)
    return controller(nominal_impact_s)


def _warm_up(controller: DualArmController, cell: CellDescription) -> None:
    point = np.zeros(1, POINT)
    judges = safety_judges(cell)
    for arm, mounting, judge in zip(controller.arms, (cell.left, cell.right), judges, strict=True):
        arm.sample["q"][0] = mounting.home
        arm.observe()
        controller.watch(0, 0)
        arm.follow(point, point)
        point["position"][0] = arm.workspace["position"][0]
        point["rotation"][0] = arm.workspace["rotation"][0]
        controller.machine.mode = Mode.ANTE_IMPACT
        arm.pursue(arm.parameters.stiffness, arm.parameters.posture_gain)
        arm.choose(0, controller.machine)
        arm.command(Mode.ANTE_IMPACT)
        # the solver's first call allocates: have it done, with limits that cannot hold
        arm.tau_max[:] = 1e-3
        arm.command(Mode.ANTE_IMPACT)
        arm.pursue_reaction(ReactionMotion(Reaction.HOLD, np.zeros((2, 3)), np.zeros((2, 3))), 0, 0.0)
        judge.judge(arm.sample, residual=arm.control["momentum_residual"][0])
    controller.contact_complete(0.0)
    controller.finish()
