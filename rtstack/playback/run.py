"""Plays a log on an open cell and writes the log of that: the session of a trial, at a pace of its own.

Nothing is meant to be met: the object is left out of it, and a pad that touches something has the judge stop both arms.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from rtstack.control.modes import Strategy
from rtstack.control.records import POINT
from rtstack.loop.session import SessionPlan
from rtstack.model.cell_description import CellDescription
from rtstack.playback.guide import PlaybackGuide, SoftStop
from rtstack.playback.limits import check_playback, check_speed, fastest
from rtstack.playback.motion import LoggedMotion, load_motion
from rtstack.playback.pace import pace
from rtstack.playback.path import ArmPath, arm_path
from rtstack.safety.limits import ForcePhase, PairLimits
from rtstack.samples import SIDES
from rtstack.trials.assembly import Parameters, arm_controllers, cell_parameters, following
from rtstack.trials.errors import TrialError
from rtstack.trials.look import object_before
from rtstack.trials.result import PlaybackResult
from rtstack.trials.run import Run
from rtstack.trials.run_context import NO_CONTEXT, RunContext
from rtstack.trials.scoring import failure_reason
from rtstack.trials.specification import PlaybackSpecification
from rtstack.trials.start_motion import StartMotion, start_motion
from rtstack.trials.tightening import limits_of_arms

NO_OBJECT = ""  # what a cell is opened with
# of a joint from where the log begins, where the arms cannot go there first: a spring of 2000 N/m then pulls with less
# than 20 N, and not at once
NEAR_RAD = 0.01
CLEAR_M = 0.02  # between the balls around a pad and around an object in the cell


@dataclass(frozen=True, slots=True)
class PreparedPlayback:
    """A log that may be played: nothing is open and nothing written yet. stations: of both arms; q (2, 7): where they
    begin, rad."""

    specification: PlaybackSpecification
    description: CellDescription
    parameters: Parameters
    limits: PairLimits
    stations: tuple[NDArray, NDArray]
    q: NDArray[np.float64]
    duration_s: float

    @property
    def start(self) -> NDArray:
        """The points (2,) of POINT at which the arms begin."""
        points = np.zeros(2, POINT)
        for point, stations in zip(points, self.stations, strict=True):
            for name in ("position", "rotation", "xi"):
                point[name] = stations[0][name]
        return points


def prepare_playback(specification: PlaybackSpecification, description: CellDescription) -> PreparedPlayback:
    """Read a log and look whether it may be played on this cell. Raises TrialError with one line."""
    check_speed(specification.speed)
    source = Path(specification.source)
    parameters = cell_parameters(description)
    limits = limits_of_arms(description)
    motion, paths = _paths(source, description, parameters)
    try:
        check_playback(paths, specification.speed, limits, description)
    except TrialError as error:
        raise TrialError(f"{error} ({source})") from None  # the reason first: a page cuts what is long
    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    return PreparedPlayback(
        replace(specification, digest=digest), description, parameters, limits,
        (paths[0].stations, paths[1].stations), np.stack([path.q[0] for path in paths]), motion.duration_s,
    )  # fmt: skip


def fastest_playback(source: Path, description: CellDescription) -> float:
    """Return the largest speed at which a log may be played on this cell. Raises TrialError with one line."""
    _, paths = _paths(source, description, cell_parameters(description))
    return fastest(paths, limits_of_arms(description), description)


def _paths(
    source: Path, description: CellDescription, parameters: Parameters
) -> tuple[LoggedMotion, tuple[ArmPath, ArmPath]]:
    motion = load_motion(source)
    arms = arm_controllers(description, parameters)
    return motion, (arm_path(motion, 0, arms[0]), arm_path(motion, 1, arms[1]))


def way_to_start(prepared: PreparedPlayback, cell: Cell) -> StartMotion | None:
    """Return the way to where the log begins, None where the arms are there. Raises TrialError, HardwareError.

    Arms that cannot be sent there, those of the plant in this process, have to be there already. An object that the
    tracker sees on the pads' way is refused, where there is a person who can take it away.
    """
    if cell.link is None:
        for arm, side, q in zip((cell.left, cell.right), SIDES, prepared.q, strict=True):
            away = np.abs(arm.read().q - q)
            if away.max() > NEAR_RAD:
                raise TrialError(
                    f"{prepared.specification.source}: it begins {away.max():.2f} rad from where joint "
                    f"{int(away.argmax()) + 1} of the {side} arm is, and this cell cannot send its arms there: play "
                    "it on one behind the Franka Control Interface (--cell)"
                )
        return None
    _look_for_objects(prepared, cell)
    return start_motion(cell, prepared.description, NO_OBJECT, 0.0, prepared.start)


def _look_for_objects(prepared: PreparedPlayback, cell: Cell) -> None:
    pose = object_before(cell, prepared.description)
    if not pose.record["seen"][0]:
        return
    description = prepared.description
    largest = max(float(np.linalg.norm(thing.size)) for thing in description.objects.values())
    clear = 0.5 * (largest + max(float(np.linalg.norm(pad.size)) for pad in description.pads)) + CLEAR_M
    for side, stations in zip(SIDES, prepared.stations, strict=True):
        if np.linalg.norm(stations["position"] - pose.position, axis=1).min() < clear:
            raise TrialError(
                f"the tracker sees an object on the {side} pad's way: nothing is to be met in a playback; take it away"
            )


def run_playback(
    prepared: PreparedPlayback,
    cell: Cell,
    context: RunContext = NO_CONTEXT,
    *,
    soft_stop: SoftStop | None = None,
    way: StartMotion | None = None,
) -> PlaybackResult:
    """Play a prepared log on an open cell. Closes the log, not the cell.

    soft_stop: along the path, within a ramp, where the context's stop is the judge's, at once. way: to where the log
    begins, gone before its first tick.
    """
    specification, control = prepared.specification, prepared.parameters.control
    guide = PlaybackGuide(prepared.stations, pace(prepared.duration_s, specification.speed), soft_stop)
    plan = SessionPlan.guided(guide, control.stiffness, control.period_s, ForcePhase.APPROACH)
    context = context.with_watchdog(guide)
    with Run(prepared.description, prepared.parameters, plan, prepared.limits, context, way) as run:
        run.share = lambda: guide.share
        outcome = run.follow(cell, following(Strategy.PROPOSED), 0.0)
        reason = failure_reason(outcome.end, outcome.detail, outcome.safety_interventions)
        result = PlaybackResult(
            success=reason is None,
            failure_reason=reason,
            source=specification.source,
            speed=specification.speed,
            seed=specification.seed,
            cell=cell.name,
            played_s=guide.place_s,
            duration_s=prepared.duration_s,
            largest_error_mm=guide.largest_error_m * 1e3 if guide.begun else None,
            missed_deadlines=outcome.missed_deadlines,
            safety_interventions=outcome.safety_interventions,
            log=run.log_name,
        )
        return run.finished(result)
