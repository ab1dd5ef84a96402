"""The log of one trial: rings, log process, and what is written about the trial besides its samples."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.files import replacing
from hal.base.realtime import obtainable
from hal.cell import Cell
from hal.robots import FR3
from rtstack.cameras.start import Cameras
from rtstack.log.errors import LogError
from rtstack.log.ring import LogState, Rings
from rtstack.log.time_of_day import TIMES, begun
from rtstack.log.viewers.scenery import Scenery
from rtstack.log.writer import Attachment, CellFrames, Evidence, LogProcess
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.loop.end import End
from rtstack.loop.history import Columns, History
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.model.cell_description import CellDescription, base_poses
from rtstack.references.spreading import ExtendedReference
from rtstack.samples import SIDES, LawInertia
from rtstack.trials.controllers import CONTROLLERS, DETECTORS, package_of_choice
from rtstack.trials.followed import REFERENCE, Followed
from rtstack.trials.provenance import git_commit, host_report, package_versions
from rtstack.trials.specification import DemonstrationSpecification, Specification, TrialSpecification

LOCKSTEP_KINDS = ("direct", "lockstep")  # our cells whose robot waits for its answer
ROOM = 64  # records: below it a run that is faster than the log waits between two ticks
HANG_S = 5.0  # and waits for no longer: a log that takes nothing for so long hangs
# of a ring of 8 s: a log that is further behind hangs, and what is left takes the stop
FULL_SHARE = 0.5
_END_S = 60.0  # for the log process to read what is left
_END_OF_HANGING_S = 2.0


class RunLog:
    """What keeps a run's samples and its result; by itself it keeps nothing, and cannot fail. path: of the file.
    cameras: whose pictures go into it. evidence: of a fault, set before `close`, which writes it. times: the pairs of
    TIMES (1,) that the run takes, see rtstack.log.time_of_day, None where nothing keeps them."""

    times: NDArray[np.void] | None = None

    def __init__(self, path: Path, cameras: Cameras | None = None) -> None:
        self.path = path
        self.cameras = cameras
        self.evidence: Evidence | None = None

    @property
    def listening(self) -> tuple[Rings, ...]:
        """The rings that the run publishes to."""
        return ()

    def take_from(self, history: History) -> None:
        """Learn where the run keeps its samples."""

    def wait_ready(self) -> None:
        """Wait until samples are being kept: no arm moves before that. Raises LogError."""

    def trip(self) -> WatchdogTrip | None:
        """Return how the run has to end, None while the log is well. Never waits: a log is a watchdog of its run."""

    def wait_for_room(self) -> None:
        """Between two ticks: wait, where the run may, until there is room for more samples. Never raises."""

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the result. Returns None, or in one line why the log is not complete."""

    def abandon(self) -> None:
        """Finish without a result, when something worse has happened. Never raises."""


class RunSamples(RunLog):
    """Keeps the samples of a run in memory, as `columns` once it is closed, and writes nothing."""

    columns: Columns | None = None
    history: History | None = None

    def take_from(self, history: History) -> None:
        self.history = history

    def close(self, result: dict[str, Any]) -> str | None:
        if self.history is not None:
            self.columns = self.history.columns()
        return None


