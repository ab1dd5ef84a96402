"""Builds controllers and judges. All code is compiled before the robot is armed."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hal.extensions import blaming, defined_at, require
from rtstack.control.controller import ArmLaw, Controller, Detector
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
from rtstack.control.tick import ArmController, CellController
from rtstack.control.watch import TrialMonitor
from rtstack.loop.fault import plug_ins_of
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.monitor.expected import ExpectedImpact
from rtstack.monitor.pair import PairParameters
from rtstack.safety.judge import SafetyJudge, judges_of
from rtstack.safety.limits import PairLimits
from rtstack.samples import LawInertia, Mode, QpSolver, QpStatus, Reaction
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import load_friction
from rtstack.trials.tightening import limits_of_arms

_WARM: set[object] = set()  # (law, detector, monitored, arms) whose code has run in this process


@dataclass(frozen=True, slots=True)
class Watched:
    """What a trial's monitor needs: its tuning, the expected impact, and the reaction to an unexpected one. approach
    (2, 3): velocity of the pads at the nominal impact, m/s. start (2, 3): their first position, m. Both world."""

    tuning: PairParameters
    impact: ExpectedImpact
    reaction: Reaction
    approach: NDArray[np.float64]
    start: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameters:
    """All numbers of a controller. friction: of each arm."""

    control: ControlParameters
    detector: DetectorParameters
    inertia: InertiaParameters
    friction: tuple[FrictionParameters, ...]
    solver: QpSolver = QpSolver.PROXQP
    completion: CompletionParameters = field(default_factory=CompletionParameters)


def default_parameters() -> Parameters:
    """Return the papers' numbers."""
    published = FrictionParameters()
    return Parameters(ControlParameters(), DetectorParameters(), InertiaParameters(), (published, published))


def cell_parameters(description: CellDescription) -> Parameters:
    """Return the papers' numbers, with the cell's own gains, law and identified friction. Raises ConfigurationError."""
    friction = tuple(map(FrictionParameters.of, description.robots))
    parameters = with_law(replace(default_parameters(), friction=friction), description.gains.law_inertia)
    gains = {name: value for name, value in asdict(description.gains).items() if value is not None}
    del gains["law_inertia"]
    arrays = {name: np.array(value) if isinstance(value, tuple) else value for name, value in gains.items()}
    parameters = replace(parameters, control=replace(parameters.control, **arrays))
    if description.joint_friction is None:
        return parameters
    return replace(parameters, friction=load_friction(description.joint_friction, description.sides))


def with_law(parameters: Parameters, law_inertia: LawInertia | None) -> Parameters:
    """Return the parameters with this inertia in the controller's law; None: unchanged."""
    if law_inertia is None:
        return parameters
    return replace(parameters, inertia=replace(parameters.inertia, law_inertia=law_inertia))


def arm_controllers(
    cell: CellDescription, parameters: Parameters, limits: PairLimits | None = None
) -> tuple[ArmController, ...]:
    """Return the controller of each arm. limits: the judge's, by default those of the cell."""
    friction = parameters.friction[: len(cell.arms)]
    return tuple(
        ArmController(
            ArmModel(mounting, cell.pad),
            parameters.control,
            parameters.detector,
            replace(parameters.inertia, B_theta=mounting.robot.B_theta),
            own,
            parameters.solver,
            parameters.completion,
            judged,
        )
        for mounting, own, judged in zip(cell.arms, friction, limits or limits_of_arms(cell), strict=True)
    )


def safety_judges(cell: CellDescription, limits: PairLimits | None = None) -> tuple[SafetyJudge, ...]:
    """Return the judge of each arm. limits: by default the hardware's as tightened by the cell."""
    return judges_of(limits or limits_of_arms(cell), cell.bases, cell.tools)


@dataclass(frozen=True, slots=True)
class ControllerRequest:
    """What a controller is made from: cell, parameters, and its arms, left before right, new for this session.
    nominal_impact_s: of the reference, from its start. watched: None without a monitor."""

    cell: CellDescription
    parameters: Parameters
    arms: tuple[ArmController, ...]
    nominal_impact_s: float
    watched: Watched | None = None

    def modes(self, strategy: Strategy) -> ModeMachine:
        """Return the mode machine of a strategy."""
        return ModeMachine(Strategy(strategy), self.parameters.control, self.nominal_impact_s)

    def pair(self, machine: ModeMachine, laws: Sequence[ArmLaw] | None = None) -> CellController:
        """Return the arms with these modes, monitor and reaction. laws: one an arm, in the place of the QP."""
        if self.watched is None:
            return CellController(self.arms, machine, laws=laws)
        w = self.watched
        monitor = TrialMonitor(w.tuning, w.impact, self.parameters.control.period_s)
        return CellController(self.arms, machine, monitor, ReactionMotion(w.reaction, w.approach, w.start), laws=laws)


