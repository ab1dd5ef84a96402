"""The result of a run (contract): the JSON that `--json` prints and the metadata record `result` of the log."""

import json
from dataclasses import asdict, dataclass
from typing import Any

from rtstack.loop.watchdogs import slow_tick


@dataclass(frozen=True, slots=True)
class Result:
    """What every run says of itself. failure_reason: in one line, None for a success."""

    success: bool
    failure_reason: str | None

    def as_dict(self) -> dict[str, Any]:
        """Return the result as JSON-ready values."""
        return asdict(self)

    def as_json(self) -> str:
        """Return the result as one line of JSON."""
        return json.dumps(self.as_dict())


@dataclass(frozen=True, slots=True)
class TrialResult(Result):
    """What came out of a trial. Times in s since the start of the trial, forces in N, None where nothing happened.
    average_force_norm is the mean of (33) over the 200 ms around the nominal impact time; _linear_n its force part
    alone; they and peak_force_norm are None where a controller has written no wrench_desired. peak_torque_ratio and
    peak_velocity_ratio are the largest |tau_J| and |dq| over their limits. success: the object was held until release
    and no safety limit was hit; without a tracker (object_observed is false) that is told from the pads. impact_verdict
    is expected, unexpected or none (not known before the trial ended), None where no monitor judged; impact_reason is
    the first condition that was not met and impact_kind what it probably was; impact_margin is 1 where all was as meant
    and negative beyond a bound. real_time_factor: robot's seconds over the host's, from the first tick to the last,
    logging included. plain_python: tasks and limits of an arm's QP that are not compiled, with their time in a tick."""

    controller: str
    object: str
    displacement_mm: float
    seed: int
    cell: str
    nominal_impact_time_s: float
    detected_impact_time_s: float | None
    impact_verdict: str | None
    average_force_norm: float | None
    average_force_norm_linear_n: float | None
    peak_force_norm: float | None
    max_lift_mm: float | None
    peak_torque_ratio: float
    peak_velocity_ratio: float
    ticks: int
    missed_deadlines: int
    compute_us_p50: float
    compute_us_p99: float
    safety_interventions: int
    real_time_factor: float
    log: str | None
    impact_reason: str | None = None
    impact_kind: str | None = None
    impact_margin: float | None = None
    impact_verdict_time_s: float | None = None
    displacement_x_mm: float = 0.0
    yaw_deg: float = 0.0
    object_observed: bool = True
    plain_python: str | None = None

    @property
    def warning(self) -> str:
        """In one line that its ticks were too slow for arms at 1 kHz, "" where they were not."""
        return slow_tick(self.compute_us_p50)

    def as_dict(self) -> dict[str, Any]:
        """See Result; with `warning` where there is one."""
        return asdict(self) | ({"warning": self.warning} if self.warning else {})


@dataclass(frozen=True, slots=True)
class DemonstrationResult(Result):
    """What came out of a demonstration: a recording with an impact in it, or why not."""

    object: str
    variation: int
    seed: int
    cell: str
    detected_impact_time_s: float | None
    max_lift_mm: float | None
    ticks: int
    missed_deadlines: int
    safety_interventions: int
    log: str | None


@dataclass(frozen=True, slots=True)
class TeleoperationResult(Result):
    """What came out of a teleoperation. success: it ended as the operator wanted it, and the judge changed no torque.
    recorded: it was meant as a recording, moved: the clutch was held. Whether a reference can be made from it is found
    when it is read."""

    object: str
    seed: int
    operator: str
    recorded: bool
    moved: bool
    cell: str
    detected_impact_time_s: float | None
    duration_s: float
    missed_deadlines: int
    safety_interventions: int
    log: str | None


@dataclass(frozen=True, slots=True)
class PlaybackResult(Result):
    """What came out of a playback. success: the log was played to its end, nothing was met, no torque was changed.
    played_s: how far, s of the log's time, of duration_s; largest_error_mm: of a pad from where it was to be."""

    source: str
    speed: float
    seed: int
    cell: str
    played_s: float
    duration_s: float
    largest_error_mm: float | None
    missed_deadlines: int
    safety_interventions: int
    log: str | None


@dataclass(frozen=True, slots=True)
class PlacementResult(Result):
    """What came out of placing an object. carried: the motion went to its end. off_mm, off_deg: how far the object
    stands from where it was wanted, as the tracker sees it, None where it does not; short_x_mm, short_y_mm,
    short_yaw_deg: the way from there to where it was wanted. peak_force_n: the largest estimated force on a pad."""

    object: str
    x_mm: float
    y_mm: float
    yaw_deg: float
    cell: str
    carried: bool
    off_mm: float | None
    off_deg: float | None
    short_x_mm: float | None
    short_y_mm: float | None
    short_yaw_deg: float | None
    peak_force_n: float
    missed_deadlines: int
    safety_interventions: int
    log: str | None


@dataclass(frozen=True, slots=True)
class MoveResult(Result):
    """What came out of a motion that an operator asked for. lowered_mm: how far what was held came down."""

    motion: str
    object: str
    cell: str
    lowered_mm: float
    missed_deadlines: int
    safety_interventions: int
    log: str | None


@dataclass(frozen=True, slots=True)
class GuideResult(Result):
    """What came out of moving the arms by hand. beyond_before, beyond_after: a line for each limit that they stood
    beyond. pads: where the middle of each pad's face is at the end, (2, 3) m in the world, left before right."""

    cell: str
    pads: tuple[tuple[float, ...], ...]
    beyond_before: tuple[str, ...]
    beyond_after: tuple[str, ...]
    safety_interventions: int
    log: str | None
