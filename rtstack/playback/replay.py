"""Process replay: give the states of a log to the present controller and judge, and compare the torques.

Runs the session that made the log (rtstack.trials.run) on a cell that returns the logged states. Its output differs
from the logged one if the law, a number or a rounding has changed; from then on the states no longer belong to it. On
the simulated robot of a profile, such as a twin's, the loop is closed: the twin answers the torques of the same
session, with the same reference or the logged setpoints of arms that were led by hand.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.configuration import ConfigurationError
from hal.cell import Cell
from rtstack.cells import open_cell, with_profile
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.loop.end import OUTSIDE
from rtstack.loop.history import Columns
from rtstack.loop.plan import SessionPlan
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.playback.logged_cell import LoggedSource, LoggedStop, logged_cell
from rtstack.safety.limits import ForcePhase
from rtstack.samples import SIDES, LawInertia
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import followed_file
from rtstack.trials.provenance import git_commit
from rtstack.trials.record import RunSamples
from rtstack.trials.review import log_columns
from rtstack.trials.run import Run
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import Specification, specification_of
from rtstack.trials.tightening import limits_of_arms
from rtstack.trials.trial import prepare_trial, run_trial

OURS = ("tau_desired", "tau_applied")  # what controller and judge write into an arm's sample
FREE_TICKS = 300  # a log begins away from everything: what the estimate shows then is no contact
CONTACT_N = 5.0  # of the estimated force: what of the log counts as contact
AT_HOME_RAD = 0.02  # arms that are led by hand begin there, or the simulated ones would jump
OTHER_ARM = 1 << 20  # added to the log's seed: what is not identified of a simulated arm must not be that of the log's


@dataclass(frozen=True, slots=True)
class Difference:
    """A field that differs: number of ticks, the first one with both values, and the largest difference."""

    side: str
    field: str
    ticks: int
    first_tick: int
    logged: float
    replayed: float
    largest: float


@dataclass(frozen=True, slots=True)
class Replay:
    """commits: of the log and of this code. differences: of all fields, the earliest first. replayed_ticks: fewer than
    ticks if the replay stops earlier."""

    log: str
    kind: str
    ticks: int
    replayed_ticks: int
    commits: tuple[str, str]
    differences: tuple[Difference, ...]

    @property
    def same(self) -> bool:
        """True if the replayed controller gives the logged output in every tick."""
        return not self.differences and self.ticks == self.replayed_ticks

    def as_dict(self) -> dict[str, Any]:
        """Return the replay as JSON-ready values."""
        return asdict(self) | {"same": self.same}


def replay(path: Path) -> Replay:
    """Replay a log of a trial, a demonstration or a teleoperation. Raises TrialError with one line."""
    run = read_run(path)
    columns, trial = run.columns, run.log.metadata["trial"]
    cell = logged_cell(trial.get("cell", "log"), columns, run.log.sides)
    replayed = run.again(lambda _folder, _description: cell)
    n, m = columns.arm.shape[1], replayed.arm.shape[1]
    commits = trial.get("git_commit", "unknown"), git_commit()
    return Replay(str(path), run.kind, n, m, commits, compared(columns, replayed, run.log.sides))


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """A log whose session can be run again."""

    log: Log
    columns: Columns
    kind: str
    asked: Specification

    def again(self, opened: Callable[[Path, CellDescription], Cell]) -> Columns:
        """Run the session on another cell and return its samples; an end from outside comes in the log's tick.
        opened: opens the cell, given a folder with the log's cell.toml, and its description."""
        reason = self.log.metadata.get("result", {}).get("failure_reason", "")
        outside = self.kind not in ("trial", "demonstration") or any(str(end) in reason for end in OUTSIDE)
        kept = RunSamples(self.log.path)
        with TemporaryDirectory() as name:
            folder = Path(name)
            description = _description(self.log, folder)
            context = RunContext(kept, stop=LoggedStop(self.columns) if outside else None)
            with closing(opened(folder, description)) as cell:
                RUNS[self.kind](self.log, self.asked, description, cell, context, folder)
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
        raise TrialError(f"{path}: it has no samples of an arm: there is nothing to replay")
    try:
        return LoggedRun(log, columns, kind, specification_of(trial))
    except TrialError as error:
        raise TrialError(f"{path}: {error}") from None


def compared(logged: Columns, replayed: Columns, sides: Sequence[str] = SIDES) -> tuple[Difference, ...]:
    """Return the fields that differ, over the ticks that both have. sides: of the arms of both."""
    n = min(logged.arm.shape[1], replayed.arm.shape[1])
    found = []
    for k, side in enumerate(sides):
        pairs = [(name, logged.arm[k][name], replayed.arm[k][name]) for name in OURS]
        pairs += [(name, logged.control[k][name], replayed.control[k][name])
                  for name in logged.control.dtype.names or () if name != "t_ns"]  # fmt: skip
        found += [each for name, a, b in pairs if (each := _difference(side, name, a[:n], b[:n])) is not None]
    return tuple(sorted(found, key=lambda each: each.first_tick))


def _difference(side: str, name: str, logged: NDArray, replayed: NDArray) -> Difference | None:
    a, b = (values.reshape(len(values), -1).astype(np.float64) for values in (logged, replayed))
    other = (a != b) & ~(np.isnan(a) & np.isnan(b))
    rows = np.flatnonzero(other.any(axis=1))
    if not len(rows):
        return None
    tick, column = int(rows[0]), int(np.flatnonzero(other[rows[0]])[0])
    label = f"{name}[{column}]" if a.shape[1] > 1 else name
    largest = float(np.nanmax(np.abs(np.where(other, a - b, 0.0))))
    return Difference(side, label, len(rows), tick, float(a[tick, column]), float(b[tick, column]), largest)


