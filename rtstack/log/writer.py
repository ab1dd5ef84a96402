"""The parent's side of the log: start the log process, watch it, end it."""

import contextlib
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from rtstack.log.errors import LogError
from rtstack.log.ring import LogState, Rings
from rtstack.log.viewers.frames import CellFrames
from rtstack.log.writing.job import Attachment, Evidence, LogJob, texts
from rtstack.log.writing.pictures import LoggedCamera
from rtstack.topics import TOPICS

__all__ = ["Attachment", "CellFrames", "Evidence", "LogProcess", "LogSummary", "check_log_path"]

_POLL_S = 0.002


@dataclass(frozen=True, slots=True)
class LogSummary:
    """What ended up in a log: messages written, records lost because the log process was too slow."""

    path: Path
    messages: int
    lost: int


def check_log_path(path: Path, overwrite: bool = False) -> None:
    """Raise LogError where a log cannot be written to `path`; an existing file only goes with `overwrite`."""
    path = Path(path)
    if path.is_dir():
        raise LogError(f"{path} is a directory, not the name of a log")
    if not path.parent.is_dir():
        raise LogError(f"cannot write {path}: the directory {path.parent} does not exist")
    if path.exists():
        if not path.is_file():
            raise LogError(f"cannot write {path}: it is not a regular file")
        if not overwrite:
            raise LogError(f"{path} exists already: choose another name or remove it")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise LogError(f"cannot write {path}: permission denied")


def _create(path: Path, overwrite: bool) -> BinaryIO:
    check_log_path(path, overwrite)
    try:
        return open(path, "wb" if overwrite else "xb")
    except FileExistsError as error:
        raise LogError(f"{path} exists already: choose another name or remove it") from error
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}") from error


class LogProcess:
    """A running log process. Made by `start`, ended by `close`."""

    def __init__(self, path: Path, rings: Rings, process: subprocess.Popen, job: BinaryIO, errors: BinaryIO) -> None:
        self.path = path
        self._rings = rings
        self._process = process
        self._job = job
        self._errors = errors

    @classmethod
    def start(
        cls, path: Path, rings: Rings, metadata: Mapping[str, dict[str, str]], attachments: Sequence[Attachment] = (),
        description: CellFrames | None = None, overwrite: bool = False, cameras: Sequence[LoggedCamera] = (),
    ) -> "LogProcess":  # fmt: skip
        """Start writing `path` and return at once: what is pushed meanwhile waits in the rings.

        metadata: record name -> values, written at the start of the file, so that a killed log still has it.
        description: makes /tf; without it there is none. cameras: whose pictures the log has.
        Raises LogError where the file cannot be created.
        """
        path = Path(path)
        with _create(path, overwrite) as log:
            job, errors = tempfile.TemporaryFile(), tempfile.TemporaryFile()  # noqa: SIM115 (closed in _reap)
            told = LogJob(rings.name, tuple(metadata.items()), tuple(attachments), description, tuple(cameras))
            pickle.dump(told, job)
            job.flush()
            files = job.fileno(), log.fileno()
            process = subprocess.Popen(
                [sys.executable, "-m", "rtstack.log.writing.process", *map(str, (*files, os.getpid()))],
                stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, pass_fds=files,
                start_new_session=True,  # Ctrl-C in the terminal must not end the log before the trial
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # it only copies: no pool of threads
            )  # fmt: skip
        return cls(path, rings, process, job, errors)

    @property
    def pid(self) -> int:
        """Process id of the log process."""
        return self._process.pid

    @property
    def trouble(self) -> str:
        """Why the log is not being written any more, empty while it is. Never waits."""
        if self._rings.state is not LogState.FAILED and self._process.poll() is None:
            return ""
        reason = self._rings.error
        code = self._process.poll()
        if reason or code is None:
            return reason
        return f"its process was killed by signal {-code}" if code < 0 else self._last_error() or f"exit {code}"

    def check(self) -> None:
        """Raise LogError if the log process has failed or died."""
        if self.trouble:
            raise LogError(self._reason())

    def wait_ready(self, timeout_s: float = 10.0) -> None:
        """Wait until the log process reads the rings. Raises LogError if it fails or takes longer."""
        deadline = time.monotonic() + timeout_s
        while self._rings.state is LogState.STARTING:
            self.check()
            if time.monotonic() > deadline:
                raise LogError(f"the log {self.path} cannot be written: its process does not start")
            time.sleep(_POLL_S)
        self.check()

    def wait_room(self, records: int, timeout_s: float = 30.0) -> None:
        """Wait, outside of the tick, until every ring takes `records` more. Raises as `wait_ready` does."""
        deadline = time.monotonic() + timeout_s
        while self._rings.room() < records:
            self.check()
            if time.monotonic() > deadline:
                raise LogError(f"the log {self.path} does not keep up: no room for {records} records")
            time.sleep(_POLL_S)

    def close(
        self, result: Mapping[str, Any] | None = None, evidence: Evidence | None = None, timeout_s: float = 60.0
    ) -> LogSummary:
        """Write `result` as metadata and the evidence of a fault, finish the file and wait for it.

        Raises LogError if the file is not complete: the process failed (its reason), died, or does not end.
        """
        try:
            if result or evidence:
                pickle.dump((texts(result or {}), evidence), self._job)
                self._job.flush()
            self._rings.request_close()
            try:
                self._process.wait(timeout_s)
            except subprocess.TimeoutExpired as error:
                self._process.kill()
                raise LogError(f"the log {self.path} is incomplete: its process did not end") from error
            if self._process.returncode or self._rings.state is not LogState.FINISHED:
                raise LogError(self._reason())
        finally:
            self._reap()
        lost = sum(self._rings.lost(topic) for topic in TOPICS)
        return LogSummary(self.path, self._rings.messages, lost)

    def abandon(self) -> None:
        """End the process silently, for a parent that has a worse error to report. Never raises."""
        with contextlib.suppress(LogError, OSError):
            self.close()

    def _reason(self) -> str:
        recovery = f": recover it with `rtstack recover {self.path}`"
        return f"the log {self.path} is incomplete: {self.trouble}{recovery if self.path.exists() else ''}"

    def _last_error(self) -> str:
        if self._errors.closed:
            return ""
        self._errors.seek(0)
        lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        return lines[-1] if lines else ""

    def _reap(self) -> None:
        self._process.wait()
        self._job.close()
        self._errors.close()