class TrialLog(RunLog):
    """A log that another process writes meanwhile. lockstep: the robot waits, so that the run may wait for the log."""

    def __init__(
        self, path: Path, rings: Rings, process: LogProcess, lockstep: bool, cameras: Cameras | None = None
    ) -> None:
        super().__init__(path, cameras)
        self.rings, self.times = rings, rings.times
        self._trouble, self._raised, self._hangs, self._gone = "", "", False, False
        self._process = process
        self._lockstep = lockstep
        self._history: History | None = None

    @property
    def listening(self) -> tuple[Rings, ...]:
        return (self.rings,)

    def take_from(self, history: History) -> None:
        self._history = history

    def wait_ready(self) -> None:
        self._process.wait_ready()
        if self.cameras is not None:
            self.cameras.wait_ready()
            if raised := self.cameras.raised:
                raise LogError(raised)

    def trip(self) -> WatchdogTrip | None:
        """See RunLog: the log process has failed or is gone, or the program of a camera has raised."""
        if self._raised:
            return WatchdogTrip(End.CONTROLLER_EXCEPTION, self._raised)
        if not self._trouble and self.rings.state is LogState.FAILED:
            self._trouble = self.rings.error
        return WatchdogTrip(End.LOG_FAILED, self._trouble) if self._trouble else None

    def wait_for_room(self) -> None:
        """Between two ticks: look whether the log process lives; a lockstep run lets it catch up. Never raises."""
        if self._trouble:
            return
        self._trouble, self._raised = self._process.trouble, "" if self.cameras is None else self.cameras.raised
        room, capacity = self.rings.room(), self.rings.capacity
        if self._trouble:
            return
        if not self._lockstep:
            if room < (1.0 - FULL_SHARE) * capacity:
                self._hang(f"its process is {capacity - room} records behind, {capacity} is all that can wait")
        elif room < ROOM:
            try:
                self._process.wait_room(ROOM, HANG_S)
            except LogError:
                self._hang(self._process.trouble or f"its process has read nothing for {HANG_S:g} s")

    def _hang(self, trouble: str) -> None:
        self._trouble, self._hangs = trouble, True

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the result and finish the file. Returns None, or in one line why the log is not complete."""
        try:
            if self.cameras is not None:
                self.cameras.finish()
            self._process.close(result, self.evidence, _END_OF_HANGING_S if self._hangs else _END_S)
        except LogError as error:
            return str(error)
        finally:
            self._let_go()
        return None

    def abandon(self) -> None:
        """Finish the file without a result, when something worse has happened; remove it where no tick was run. Never
        raises, may be called twice."""
        if self._gone:
            return
        if self.cameras is not None:
            self.cameras.finish()
        self._process.abandon()
        if self.evidence is None and (self._history is None or not self._history.ticks):
            with suppress(OSError):  # no arm has moved: a file would only refuse the same command again
                self.path.unlink()
        self._let_go()

    def _let_go(self) -> None:
        self._gone = True
        if self.cameras is not None:
            self.cameras.close()
        self.rings.close()


class WholeRunLog(RunSamples):
    """The log of a run whose history is kept: the file of any trial, written by `close` once the arms are at rest. A
    lockstep run has no deadline, and needs neither rings nor the log process, whose start costs half a trial. The file
    gets its name when it is complete: a worker that is killed leaves no half log under a trial's id."""

    def __init__(
        self, path: Path, metadata: dict[str, dict[str, str]], attachments: list[Attachment], frames: CellFrames
    ) -> None:
        super().__init__(path)
        self._metadata = metadata
        self._attachments = attachments
        self._frames = frames
        self.times = begun(np.zeros(1, TIMES), simulated=True)

    def close(self, result: dict[str, Any]) -> str | None:
        """Write the file. Returns None, or in one line why there is none. `columns` are the samples from now on."""
        super().close(result)
        try:
            # under a name of its own: a worker that was cut off may still write what another one has taken over
            with replacing(self.path) as partial, open(partial, "wb") as file:
                writer = McapWriter(file, scenery=Scenery(self._frames), times=self.times)
                writer.begin(self._metadata.items(), self._attachments)
                if self.history is not None:
                    writer.write(self.history.batches())
                writer.finish(result, "closed", self.evidence, {})
        except OSError as error:
            return f"the log {self.path} was not written: {error.strerror or error}"
        return None


def open_log(
    path: Path,
    specification: Specification,
    description: CellDescription,
    cell_kind: str,
    cell_file: Path,
    attachments: Sequence[Attachment] = (),
    *,
    reference: ExtendedReference | None = None,
    followed: Followed | None = None,
    overwrite: bool = False,
    cell: Cell | None = None,
    campaign: Mapping[str, str] | None = None,
    operator: str = "",
) -> TrialLog:
    """Start the log of a trial, with its reference's times and file if it has one. Raises LogError. campaign: the
    metadata record of that name. operator: by whose order, in the record `trial`. cell: tells whether its robot waits,
    and keeps a clock's pace; without it the name of one of our kinds does."""
    lockstep = cell_kind.partition(":")[0] in LOCKSTEP_KINDS if cell is None else not cell.own_clocks
    timed = not lockstep or (cell is not None and cell.paced)
    metadata = {"trial": trial_metadata(specification, cell_kind, reference, timed, description.gains.law_inertia)}
    metadata["trial"] |= {"operator": operator} if operator else {}
    metadata |= {} if campaign is None else {"campaign": dict(campaign)}
    try:
        attached = () if followed is None else followed.attachments()
        metadata |= {} if followed is None else {REFERENCE: followed.record()}
    except OSError as error:
        raise LogError(f"cannot read the reference: {error.filename}: {error.strerror}") from None
    rings = Rings.create()
    begun(rings.times, lockstep)
    cameras = Cameras(description, cell_file, specification.object, rings) if description.cameras else None
    try:
        process = LogProcess.start(
            path,
            rings,
            metadata,
            [*cell_attachments(cell_file, description), *attachments, *attached],
            frames(description, specification.object),
            overwrite=overwrite,
            cameras=() if cameras is None else cameras.logged,
        )
    except BaseException:
        if cameras is not None:
            cameras.finish()
            cameras.close()
        rings.close()
        raise
    return TrialLog(path, rings, process, lockstep, cameras)


