"""The campaigns under LOGS/campaigns: one at a time is a child process of the console, at low priority."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

from console.campaigns.folder import Asked, CampaignFolder, Stage
from console.refused import Refused
from hal.base.files import write_whole
from rtstack.trials.specification import like

FOLDER = "campaigns"
NICENESS = 10
NICEST = 19  # beside arms that are armed
_END_S = 6.0  # the supervisor gives the console ten
_WATCH_S = 1.0


class CampaignState(StrEnum):
    """How a campaign is. What is interrupted can be resumed, what failed has made nothing."""

    RUNNING = "running"
    ENDING = "ending"
    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure by its opaque id; `drawn_s`: Unix time, so that a page can tell a newer one."""

    id: str
    name: str
    drawn_s: float


@dataclass(frozen=True, slots=True)
class CampaignView:
    """A campaign. `stage`: what is being done, `done` of `total` of it; `message`: what it said last, where it failed.

    time_left_s: from the pace since it was started here, None while that is unknown. preliminary: figures and claims
    are from the results so far. claims: conditions, where, claim, figures, verdict. on_cell: on the stack's arms, where
    `says` is what a person is to do, `next` the case after the one that runs, and `paused` whether none begins.
    """

    id: str
    name: str
    quick: bool
    state: CampaignState
    began_s: float
    stage: str
    done: int
    total: int | None
    time_left_s: float | None
    message: str
    report: bool
    preliminary: bool
    figures: tuple[Figure, ...]
    claims: tuple[dict[str, str], ...]
    on_cell: bool
    says: str
    next: str
    paused: bool


@dataclass(slots=True)
class _Running:
    folder: CampaignFolder
    process: subprocess.Popen[bytes]
    ending: bool = False
    since: tuple[str, float, int] | None = None  # stage, monotonic s and results when it was first seen