def _description(log: Log, folder: Path) -> CellDescription:
    """Return the cell's description that is attached to the log, with the law that the log names; one without a name
    was made with M + B_theta. Raises TrialError."""
    attached = log.attachment("cell.toml")
    if attached is None:
        raise TrialError(f"{log.path}: no description of its cell is attached")
    path = folder / "cell.toml"
    path.write_bytes(attached)
    try:
        description = load_cell_description(path).only(log.sides)
    except (ConfigurationError, ValueError) as error:
        raise TrialError(f"{log.path}: its cell's description: {error}") from None
    name = log.metadata["trial"].get("law_inertia", LawInertia.LINKS_AND_MOTORS)
    try:
        return replace(description, gains=replace(description.gains, law_inertia=LawInertia(name)))
    except ValueError:
        names = " or ".join(LawInertia)
        raise TrialError(f"{log.path}: its controller's law_inertia is {name}; this version has {names}") from None


def _trial(log: Log, asked: Any, description: CellDescription, cell: Cell, context: RunContext, folder: Path) -> None:
    reference = folder / "reference.mcap"
    reference.write_bytes(followed_file(log, asked.reference)[1])
    specification = replace(asked, reference=str(reference), law_inertia=None)  # the law is in the description
    run_trial(replace(prepare_trial(specification, description), specification=specification), cell, context)


def _by_hand(log: Log, asked: Any, description: CellDescription, cell: Cell, context: RunContext, folder: Path) -> None:
    parameters = cell_parameters(description)
    control = parameters.control
    source = LoggedSource(log_columns(log))
    plan = SessionPlan.from_source(source, control.stiffness_teleoperation, control.period_s, ForcePhase.CONTACT)
    with Run(description, parameters, plan, limits_of_arms(description), context, None) as run:
        run.follow(cell)
        run.close({})


RUNS: dict[str, Callable[[Log, Any, CellDescription, Cell, RunContext, Path], object]] = {
    "trial": _trial, "teleoperation": _by_hand, "recording": _by_hand,
    "demonstration": lambda log, asked, description, cell, context, folder: run_demonstration(
        replace(asked, law_inertia=None), description, cell, context),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Contact:
    """An arm: the estimated force, N, in the log and in the twin; mean: over `ticks`, those with contact in the log.
    path_mm, torque_nm, velocity: RMS of the hands' distance and of the differences of joint torques and velocities."""

    side: str
    ticks: int
    mean_n: tuple[float, float]
    peak_n: tuple[float, float]
    path_mm: float
    torque_nm: tuple[float, ...]
    velocity: tuple[float, ...]

    @property
    def off(self) -> float | None:
        """How far the twin's mean force is off, a share of the log's; None without contact."""
        return self.mean_n[1] / self.mean_n[0] - 1.0 if self.ticks else None


@dataclass(frozen=True, slots=True)
class TwinReplay:
    """ticks: of the log, and of the run in the twin."""

    log: str
    kind: str
    twin: str
    ticks: int
    replayed_ticks: int
    arms: tuple[Contact, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the replay as JSON-ready values."""
        return asdict(self) | {"force_off": [arm.off for arm in self.arms]}


def replay_in_twin(path: Path, profile: str) -> TwinReplay:
    """Run a log's commands in the simulated robot of a profile, a name or a path. Raises TrialError with one line."""
    run = read_run(path)
    kind, asked = with_profile("direct", profile), run.asked

    def opened(folder: Path, description: CellDescription) -> Cell:
        for samples, mounting in zip(run.columns.arm, description.arms, strict=True):
            away = float(np.abs(samples["q"][0] - np.array(mounting.home)).max())
            if run.kind not in ("trial", "demonstration") and away > AT_HOME_RAD:
                raise TrialError(f"{run.log.path}: an arm begins {away:.2f} rad away from home, where a twin begins")
        seed, file = asked.seed + OTHER_ARM, folder / "cell.toml"
        return open_cell(kind, asked.object, asked.displacement, seed, description, cell_file=file)

    replayed = run.again(opened)
    arms = tuple(_contact(side, run.columns.arm[k], replayed.arm[k]) for k, side in enumerate(run.log.sides))
    return TwinReplay(str(path), run.kind, profile, run.columns.arm.shape[1], replayed.arm.shape[1], arms)


def _contact(side: str, logged: NDArray, twin: NDArray) -> Contact:
    n = min(len(logged), len(twin))
    forces = [samples["O_F_ext_hat_K"][:, :3] for samples in (logged, twin)]
    ours, its = (np.linalg.norm(each - np.median(each[:FREE_TICKS], axis=0), axis=1)[:n] for each in forces)
    touched = ours > CONTACT_N
    means = (float(ours[touched].mean()), float(its[touched].mean())) if touched.any() else (0.0, 0.0)
    apart = np.linalg.norm(logged["O_T_EE"][:n, :3, 3] - twin["O_T_EE"][:n, :3, 3], axis=1)
    torque, velocity = (np.sqrt(np.mean((logged[name][:n] - twin[name][:n]) ** 2, axis=0)) for name in ("tau_J", "dq"))
    return Contact(
        side, int(touched.sum()), means, (float(ours.max()), float(its.max())), float(1e3 * np.sqrt(np.mean(apart**2))),
        tuple(torque.tolist()), tuple(velocity.tolist()),
    )  # fmt: skip
