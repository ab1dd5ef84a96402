"""The runs of the hour: a hold, and a path of the joints about where the arm stands. Each has the judge at its end."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.cell import Cell
from hal.limits import CONTROL_PERIOD_S
from rtstack.bench.link import LinkBenchmark, bench_link
from rtstack.control.controller import Controller
from rtstack.control.joint_law import JointLaw
from rtstack.control.modes import Strategy
from rtstack.control.parameters import FrictionParameters
from rtstack.loop.end import End
from rtstack.loop.history import Columns
from rtstack.loop.plan import SessionPlan
from rtstack.loop.session import StopSignal
from rtstack.model.cell_description import CellDescription
from rtstack.safety.limits import FORCES_BY_PHASE, ForcePhase
from rtstack.trials.assembly import ControllerRequest, arm_controllers, cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.move import where_arms_stand
from rtstack.trials.result import Result
from rtstack.trials.run import Run
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import SweepSpecification
from rtstack.trials.start_motion import JointPath, MeasuredPoints, StartMotion, _look_along, start_motion
from rtstack.trials.tightening import limits_of_arms

NOTHING = SweepSpecification("", 1, 0)  # an empty cell
# what a cell that is being commissioned may do; the steps stay below it
SPEED_M_S = 0.25
START_RAD_S = 0.15  # joints together, an arm that is stretched: some 0.2 m/s at the pad
LED_RAD = 0.02  # where geometry was not measured: as far as `rtstack wiggle` turns a joint

Path = Callable[[Array], tuple[Array, Array]]  # from q (7,) to q, dq (n, 7): rad, rad/s, a row a millisecond


def capped(description: CellDescription) -> CellDescription:
    """Return the description with the judge's bounds and the way to the start as low as the hour has them: in every
    phase what may be felt where nothing is to be met, 50 N, at which the box's own threshold is at 65 N."""
    safety, start = dict(description.safety), description.start_motion
    most = {"ee_speed_max": SPEED_M_S}
    for what in ("force", "tau_ext"):
        bound = FORCES_BY_PHASE[f"{what}_approach_max"]
        most |= {f"{what}{phase}_max": bound for phase in ("", "_contact", "_approach")}
    safety.update({
        name: np.minimum(safety.get(name, bound), bound).tolist() for name, bound in most.items()
    })  # fmt: skip
    start = replace(start, speed_rad_s=min(start.speed_rad_s, START_RAD_S))
    return replace(description, safety=safety, start_motion=start)


@dataclass(frozen=True, slots=True)
class HoldResult(Result):
    """What a hold has measured."""

    link: LinkBenchmark


@dataclass(frozen=True, slots=True)
class PreparedHold(PreparedRun[HoldResult]):
    """The arm is held softly where it stands for so many ms, then read for `after` ms while its box holds it."""

    led: ClassVar[bool] = True
    ticks: int
    after: int = 0

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> HoldResult:
        figures = bench_link(cell, self.ticks, self.description, context.stop)
        for _ in range(self.after):
            cell.arms[0].read()
        return HoldResult(True, None, figures)


@dataclass(frozen=True, slots=True)
class JointsResult(Result):
    """end: how it ended; columns: of the run without the way to its start; way: that."""

    end: End
    columns: Columns
    way: StartMotion | None
    q: Array = field(default_factory=lambda: np.zeros((0, 7)))


class _Clocked(MeasuredPoints):
    """A point source that knows for how long the arm follows the path, by the robot's time; not on the way to it."""

    @property
    def elapsed_ns(self) -> int:
        return 0 if self._began_ns is None else self._now_ns - self._began_ns


class _StopAfter:
    """A StopSignal that asks for a stop after so many ms of a path, and as soon as the person's does."""

    def __init__(self, person: StopSignal | None, path: _Clocked, milliseconds: int) -> None:
        self._person, self._path, self._after_ns = person, path, milliseconds * 1_000_000

    @property
    def stop_requested(self) -> bool:
        due = self._path.elapsed_ns >= self._after_ns
        return due or (self._person is not None and self._person.stop_requested)


