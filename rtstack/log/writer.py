"""The parent's side of the log: start the log process, watch it, end it, and make whole what a killed one has left."""

import contextlib
import os
import pickle
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.reader import NonSeekingReader
from numpy.typing import NDArray

from hal.base.files import keep, replacing
from rtstack.log.errors import LogError
from rtstack.log.ring import LogState, Rings
from rtstack.log.viewers.frames import CellFrames
from rtstack.log.writing.job import Attachment, Evidence, LogJob, texts
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.log.writing.pictures import LoggedCamera
from rtstack.topics import TICK_TOPICS, TOPICS

_AT_ONCE = 10_000  # messages: some MB
_NEXT_NS = 1_500_000  # the next tick comes before


def make_whole(
    path: Path, rings: Rings, job: LogJob, ended: str, result: dict[str, str], evidence: Evidence | None
) -> tuple[int, float]:
    """Replace a log that was cut off, as `ended` says, by one with the rings' newer samples, a result and a fault's
    evidence.

    Return the number of messages, and how much is missing between both, s; then the run has failed. Raises OSError:
    then the file stays as it was.
    """
    last_ns, seen = -1, dict.fromkeys(TOPICS, 0)
    with replacing(path) as new, open(new, "wb") as file, open(path, "rb") as old:
        writer = McapWriter.of_job(file, job, rings.times)
        found = NonSeekingReader(old).iter_messages(log_time_order=False)
        going_on = True
        while going_on:
            going_on, made = False, defaultdict[str, list[tuple[int, bytes]]](list)
            with suppress(Exception):  # the library raises whatever half a record makes of it
                for _, channel, message in islice(found, _AT_ONCE):
                    going_on, t_ns = True, message.log_time
                    made[channel.topic].append((t_ns, message.data))
                    if t_ns > last_ns:
                        last_ns, seen = t_ns, dict.fromkeys(TOPICS, 0)
                    if channel.topic in seen:
                        seen[channel.topic] += t_ns == last_ns
            if made:
                writer.write({}, dict(made))
        held = {topic: rings.reader(topic, oldest=True) for topic in TOPICS}
        records = {topic: reader.drain() for topic, reader in held.items()}
        first_ns = [int(records[topic]["t_ns"][0]) for topic in TICK_TOPICS if held[topic].lost]
        missing_s = 1e-9 * max(0, max(first_ns, default=0) - last_ns - _NEXT_NS)
        if missing_s:
            result = result | {"success": "false", "failure_reason": f"{ended}; {missing_s:.3f} s are missing"}
        writer.write({topic: _newer(each, last_ns, seen[topic]) for topic, each in records.items()})
        writer.finish(result, ended, evidence, {topic: rings.lost(topic) for topic in TOPICS})
    return sum(writer.messages.values()), missing_s


def has_messages(path: Path) -> bool:
    """Return whether a log that may be cut off has a whole message."""
    with suppress(Exception), open(path, "rb") as file:
        return any(True for _ in NonSeekingReader(file).iter_messages(log_time_order=False))
    return False


def _newer(records: NDArray[Any], last_ns: int, seen: int) -> NDArray[Any]:
    """Return a topic's records that a file lacks, which has all before last_ns and the first `seen` of that time."""
    if "seen" in (records.dtype.names or ()):  # an object that was never seen is not in the log
        records = records[records["seen"] != 0]
    t_ns = np.maximum(records["t_ns"], 0)
    return np.concatenate([records[t_ns == last_ns][seen:], records[t_ns > last_ns]])


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


