"""Plays a log on an open cell and writes the log of that: the session of a trial, at a pace of its own.

No contact is meant: the judge stops both arms when a pad touches something. Whether the path may be played at a speed
is checked before anything is opened, with the margins of a plan (rtstack.planning.feasibility).
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from rtstack.control.records import POINT
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.planning.feasibility import POSITION_MARGIN_RAD, TORQUE_SHARE, VELOCITY_SHARE, near_misses
from rtstack.playback.path import RAMP_S, STEP_S, ArmPath, LoggedMotion, arm_path, load_motion, pace
from rtstack.playback.source import PlaybackSource
from rtstack.safety.limits import ForcePhase, PairLimits, SafetyLimits
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters
from rtstack.trials.carry_out import PreparedRun
from rtstack.trials.errors import TrialError
from rtstack.trials.result import PlaybackResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import RunContext
from rtstack.trials.sight import object_before
from rtstack.trials.specification import FASTEST, SLOWEST, PlaybackSpecification
from rtstack.trials.start_motion import StartMotion, start_motion
from rtstack.trials.tightening import limits_of_arms

# of a joint from where the log begins, where the arms cannot go there first: a spring of 2000 N/m then pulls with less
# than 20 N, and not at once
NEAR_RAD = 0.01
CLEAR_M = 0.02  # between the balls around a pad and around an object in the cell
SPEED_STEP = 0.05


@dataclass(frozen=True, slots=True)
class Load:
    """The hardest moment of an arm, at_s of the log: its share of what is allowed (1: just allowed); what: in words."""

    what: str
    share: float
    at_s: float


def check_playback(paths: Sequence[ArmPath], speed: float, limits: PairLimits, description: CellDescription) -> None:
    """Refuse what cannot be played at this speed, and what cannot be played at all. Raises TrialError with one line."""
    for path, side, allowed in zip(paths, description.sides, limits, strict=True):
        for load in (*places(path, allowed), *loads(path, speed, allowed)):
            if load.share > 1.0:
                raise TrialError(f"{side} arm, {load.at_s:.2f} s into the log: {load.what}")
    stations = np.stack([path.stations for path in paths])
    for tick, side in near_misses(description, [path.q for path in paths], stations):
        what = f"the {side} arm would touch the table" if side else "the arms would come too near to each other"
        raise TrialError(f"{what}, {tick * STEP_S:.2f} s into the log: it cannot be played on this cell")


def fastest(paths: Sequence[ArmPath], limits: PairLimits, description: CellDescription) -> float:
    """Return the largest speed that may be played, a multiple of SPEED_STEP. Raises TrialError where there is none."""
    check_playback(paths, SLOWEST, limits, description)  # what cannot be played at all says why
    low, high = round(SLOWEST / SPEED_STEP), round(FASTEST / SPEED_STEP)
    while low < high:
        middle = (low + high + 1) // 2
        each = zip(paths, limits, strict=True)
        within = all(load.share <= 1.0 for path, limit in each for load in loads(path, middle * SPEED_STEP, limit))
        low, high = (middle, high) if within else (low, middle - 1)
    return round(low * SPEED_STEP, 2)


def places(path: ArmPath, limits: SafetyLimits) -> list[Load]:
    """Return how near joints and pad come to where they must not be, whatever the speed."""
    room = np.minimum(path.q - limits.q_lower, np.asarray(limits.q_upper) - path.q)
    place = path.stations["position"]
    outside = np.maximum(np.asarray(limits.ee_lower) - place, place - np.asarray(limits.ee_upper))
    found = []
    for over, what in (
        (POSITION_MARGIN_RAD - room, "joint {} is too near to its limit"),
        (outside, "the pad leaves the cell's box (ee_lower, ee_upper) along axis {}"),
    ):
        k, which = np.unravel_index(int(over.argmax()), over.shape)
        words = f"{what.format(int(which) + 1)}: it cannot be played on this cell"
        found.append(Load(words, 1.0 + float(over[k, which]), float(k) * STEP_S))
    return found


def loads(path: ArmPath, speed: float, limits: SafetyLimits) -> list[Load]:
    """Return the hardest moments at a speed: a ramp may be anywhere, since a soft stop may be asked for at any time."""
    ramp = 1.5 * speed / RAMP_S  # largest |d2s/dt2| of a ramp
    dq = speed * path.dq
    upper, lower = limits.dq_upper(path.q), limits.dq_lower(path.q)
    quick = np.where(dq > 0.0, dq / np.maximum(upper, 1e-9), dq / np.minimum(lower, -1e-9))
    moved = np.einsum("nij,nj->ni", path.M, path.ddq) + path.coriolis
    pushed = np.einsum("nij,nj->ni", path.M, path.dq)
    torque = np.abs(speed**2 * moved + path.gravity) + ramp * np.abs(pushed)
    change = speed * np.abs(np.gradient(speed**2 * moved, STEP_S, axis=0))  # gravity is the robot's own
    pad = speed * np.linalg.norm(path.stations["along"][:, :3], axis=1)
    found = []
    for share, allowed, what in (
        (quick, VELOCITY_SHARE, "joint {} would be at {:.2f} times its velocity limit, {:g} is allowed"),
        (torque / limits.tau_max, TORQUE_SHARE, "joint {} would need {:.2f} of its torque, {:g} is allowed"),
        (change / limits.tau_rate_max, TORQUE_SHARE, "joint {}'s torque would change at {:.2f} of its rate, not {:g}"),
        (pad[:, None] / limits.ee_speed_max, VELOCITY_SHARE, "the pad would be at {1:.2f} of ee_speed_max, not {2:g}"),
    ):  # fmt: skip
        k, joint = np.unravel_index(int(share.argmax()), share.shape)
        worst = float(share[k, joint])
        words = what.format(int(joint) + 1, worst, allowed) + f" at speed {speed:g}: play it more slowly"
        found.append(Load(words, worst / allowed, float(k) * STEP_S))
    return found


@dataclass(frozen=True, slots=True)
class PreparedPlayback(PreparedRun[PlaybackResult]):
    """A log that may be played. stations: of each arm; q (arms, 7): where they begin, rad."""

    specification: PlaybackSpecification
    parameters: Parameters
    limits: PairLimits
    stations: tuple[NDArray, ...]
    q: NDArray[np.float64]
    duration_s: float

    def start_motion(self, cell: Cell) -> StartMotion | None:
        """See PreparedRun: to where the log begins. Arms of the plant in this process have to be there already; an
        object that the tracker sees on the pads' way is refused elsewhere, where a person can take it away."""
        if cell.link is None:
            for arm, side, q in zip(cell.arms, cell.sides, self.q, strict=True):
                away = np.abs(arm.read().q - q)
                if away.max() > NEAR_RAD:
                    where = f"{away.max():.2f} rad from where joint {int(away.argmax()) + 1} of the {side} arm is"
                    what = "this cell cannot send its arms there: play it on one behind the Franka Control Interface"
                    raise TrialError(f"{self.specification.source}: it begins {where}, and {what} (--cell)")
            return None
        _look_for_objects(self, cell)
        return start_motion(cell, self.description, "", 0.0, self.start)

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None = None) -> PlaybackResult:
        """See PreparedRun. The context's soft_stop brakes along the path, within a ramp; its stop is the judge's."""
        specification, control = self.specification, self.parameters.control
        paces = pace(self.duration_s, specification.speed)
        source = PlaybackSource(self.stations, paces, context.soft_stop, self.description.sides)
        plan = SessionPlan.from_source(source, control.stiffness, control.period_s, ForcePhase.APPROACH)
        context = context.with_watchdog(source)
        with Run(self.description, self.parameters, plan, self.limits, context, way) as run:
            run.share = lambda: source.share
            outcome = run.follow(cell)
            return run.finished(
                PlaybackResult, outcome.problem, specification, outcome, played_s=source.place_s,
                duration_s=self.duration_s,
                largest_error_mm=source.largest_error_m * 1e3 if source.begun else None,
            )  # fmt: skip

    @property
    def start(self) -> NDArray:
        """The points (arms,) of POINT at which the arms begin."""
        points = np.zeros(len(self.stations), POINT)
        for point, stations in zip(points, self.stations, strict=True):
            for name in ("position", "rotation", "xi"):
                point[name] = stations[0][name]
        return points


