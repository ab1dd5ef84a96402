"""Process replay: the states of a log go through the present controller and judge, and the torques are compared.

The session is the one that made the log (rtstack.trials.run), on a cell that shows the logged states: what the present
code makes of them differs from what the log has where the law, a number or a rounding has changed. A motion that would
have changed with the torque does not: from the first difference on, the states are those of the old torques.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from hal.configuration import ConfigurationError
from rtstack.control.modes import Strategy
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.loop.end import End
from rtstack.loop.history import Columns
from rtstack.loop.session import SessionPlan
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.playback.logged_cell import LoggedGuide, LoggedStop, logged_cell
from rtstack.safety.limits import ForcePhase
from rtstack.samples import SIDES, Reaction
from rtstack.trials.assembly import cell_parameters, following
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import followed_file
from rtstack.trials.provenance import git_commit
from rtstack.trials.record import RunSamples
from rtstack.trials.review import log_columns
from rtstack.trials.run import Run
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification
from rtstack.trials.tightening import limits_of_arms
from rtstack.trials.trial import prepare_trial, run_trial

OURS = ("tau_desired", "tau_applied")  # of an arm's sample: all others are the robot's
# an end that nothing in the states shows: the log says when
OUTSIDE = (End.STOP_REQUESTED, End.CONSOLE_GONE, End.OPERATOR_GONE, End.RELEASED, End.CLUTCH_QUIET, End.POLICY_QUIET,
           End.PARENT_GONE, End.LOG_FAILED)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Difference:
    """A field that differs: in how many ticks, first in which, there by which value, and the largest difference."""

    side: str
    field: str
    ticks: int
    first_tick: int
    logged: float
    replayed: float
    largest: float


@dataclass(frozen=True, slots=True)
class Replay:
    """ticks: of the log, and of the replay, which is shorter where it stops earlier. commits: that made the log, and
    that replays it. differences: of all fields, the earliest first; none: every bit is the same."""

    log: str
    kind: str
    ticks: int
    replayed_ticks: int
    commits: tuple[str, str]
    differences: tuple[Difference, ...]

    @property
    def same(self) -> bool:
        """Whether the controller made the same of every state."""
        return not self.differences and self.ticks == self.replayed_ticks

    def as_dict(self) -> dict[str, Any]:
        """Return the replay as JSON-ready values."""
        return asdict(self) | {"same": self.same}


def replay(path: Path) -> Replay:
    """Replay a log of a trial, a demonstration or a teleoperation. Raises TrialError with one line."""
    run = read_run(path)
    columns = run.columns
    cell, left = logged_cell(run.log.metadata["trial"].get("cell", "log"), columns)
    replayed = run.again(lambda _folder, _description: cell, LoggedStop(columns, left))
    trial = run.log.metadata["trial"]
    n, m = columns.arm.shape[1], replayed.arm.shape[1]
    commits = trial.get("git_commit", "unknown"), git_commit()
    return Replay(str(path), run.kind, n, m, commits, compared(columns, replayed))


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """A log whose commands can be run again. asked: its specification."""

    log: Log
    columns: Columns
    kind: str
    asked: dict[str, Any]

    def again(self, opened: Callable[[Path, CellDescription], Cell], stop: LoggedStop) -> Columns:
        """Return the samples of the session that made the log, on another cell.

        opened: the cell, of a folder with the log's cell.toml and of its description. stop: used where the log's end
        came from outside of the tick.
        """
        reason = self.log.metadata.get("result", {}).get("failure_reason", "")
        outside = self.kind not in ("trial", "demonstration") or any(str(end) in reason for end in OUTSIDE)
        kept = RunSamples(self.log.path)
        with TemporaryDirectory() as name:
            folder = Path(name)
            description = _description(self.log, folder)
            context = RunContext(kept, stop=stop if outside else None)
            cell = opened(folder, description)
            try:
                RUNS[self.kind](self.log, dict(self.asked), description, cell, context, folder)
            finally:
                cell.close()
        assert kept.columns is not None
        return kept.columns


def read_run(path: Path) -> LoggedRun:
    """Read a log to be run again. Raises TrialError with one line."""
    try:
        log = read_log(path)
        columns = log_columns(log)
    except LogError as error:
        raise TrialError(str(error)) from None
    trial = log.metadata.get("trial", {})
    kind = trial.get("kind", "unknown")
    if kind not in RUNS:
        raise TrialError(f"{path}: its kind is {kind}; what is replayed are logs of {', '.join(RUNS)}")
    if not columns.arm.shape[1]:
        raise TrialError(f"{path}: it has no samples of both arms: there is nothing to replay")
    return LoggedRun(log, columns, kind, json.loads(trial["specification"]))


def compared(logged: Columns, replayed: Columns) -> tuple[Difference, ...]:
    """Return the fields that differ, tick by tick, as far as both go."""
    n = min(logged.arm.shape[1], replayed.arm.shape[1])
    found = []
    for k, side in enumerate(SIDES):
        pairs = [(name, logged.arm[k][name], replayed.arm[k][name]) for name in OURS]
        pairs += [(name, logged.control[k][name], replayed.control[k][name])
                  for name in logged.control.dtype.names or () if name != "t_ns"]  # fmt: skip
        found += [each for name, a, b in pairs if (each := _difference(side, name, a[:n], b[:n])) is not None]
    return tuple(sorted(found, key=lambda each: each.first_tick))


def _difference(side: str, name: str, logged: NDArray, replayed: NDArray) -> Difference | None:
    a, b = (values.reshape(len(values), -1).astype(np.float64) for values in (logged, replayed))
    other = (a != b) & ~(np.isnan(a) & np.isnan(b))
    if not other.any():
        return None
    rows = np.flatnonzero(other.any(axis=1))
    tick = int(rows[0])
    column = int(np.flatnonzero(other[tick])[0])
    label = f"{name}[{column}]" if a.shape[1] > 1 else name
    largest = float(np.nanmax(np.abs(np.where(other, a - b, 0.0))))
    return Difference(side, label, len(rows), tick, float(a[tick, column]), float(b[tick, column]), largest)


def _description(log: Log, folder: Path) -> CellDescription:
    """Return the description of the cell that the log has inside."""
    attached = next((each.data for each in log.attachments if each.name == "cell.toml"), None)
    if attached is None:
        raise TrialError(f"{log.path}: no description of its cell is attached")
    path = folder / "cell.toml"
    path.write_bytes(attached)
    try:
        return load_cell_description(path)
    except ConfigurationError as error:
        raise TrialError(f"{log.path}: its cell's description: {error}") from None


def _trial(
    log: Log, asked: dict[str, Any], description: CellDescription, cell: Cell, context: RunContext, folder: Path
) -> None:  # fmt: skip
    reference = folder / "reference.mcap"
    reference.write_bytes(followed_file(log, asked["reference"])[1])
    asked |= {"reference": str(reference), "safety": tuple(asked["safety"].items())}
    asked["reaction"] = Reaction(asked["reaction"])
    specification = TrialSpecification(**asked)
    run_trial(replace(prepare_trial(specification, description), specification=specification), cell, context)


def _demonstration(
    log: Log, asked: dict[str, Any], description: CellDescription, cell: Cell, context: RunContext, folder: Path
) -> None:  # fmt: skip
    run_demonstration(DemonstrationSpecification(**asked), description, cell, context)


def _by_hand(
    log: Log, asked: dict[str, Any], description: CellDescription, cell: Cell, context: RunContext, folder: Path
) -> None:  # fmt: skip
    parameters = cell_parameters(description)
    control = parameters.control
    guide = LoggedGuide(log_columns(log))
    plan = SessionPlan.guided(guide, control.stiffness_teleoperation, control.period_s, ForcePhase.CONTACT)
    with Run(description, parameters, plan, limits_of_arms(description), context, None) as run:
        run.follow(cell, following(Strategy.PROPOSED), 0.0)
        run.close({})


RUNS: dict[str, Callable[[Log, dict[str, Any], CellDescription, Cell, RunContext, Path], None]] = {
    "trial": _trial, "demonstration": _demonstration, "teleoperation": _by_hand, "recording": _by_hand,
}  # fmt: skip
