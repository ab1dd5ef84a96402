"""What a log says about its trial, recomputed from its samples."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtstack.control.parameters import DetectorParameters
from rtstack.log.analysis.derived import base_pose
from rtstack.log.analysis.lateness import Lateness, lateness_of
from rtstack.log.errors import LogError
from rtstack.log.reader import Event, Log, read_log
from rtstack.log.time_of_day import TimeOfDay, iso, time_of_day
from rtstack.loop.history import Columns
from rtstack.references.motion import Motion
from rtstack.samples import SIDES
from rtstack.trials.record import logged_urdfs
from rtstack.trials.scoring import Score, SuccessCriterion, score


@dataclass(frozen=True, slots=True)
class Review:
    """kind: trial or demonstration; recorded: the result in the log; score: the same from the samples, None for a
    demonstration; sides: of the arms that it has; first_contact_s: of each of them, s since the first sample; fault:
    what ended the session, where it was one; lateness: who was late, where each arm had a clock of its own. start_ns:
    robot's time of the first message; time: how the robot's times are UTC, None where the log does not have it."""

    path: Path
    kind: str
    duration_s: float
    complete: bool
    trial: dict[str, str]
    recorded: dict[str, str]
    score: Score | None
    first_contact_s: tuple[float | None, ...]
    events: tuple[Event, ...]
    sides: tuple[str, ...] = SIDES
    fault: dict[str, str] | None = None
    lateness: Lateness | None = None
    start_ns: int = 0
    time: TimeOfDay | None = None

    def utc(self, t_ns: int) -> str | None:
        """Return a time of the log, ns, as UTC, ISO 8601; None where the log does not have it."""
        return None if self.time is None else iso(self.time.unix_ns(t_ns))

    def as_dict(self) -> dict[str, Any]:
        """Return the review as JSON-ready values."""
        values = asdict(replace(self, lateness=None))
        values["path"], values["utc"] = str(self.path), self.utc(self.start_ns)
        values["lateness"] = None if self.lateness is None else self.lateness.as_dict()
        values["events"] = [
            {"t_s": e.t_ns * 1e-9, "utc": self.utc(e.t_ns), "level": e.level.name, "name": e.name, "text": e.text}
            for e in self.events
        ]
        return values


def review_log(path: Path) -> Review:
    """Read a log and score it again. Raises LogError."""
    log = read_log(path)
    trial = log.metadata.get("trial", {})
    recorded = log.metadata.get("result", {})
    columns = log_columns(log)
    start_t_ns = int(columns.arm[0]["t_ns"][0]) if columns.arm.shape[1] else 0
    values = None
    if "nominal_impact_s" in trial:
        detected = recorded.get("detected_impact_time_s", "null")
        bases = [pose for side in log.sides if (pose := base_pose(log, side)) is not None]
        values = score(
            columns,
            start_t_ns,
            float(trial["nominal_impact_s"]),
            float(trial["release_s"]),
            None if detected == "null" else float(detected),
            SuccessCriterion(),
            Motion(trial.get("motion", Motion.GRAB)),
            logged_urdfs(log.attachments),
            tuple(bases) if len(bases) == len(log.sides) else None,
            recorded.get("object_observed") == "false",
        )
    return Review(
        path=Path(path),
        kind=trial.get("kind", "unknown"),
        duration_s=log.duration_s,
        complete=log.complete,
        trial=dict(trial),
        recorded=dict(recorded),
        score=values,
        first_contact_s=tuple(_first_contact(columns, k, start_t_ns) for k in range(len(columns.arm))),
        events=log.events,
        sides=log.sides,
        fault=log.metadata.get("fault"),
        lateness=lateness_of(log),
        start_ns=log.start_ns,
        time=time_of_day(log),
    )


def has_succeeded(path: Path) -> bool:
    """Return whether there is a log of a run that has succeeded."""
    try:
        return read_log(path).metadata.get("result", {}).get("success") == "true"
    except LogError:
        return False


def log_columns(log: Log) -> Columns:
    """Return the samples of a log as the columns that a run keeps in memory, cut to the shortest topic."""
    return Columns.read(log.topic)


def _first_contact(columns: Columns, arm: int, start_t_ns: int) -> float | None:
    """First time at which the arm's external force exceeds what the detector calls a force."""
    force: NDArray[np.float64] = np.linalg.norm(columns.arm[arm]["O_F_ext_hat_K"][:, :3], axis=1)
    hits = np.flatnonzero(force > DetectorParameters().force_high_n)
    return float((columns.arm[arm]["t_ns"][hits[0]] - start_t_ns) * 1e-9) if len(hits) else None
