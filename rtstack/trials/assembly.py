"""Puts a controller together: models, arms, judges, with everything compiled before the robot is armed."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rtstack.control.controller import ArmLaw, Controller
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
from rtstack.safety.judge import SafetyJudge, pair_of_judges
from rtstack.safety.limits import PairLimits
from rtstack.samples import Mode, QpSolver, Reaction
from rtstack.trials.friction import load_friction
from rtstack.trials.tightening import limits_of_arms

_WARM: set[object] = set()  # whose code has run in this process: which laws, without or with a monitor


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
    left, right = (FrictionParameters.of(model) for model in description.robots)
    parameters = replace(default_parameters(), friction=(left, right))
    gains = {name: value for name, value in asdict(description.gains).items() if value is not None}
    arrays = {name: np.array(value) if isinstance(value, tuple) else value for name, value in gains.items()}
    parameters = replace(parameters, control=replace(parameters.control, **arrays))
    if description.joint_friction is None:
        return parameters
    return replace(parameters, friction=load_friction(description.joint_friction))


def arm_controllers(
    cell: CellDescription, parameters: Parameters, limits: PairLimits | None = None
) -> tuple[ArmController, ArmController]:
    """Return the left and the right arm's controllers, inside the judge's `limits`, by default those of the cell."""
    left, right = (
        ArmController(
            ArmModel(mounting, cell.pad),
            parameters.control,
            parameters.detector,
            replace(parameters.inertia, B_theta=mounting.robot.B_theta),
            friction,
            parameters.solver,
            parameters.completion,
            judged,
        )
        for mounting, friction, judged in zip(
            (cell.left, cell.right), parameters.friction, limits or limits_of_arms(cell), strict=True
        )
    )
    return left, right


def safety_judges(cell: CellDescription, limits: PairLimits | None = None) -> tuple[SafetyJudge, SafetyJudge]:
    """Return the left and the right arm's judges, by default within the hardware's limits as the cell tightens them."""
    return pair_of_judges(limits or limits_of_arms(cell), cell.left.base, cell.right.base, cell.tools)


@dataclass(frozen=True, slots=True)
class ControllerRequest:
    """What a controller is made from: the cell, its numbers, and both arms' observation, fresh for this session.

    arms: (left, right). nominal_impact_s: of the reference, from its start. watched: None where no monitor watches.
    """

    cell: CellDescription
    parameters: Parameters
    arms: tuple[ArmController, ArmController]
    nominal_impact_s: float
    watched: Watched | None = None

    def modes(self, strategy: Strategy) -> ModeMachine:
        """Return the mode machine of a strategy."""
        return ModeMachine(strategy, self.parameters.control, self.nominal_impact_s)

    def pair(self, machine: ModeMachine, laws: tuple[ArmLaw, ArmLaw] | None = None) -> DualArmController:
        """Return both arms with these modes, the trial's monitor and its reaction. laws: instead of our QP."""
        if self.watched is None:
            return DualArmController(*self.arms, machine, laws=laws)
        w = self.watched
        monitor = TrialMonitor(w.tuning, w.impact, self.parameters.control.period_s)
        return DualArmController(
            *self.arms, machine, monitor, ReactionMotion(w.reaction, w.approach, w.start), laws=laws
        )


ControllerFactory = Callable[[ControllerRequest], Controller]


def following(strategy: Strategy) -> ControllerFactory:
    """Return the factory of our QP with a strategy's modes."""

    def make(request: ControllerRequest) -> DualArmController:
        return request.pair(request.modes(strategy))

    return make


def dual_arm_controller(
    cell: CellDescription, parameters: Parameters, factory: ControllerFactory, nominal_impact_s: float,
    watched: Watched | None = None, limits: PairLimits | None = None,
) -> Controller:  # fmt: skip
    """Return a fresh controller, warm: its code has run once in this process, on another one that is then forgotten."""

    def controller(impact_s: float) -> Controller:
        arms = arm_controllers(cell, parameters, limits)
        return factory(ControllerRequest(cell, parameters, arms, impact_s, watched))

    made = controller(nominal_impact_s)
    ours = isinstance(made, DualArmController) and made.laws is None
    code = (None if ours else factory, watched is None)
    if code not in _WARM:
        _warm_up(controller(0.0), cell)
        _WARM.add(code)
    return made


def _warm_up(controller: Controller, cell: CellDescription) -> None:
    points = np.zeros((2, 1), POINT)
    judges = safety_judges(cell)
    for side, (arm, mounting) in enumerate(zip(controller.arms, (cell.left, cell.right), strict=True)):
        arm.sample["q"][0] = mounting.home
        controller.observe(side, 0)
        points["position"][side] = arm.workspace["position"][0]
        points["rotation"][side] = arm.workspace["rotation"][0]
    controller.follow(points, points, arm.parameters.stiffness)
    controller.machine.mode = Mode.ANTE_IMPACT
    for side, (arm, judge) in enumerate(zip(controller.arms, judges, strict=True)):
        controller.command(side, 0, 0)
        if isinstance(arm, ArmController):
            # the solver's first call allocates: have it done, with limits that cannot hold
            arm.limits["tau_J_max"] = 1e-3
            arm.command(Mode.ANTE_IMPACT)
            arm.pursue_reaction(ReactionMotion(Reaction.HOLD, np.zeros((2, 3)), np.zeros((2, 3))), 0, 0.0)
        judge.judge(arm.sample, residual=arm.control["momentum_residual"][0])
    controller.decide(0.0)
    controller.finish()
    if isinstance(controller, DualArmController):
        controller.contact_complete(0.0)