def free_name(logs: Path, stem: str) -> Path:
    """Return where the log of a run goes: by the time, UTC, and its kind; an existing file is never taken."""
    path = logs / f"{time.strftime('%Y%m%d-%H%M%SZ', time.gmtime())}-{stem}.mcap"
    number, first = 2, path.stem
    while path.exists():
        path, number = logs / f"{first}-{number}.mcap", number + 1
    return path


def _versions(specification: Specification) -> dict[str, str]:
    """Return the versions of what shapes a result, the packages of controller and detector included."""
    if not isinstance(specification, TrialSpecification):
        return package_versions()
    chosen = ((CONTROLLERS, specification.controller), (DETECTORS, specification.detector))
    return dict(package_of_choice(point, name) for point, name in chosen) | package_versions()


def trial_metadata(
    specification: Specification,
    cell_kind: str,
    reference: ExtendedReference | None,
    timed: bool = False,
    law_inertia: LawInertia = LawInertia.LINKS_AND_MOTORS,
) -> dict[str, str]:
    """Return the metadata record `trial`: nested values are JSON. timed: with what the loop gets of the host.
    law_inertia: of the cell's controller; it is put into a specification that names none."""
    if isinstance(specification, TrialSpecification | DemonstrationSpecification):
        law_inertia = specification.law_inertia or law_inertia
        specification = replace(specification, law_inertia=law_inertia)
    realtime = {f"loop_{k}": v for k, v in obtainable().as_dict().items()} if timed else {}
    times = {}
    if reference is not None:
        times = {
            "nominal_impact_s": repr(reference.nominal_impact_s),
            "release_s": repr(reference.release_s),
            "motion": str(reference.motion),
        }
    return {
        "kind": specification.kind,
        "specification": json.dumps(specification.as_dict()),
        "object": specification.object,
        "seed": str(specification.seed),
        "cell": cell_kind,
        "law_inertia": str(law_inertia),
        "versions": json.dumps(_versions(specification)),
        "git_commit": git_commit(),
        "host": json.dumps(host_report() | realtime),
        **times,
    }


def cell_attachments(cell_file: Path, description: CellDescription) -> list[Attachment]:
    """Return the cell's file and its arms' URDFs, MODEL.urdf or SIDE_MODEL.urdf, as each log has them. Raises
    OSError."""
    robots = description.robots
    models = {robots[0].name: robots[0]}
    if any(robot is not robots[0] for robot in robots):
        models = {f"{side}_{robot.name}": robot for side, robot in zip(description.sides, robots, strict=True)}
    urdfs = [Attachment(f"{name}.urdf", "application/xml", model.urdf.encode()) for name, model in models.items()]
    return [Attachment("cell.toml", "application/toml", cell_file.read_bytes()), *urdfs]


def logged_urdfs(attachments: Sequence[Attachment]) -> tuple[str, str]:
    """Return the URDFs of the left and of the right arm among a log's attachments, the FR3's where it has none."""
    texts = {a.name: a.data.decode() for a in attachments if a.name.endswith(".urdf")}
    own = {side: [text for name, text in texts.items() if name.startswith(f"{side}_")] for side in SIDES}
    shared = next(iter(texts.values()), FR3.urdf)
    return (own["left"] or [shared])[0], (own["right"] or [shared])[0]


def frames(description: CellDescription, object_name: str) -> CellFrames:
    """Return where the arms stand and how large pads and object are, for /tf and for who draws the log."""
    sides, thing, table = description.sides, description.objects.get(object_name), description.table
    return CellFrames(
        dict(zip(sides, base_poses(description), strict=True)),
        dict(zip(sides, (pad.size for pad in description.pads), strict=True)),
        dict(zip(sides, (robot.urdf for robot in description.robots), strict=True)),
        object_size_m=thing.size if thing else (0.0, 0.0, 0.0),
        table_centre_m=(*table.centre_xy, 0.5 * table.top_z), table_size_m=(*table.size_xy, table.top_z),
    )  # fmt: skip


def whole_run_log(
    path: Path, specification: Specification, description: CellDescription, attachments: list[Attachment],
    cell_kind: str, *, reference: ExtendedReference | None = None,
    law_inertia: LawInertia = LawInertia.LINKS_AND_MOTORS, campaign: dict[str, str] | None = None,
) -> WholeRunLog:  # fmt: skip
    """Return the log of a campaign's run. campaign: the metadata record of that name; the rest: see trial_metadata."""
    metadata = {"trial": trial_metadata(specification, cell_kind, reference, law_inertia=law_inertia)}
    if campaign is not None:
        metadata["campaign"] = campaign
    return WholeRunLog(path, metadata, attachments, frames(description, specification.object))