@dataclass(frozen=True, slots=True)
class PreparedJoints(PreparedRun[JointsResult]):
    """The arm follows a path of its joints, by rtstack's law for them, from the points `start` (1,) of POINT, or home.

    stop_after: ms until the same stop is asked for that STOP asks for; 0: none.
    """

    path: Path
    start: NDArray[np.void] | None = None
    stop_after: int = 0

    @property
    def refusal(self) -> str:
        return ""  # its joints are slow: the hour stays below what a cell that is not commissioned may do

    def start_motion(self, cell: Cell) -> StartMotion | None:
        return None if self.led else start_motion(cell, self.description, "", 0.0, self.start)

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> JointsResult:
        description = self.description
        begins = where_arms_stand(description, cell).q[0] if way is None else way.path.goal[0]
        q, dq = self.path(begins)
        self._check(begins, q)
        parameters, limits = cell_parameters(description), limits_of_arms(description)
        control, measured = parameters.control, _Clocked(len(q) * CONTROL_PERIOD_S, 1)
        plan = SessionPlan.from_source(measured, control.stiffness, control.period_s, ForcePhase.APPROACH)
        none = FrictionParameters(scale=0.0)

        def controller(request: ControllerRequest) -> Controller:
            laws = [JointLaw(request.arms[0], q, dq, none)]
            return request.pair(request.modes(Strategy.PROPOSED), laws)

        context = context.with_watchdog(measured)
        if self.stop_after:
            context = replace(context, stop=_StopAfter(context.stop, measured, self.stop_after))
        with Run(description, parameters, plan, limits, context, way, longest=len(q)) as run:
            outcome = run.follow(cell, controller)
            reason = outcome.problem
        return JointsResult(reason is None, reason, outcome.end, run.history.columns(), way, q)

    def _check(self, begins: Array, q: Array) -> None:
        """Refuse a path that leads too near to something. Raises TrialError."""
        if self.led:
            assert np.abs(q - begins).max() <= LED_RAD, "the geometry was not measured: a degree at most"
            return
        arms = arm_controllers(self.description, cell_parameters(self.description))
        for furthest in {tuple(q[i]) for i in (*q.argmin(axis=0), *q.argmax(axis=0))}:
            way = JointPath.between(begins[None], np.array(furthest)[None], self.description.start_motion)
            _look_along(way, arms, self.description, None)


@dataclass(frozen=True, slots=True)
class PreparedJointsHere(PreparedJoints):
    """The same where the arm stands, by a degree at most: its geometry need not have been measured."""

    led: ClassVar[bool] = True


def still(seconds: float) -> Path:
    """Return the path that stays where the arm is."""
    n = max(2, round(seconds / CONTROL_PERIOD_S))
    return lambda q: (np.tile(q, (n, 1)), np.zeros((n, 7)))


def steps(joint: int, radians: float, seconds: float) -> Path:
    """Return a step of one joint (0 to 6) to and back: the wanted torque steps with it, as fast as the judge lets."""

    def path(q: Array) -> tuple[Array, Array]:
        n = round(seconds / CONTROL_PERIOD_S)
        rows = np.tile(q, (3 * n, 1))
        rows[n : 2 * n, joint] += radians * (-1.0 if q[joint] > 0.0 else 1.0)
        return rows, np.zeros_like(rows)

    return path


def sweeps(joint: int, peaks_rad_s: tuple[float, ...], leg_s: float) -> Path:
    """Return one joint (0 to 6) to and fro, each leg a quintic with this peak."""
    from rtstack.references.quintic import ViaPoint, quintic_path

    def path(q: Array) -> tuple[Array, Array]:
        points, t_s = [ViaPoint(0.2, 0.0)], 0.2
        for peak in peaks_rad_s:
            reach = peak * leg_s / 1.875 / 2.0
            for part, place in ((0.5, reach), (1.0, -reach), (1.0, reach), (0.5, 0.0)):
                t_s += part * leg_s
                points.append(ViaPoint(t_s, place))
        t = np.arange(round((t_s + 0.2) / CONTROL_PERIOD_S)) * CONTROL_PERIOD_S
        rows = np.tile(q, (len(t), 1))
        rows[:, joint] += quintic_path(points, t)[0]
        return rows, np.gradient(rows, CONTROL_PERIOD_S, axis=0)

    return path


RAMP_S, CONSTANT_S, BACK_S = 0.4, 0.8, 2.5


def constant_speed(rad_s: float) -> Path:
    """Return joint 1 back by half of a way, then forward over it: for CONSTANT_S at this speed, after RAMP_S."""

    def path(q: Array) -> tuple[Array, Array]:
        x = np.linspace(0.0, 1.0, round(RAMP_S / CONTROL_PERIOD_S))
        up = rad_s * (3.0 * x**2 - 2.0 * x**3)
        forward = np.concatenate([up, np.full(round(CONSTANT_S / CONTROL_PERIOD_S), rad_s), up[::-1]])
        way = np.cumsum(forward) * CONTROL_PERIOD_S
        y = np.linspace(0.0, 1.0, round(BACK_S / CONTROL_PERIOD_S))
        back = -0.5 * way[-1] * (10.0 - 15.0 * y + 6.0 * y**2) * y**3
        rows = np.tile(q, (len(back) + len(way), 1))
        rows[:, 0] += np.concatenate([back, back[-1] + way])
        return rows, np.gradient(rows, CONTROL_PERIOD_S, axis=0)

    return path


STOP_AFTER = round((BACK_S + RAMP_S + 0.5 * CONSTANT_S) / CONTROL_PERIOD_S)