class Campaigns:
    """All campaigns of one folder of logs. May be used from any thread. socket: of the stack's robot process."""

    def __init__(self, logs: Path, socket: Path) -> None:
        self._socket = socket
        self._directory = logs.resolve() / FOLDER
        self._lock = threading.RLock()
        self._running: _Running | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True, name="campaigns")
        self._thread.start()

    def close(self) -> None:
        """End the campaign that runs as at Ctrl-C; by force where it does not end."""
        self._ending.set()
        self._thread.join()
        with self._lock:
            if (running := self._running) is not None:
                self._interrupt(running)
                try:
                    running.process.wait(_END_S)
                except subprocess.TimeoutExpired:
                    os.killpg(running.process.pid, signal.SIGKILL)
                    running.process.wait()
                self._forget(running)

    def start(self, name: str, quick: bool, workers: int | None, niceness: int, on_cell: bool = False) -> CampaignView:
        """Begin a campaign in a folder of its own. Raises Refused while another one runs."""
        with self._lock:
            self._free()
            began = time.strftime("%Y%m%d-%H%M%SZ", time.gmtime())
            stem = f"{began}-{Path(name).stem}{'-quick' * quick}"
            # one that was cancelled at once has its name from the same second
            taken = {entry.stem for entry in self._directory.glob("*")}
            names = (stem, *(f"{stem}-{number}" for number in range(2, len(taken) + 3)))
            folder = CampaignFolder(self._directory / next(each for each in names if each not in taken))
            try:
                self._directory.mkdir(exist_ok=True)
                asked = Asked(name, quick, time.time(), on_cell)
                write_whole(folder.note, json.dumps(asdict(asked)))
                self._begin(folder, asked, workers, niceness, resume=False)
            except OSError as error:
                folder.note.unlink(missing_ok=True)
                raise Refused(409, f"it cannot be begun in {self._directory}: {error.strerror}") from None
            return self.view(folder.id)

    def resume(self, campaign_id: str, workers: int | None, niceness: int) -> CampaignView:
        """Go on with what was interrupted. Raises Refused."""
        with self._lock:
            self._free()
            folder, asked = self._folder(campaign_id)
            if self._state(folder, folder.stage()) is not CampaignState.INTERRUPTED:
                raise Refused(409, "there is nothing left of it to run")
            self._begin(folder, asked, workers, niceness, resume=folder.begun)
            return self.view(campaign_id)

    def cancel(self, campaign_id: str) -> CampaignView:
        """End the campaign as at Ctrl-C: what it has stays, and can be resumed. Raises Refused."""
        with self._lock:
            running = self._alive()
            if running is None or running.folder.id != campaign_id:
                raise Refused(409, "this campaign is not running")
            self._interrupt(running)
            return self.view(campaign_id)

    def pause(self, campaign_id: str, reason: str | None) -> CampaignView:
        """Begin no further run of a campaign on arms, for this reason; None: go on. Raises Refused."""
        with self._lock:
            folder, _ = self._folder(campaign_id)
            if self._alive() is None or not self.view(campaign_id).on_cell or not folder.path.is_dir():
                raise Refused(409, "this campaign does not run on the arms: cancel it, it can be resumed")
            if reason is None:
                folder.pause.unlink(missing_ok=True)
            else:
                folder.pause.write_text(reason, encoding="utf-8")
            return self.view(campaign_id)

    def views(self) -> list[CampaignView]:
        """Return all campaigns, the newest first."""
        with self._lock:
            return [self._view(*pair) for pair in sorted(self._folders(), key=lambda pair: -pair[1].began_s)]

    def view(self, campaign_id: str) -> CampaignView:
        """Return a campaign. Raises Refused."""
        with self._lock:
            return self._view(*self._folder(campaign_id))

    def folder(self, campaign_id: str) -> CampaignFolder:
        """Return a campaign's folder: looked up by its id, never joined to a path. Raises Refused."""
        return self._folder(campaign_id)[0]

    def _folders(self) -> Iterator[tuple[CampaignFolder, Asked]]:
        for folder in [CampaignFolder(note.with_suffix("")) for note in self._directory.glob("*.json")]:
            if (asked := folder.asked()) is not None:
                yield folder, asked

    def _folder(self, campaign_id: str) -> tuple[CampaignFolder, Asked]:
        for folder, asked in self._folders():
            if folder.id == campaign_id:
                return folder, asked
        raise Refused(404, "there is no such campaign; look at the list again")

    def _free(self) -> None:
        if self._alive() is not None:
            raise Refused(409, "a campaign is running: wait for its end, or cancel it first")

    def _begin(self, folder: CampaignFolder, asked: Asked, workers: int | None, niceness: int, resume: bool) -> None:
        at_once = workers or max(1, len(os.sched_getaffinity(0)) - 1)
        command = ["campaign", asked.name, "--out", str(folder.path), "--workers", str(at_once)]
        command += ["--quick"] * asked.quick + ["--resume"] * resume
        command += ["--cell", f"stack:{self._socket}"] if asked.on_cell else []
        child = [sys.executable, "-m", "rtstack.cli.child", str(niceness), *command]
        with folder.said.open("a", encoding="utf-8") as said:
            process = subprocess.Popen(child, stdin=subprocess.PIPE, stdout=said, stderr=said, start_new_session=True)
        self._running = _Running(folder, process)

    def _alive(self) -> _Running | None:
        if self._running is not None and self._running.process.poll() is not None:
            self._forget(self._running)
        return self._running

    def _forget(self, running: _Running) -> None:
        if running.process.stdin is not None:
            running.process.stdin.close()
        self._running = None

    def _interrupt(self, running: _Running) -> None:
        if not running.ending and running.process.poll() is None:
            running.ending = True  # a second one would break off what it is putting in order
            running.process.send_signal(signal.SIGINT)

    def _view(self, folder: CampaignFolder, asked: Asked) -> CampaignView:
        stage = folder.stage()
        state = self._state(folder, stage)
        ended = state is CampaignState.INTERRUPTED
        figures = folder.figures()
        return like(
            CampaignView, asked, stage, id=folder.id, state=state, stage=stage.label,
            time_left_s=self._time_left_s(stage) if state is CampaignState.RUNNING else None,
            message=folder.last_line() if state is CampaignState.FAILED or (ended and asked.on_cell) else "",
            report=folder.report is not None, preliminary=folder.report is None and bool(figures),
            figures=tuple(Figure(key, path.stem, path.stat().st_mtime) for key, path in figures.items()),
            claims=tuple(folder.claims()), paused=state is CampaignState.RUNNING and folder.pause.exists(),
        )  # fmt: skip

    def _state(self, folder: CampaignFolder, stage: Stage) -> CampaignState:
        running = self._alive()
        if running is not None and running.folder.path == folder.path:
            return CampaignState.ENDING if running.ending else CampaignState.RUNNING
        if folder.report is not None and (stage.total is None or stage.done >= stage.total):
            return CampaignState.FINISHED
        return CampaignState.INTERRUPTED if folder.path.is_dir() else CampaignState.FAILED

    def _time_left_s(self, stage: Stage) -> float | None:
        if self._running is None or self._running.since is None or stage.total is None:
            return None
        label, since_s, before = self._running.since
        if label != stage.label or stage.done <= before:
            return None
        return (stage.total - stage.done) * (time.monotonic() - since_s) / (stage.done - before)

    def _watch(self) -> None:
        while not self._ending.wait(_WATCH_S):
            with self._lock:
                if (running := self._alive()) is not None:
                    stage = running.folder.stage()
                    if running.since is None or running.since[0] != stage.label:
                        running.since = stage.label, time.monotonic(), stage.done