ControllerFactory = Callable[[ControllerRequest], Controller]
DetectorFactory = Callable[[ArmController], Detector | None]
"""Makes the impact detector of an arm, new for each run; None: the one of Appendix B, which is in the observation."""


def following(strategy: Strategy) -> ControllerFactory:
    """Return the factory of the QP controller with a strategy's modes."""
    return lambda request: request.pair(request.modes(strategy))


def cell_controller(
    cell: CellDescription, parameters: Parameters, factory: ControllerFactory, nominal_impact_s: float,
    watched: Watched | None = None, limits: PairLimits | None = None, detector: DetectorFactory | None = None,
) -> Controller:  # fmt: skip
    """Return a new controller whose code has already run once in this process, on a controller that is discarded."""

    def controller() -> Controller:
        arms = arm_controllers(cell, parameters, limits)
        if detector is not None:
            with blaming("the impact detector cannot be made", detector, error=TrialError):
                for arm in arms:
                    arm.detector = detector(arm)
                    if arm.detector is not None:
                        require(arm.detector, "update")
        request = ControllerRequest(cell, parameters, arms, nominal_impact_s, watched)
        with blaming("the controller cannot be made", factory, error=TrialError):
            made = factory(request)
            require(made, "follow", "observe", "decide", "command", "finish")
            laws = getattr(made, "laws", None) or ()
            if laws and len(laws) != len(cell.arms):
                raise TypeError(f"it has {len(laws)} laws for {len(cell.arms)} arms")
            for law in laws:
                require(law, "follow", "observe", "command")
        return made

    made = controller()
    ours = isinstance(made, CellController) and made.laws is None and not defined_at(factory)
    own_detector = detector if any(getattr(arm, "detector", None) is not None for arm in made.arms) else None
    code = (None if ours else factory, own_detector, watched is None, len(made.arms))
    if code not in _WARM:
        with blaming(
            "the controller fails in its first tick, before any arm moves", *plug_ins_of(made), error=TrialError
        ):
            _warm_up(controller(), cell)
        _WARM.add(code)
    return made


def _warm_up(controller: Controller, cell: CellDescription) -> None:
    """Call a controller once as a session does in its first tick, at home, and compile what only later ticks need."""
    points = np.zeros((len(cell.arms), 1), POINT)
    judges = safety_judges(cell)
    for side, (arm, mounting) in enumerate(zip(controller.arms, cell.arms, strict=True)):
        arm.sample["q"][0] = mounting.home
        model, state = arm.model, arm.sample[0]
        model.update(state["q"], state["dq"])
        points["position"][side] = model.p7 + model.R7 @ model.face
        points["rotation"][side] = model.R7 @ model.R_joint_ee
    controller.follow(points, points, controller.arms[0].parameters.stiffness)
    controller.machine.begin(Mode.ANTE_IMPACT)
    for side, arm in enumerate(controller.arms):
        controller.observe(side, 0)
        if not isinstance(arm.impact, bool | np.bool_):
            by = "update of the impact detector returned" if getattr(arm, "detector", None) else "observe set impact to"
            raise TypeError(f"{by} {arm.impact!r}, not True or False")
    controller.decide(0.0)
    for side in range(len(cell.arms)):
        if (status := controller.command(side, 0, 0)) not in tuple(QpStatus):
            raise TypeError(f"command returned {status!r}, not a QpStatus")
    controller.finish()
    for arm, judge in zip(controller.arms, judges, strict=True):
        if isinstance(arm, ArmController):
            # The solver's first call allocates: force it now, by limits that cannot hold.
            arm.limits["tau_J_max"] = 1e-3
            arm.command(Mode.ANTE_IMPACT)
            arm.pursue_reaction(ReactionMotion(Reaction.HOLD, np.zeros((2, 3)), np.zeros((2, 3))), 0, 0.0)
        judge.judge(arm.sample, residual=arm.control["momentum_residual"][0])
    if isinstance(controller, CellController):
        controller.contact_complete(0.0)