class LogProcess:
    """A running log process, made by `start`, ended by `close`.

    files: the open log, what the process reads its job from, and where it writes errors; asked: that job.
    """

    def __init__(
        self, path: Path, rings: Rings, process: subprocess.Popen, files: tuple[BinaryIO, BinaryIO, BinaryIO],
        asked: LogJob,
    ) -> None:  # fmt: skip
        self.path = path
        self._rings = rings
        self._process = process
        self._log, self._job, self._errors = files
        self._asked = asked

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
        check_log_path(path, overwrite)
        try:
            log = open(path, "wb" if overwrite else "xb")  # noqa: SIM115 - closed in _reap
        except OSError as error:
            raise LogError(f"cannot write {path}: {error.strerror}") from error
        job, errors = (os.fdopen(os.memfd_create(name), "w+b") for name in ("job", "errors"))  # closed in _reap
        asked = LogJob(rings.name, tuple(metadata.items()), tuple(attachments), description, tuple(cameras))
        pickle.dump(asked, job)
        job.flush()
        files = job.fileno(), log.fileno()
        process = subprocess.Popen(
            [sys.executable, "-m", "rtstack.log.writing.process", *map(str, (*files, os.getpid()))],
            stdin=subprocess.DEVNULL, stdout=errors, stderr=errors, pass_fds=files,
            start_new_session=True,  # Ctrl-C in the terminal must not end the log before the trial
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # it only copies: no pool of threads
        )  # fmt: skip
        return cls(path, rings, process, (log, job, errors), asked)

    @property
    def pid(self) -> int:
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
        why = "cannot be written: its process does not start"
        self._wait(lambda: self._rings.state is not LogState.STARTING, timeout_s, why)
        self.check()

    def wait_room(self, records: int, timeout_s: float = 30.0) -> None:
        """Wait, outside of the tick, until every ring takes `records` more. Raises as `wait_ready` does."""
        self._wait(lambda: self._rings.room() >= records, timeout_s, f"does not keep up: no room for {records} records")

    def _wait(self, done: Callable[[], bool], timeout_s: float, why: str) -> None:
        deadline = time.monotonic() + timeout_s
        while not done():
            self.check()
            if time.monotonic() > deadline:
                raise LogError(f"the log {self.path} {why}")
            time.sleep(_POLL_S)

    def close(
        self, result: Mapping[str, Any] | None = None, evidence: Evidence | None = None, timeout_s: float = 60.0
    ) -> LogSummary:
        """Write `result` as metadata and the evidence of a fault, finish the file and wait until the disk has it.

        What a process that died has not written is written here, as far as the rings still hold it. Raises LogError if
        the file is not complete, or not at its path any more.
        """
        written = texts(result or {})
        try:
            if result or evidence:
                pickle.dump((written, evidence), self._job)
                self._job.flush()
            self._rings.request_close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout_s)
            self._process.kill()
            self._process.wait()
            self._check_place()
            messages = self._rings.messages
            if self._rings.state is not LogState.FINISHED:
                messages = self._made_whole(written, evidence)
            keep(self.path.parent)
        except OSError as error:
            raise LogError(f"the log {self.path} may not be on the disk: {error.strerror}") from error
        finally:
            self._reap()
        return LogSummary(self.path, messages, sum(self._rings.lost(topic) for topic in TOPICS))

    def _made_whole(self, result: dict[str, str], evidence: Evidence | None) -> int:
        """Return the messages of the whole log. Raises LogError where it cannot be made; an empty one is removed."""
        if self._rings.state is LogState.READY:
            with contextlib.suppress(OSError):  # the reason is why the process died
                made = make_whole(self.path, self._rings, self._asked, self.trouble, result, evidence)
                if made[1]:
                    raise LogError(f"the log {self.path} lacks {made[1]:.3f} s: {self.trouble}")
                return made[0]
        reason = self._reason()
        if not has_messages(self.path):
            self.path.unlink()
        raise LogError(reason)

    def _check_place(self) -> None:
        """Write the log anew where its folder was removed. Raises LogError where it was moved or replaced, OSError."""
        log = self._log.fileno()
        with contextlib.suppress(OSError):
            if os.path.samestat(os.fstat(log), self.path.stat()):
                return
        if os.fstat(log).st_nlink or self.path.exists():
            now = os.readlink(f"/proc/self/fd/{log}")
            raise LogError(f"the log is not at {self.path} any more, its folder was moved or replaced: it is at {now}")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(self.path) as new:
            shutil.copyfile(f"/proc/self/fd/{log}", new)

    def abandon(self) -> None:
        """End the process silently, for a parent that has a worse error to report. Never raises."""
        with contextlib.suppress(LogError, OSError, ValueError):  # its files are closed
            self.close()

    def _reason(self) -> str:
        if not has_messages(self.path):
            return f"the log {self.path} cannot be written: {self.trouble}"
        return f"recover the log with `rtstack recover {self.path}`, it is incomplete: {self.trouble}"

    def _last_error(self) -> str:
        if self._errors.closed:
            return ""
        self._errors.seek(0)
        lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        return lines[-1] if lines else ""

    def _reap(self) -> None:
        self._process.wait()
        for file in (self._log, self._job, self._errors):
            file.close()