def prepare_playback(specification: PlaybackSpecification, description: CellDescription) -> PreparedPlayback:
    """Read a log and look whether it may be played on this cell. Raises TrialError with one line."""
    source = Path(specification.source)
    parameters = cell_parameters(description)
    limits = limits_of_arms(description)
    motion, paths = _paths(source, description, parameters)
    try:
        check_playback(paths, specification.speed, limits, description)
    except TrialError as error:
        raise TrialError(f"{error} ({source})") from None  # the reason first: a page cuts what is long
    return PreparedPlayback(
        replace(specification, digest=hashlib.sha256(source.read_bytes()).hexdigest()), description, parameters, limits,
        tuple(path.stations for path in paths), np.stack([path.q[0] for path in paths]), motion.duration_s,
    )  # fmt: skip


def fastest_playback(source: Path, description: CellDescription) -> float:
    """Return the largest speed at which a log may be played on this cell. Raises TrialError with one line."""
    _, paths = _paths(source, description, cell_parameters(description))
    return fastest(paths, limits_of_arms(description), description)


def _paths(
    source: Path, description: CellDescription, parameters: Parameters
) -> tuple[LoggedMotion, tuple[ArmPath, ...]]:
    motion = load_motion(source, description.sides)
    return motion, tuple(arm_path(motion, k, arm) for k, arm in enumerate(arm_controllers(description, parameters)))


def _look_for_objects(prepared: PreparedPlayback, cell: Cell) -> None:
    pose = object_before(cell, prepared.description)
    if not pose.record["seen"][0]:
        return
    description = prepared.description
    largest = max(float(np.linalg.norm(thing.size)) for thing in description.objects.values())
    clear = 0.5 * (largest + max(float(np.linalg.norm(pad.size)) for pad in description.pads)) + CLEAR_M
    for side, stations in zip(description.sides, prepared.stations, strict=True):
        if np.linalg.norm(stations["position"] - pose.position, axis=1).min() < clear:
            raise TrialError(
                f"the tracker sees an object on the {side} pad's way: nothing is to be met in a playback; take it away"
            )
