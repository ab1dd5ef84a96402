"""The trial that the form asks for, before it runs and while it runs: what the scene draws of it, for all who look."""

import os
import subprocess
import sys
import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import msgspec

from console.trial_path import REFUSED, TrialPath
from hal.displacement import Displacement
from rtstack.live.protocol import JobKind, Status

_REMEMBERED = 16  # references whose path is known
_LONGEST_S = 120.0  # a recording of a minute takes half of it


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """What is put where, and the file that is followed; None: nothing yet."""

    object: str
    displacement: Displacement
    reference: Path | None


class TrialPlans:
    """The form's trial and the running one. May be used from any thread."""

    def __init__(self, cell_file: Path) -> None:
        self._cell_file = cell_file
        self._lock = threading.Lock()
        self._form: TrialPlan | None = None
        self._running: tuple[int, TrialPlan] | None = None
        self._paths: OrderedDict[tuple[Path, int], TrialPath | None] = OrderedDict()
        self._reading: subprocess.Popen[bytes] | None = None
        self._closed = False

    def set(self, plan: TrialPlan | None) -> None:
        """Take what a form says now; None: no form is shown."""
        self._form = plan
        if plan is not None and plan.reference is not None:
            self._read(plan.reference)

    def ordered(self, job: int, plan: TrialPlan) -> None:
        """Take what was ordered, as this job."""
        self._running = job, plan
        if plan.reference is not None:
            self._read(plan.reference)

    def current(self, status: Status | None) -> TrialPlan | None:
        """Return what is to be drawn: of a running trial its own plan, if it is known, else the form's."""
        job = None if status is None else status.job
        if job is None or not job.active:
            return self._form
        if job.kind is JobKind.TRIAL and self._running is not None and self._running[0] == job.number:
            return self._running[1]
        return None

    def path(self, plan: TrialPlan) -> TrialPath | None:
        """Return the path of a plan's reference; None until it was read, and where it has none."""
        key = _key(plan.reference)
        return None if key is None else self._paths.get(key)

    def close(self) -> None:
        """End what is being read."""
        self._closed = True
        reading = self._reading
        if reading is not None and reading.poll() is None:
            reading.terminate()

    def _read(self, reference: Path) -> None:
        key = _key(reference)
        with self._lock:
            if key is None or key in self._paths or self._closed:
                return
            self._paths[key] = None
            while len(self._paths) > _REMEMBERED:
                self._paths.popitem(last=False)
        threading.Thread(target=self._run, args=(reference, key), daemon=True, name="read a reference").start()

    def _run(self, reference: Path, key: tuple[Path, int]) -> None:
        process = self._reading = subprocess.Popen(
            [sys.executable, "-m", "console.trial_path", str(reference), str(self._cell_file)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        try:
            said, _ = process.communicate(timeout=_LONGEST_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return
        if process.returncode == 0:
            self._paths[key] = msgspec.json.decode(said, type=TrialPath)
        elif process.returncode != REFUSED:
            self._paths.pop(key, None)  # it did not end by itself: read anew when it is asked for again


def _key(reference: Path | None) -> tuple[Path, int] | None:
    try:
        return None if reference is None else (reference, reference.stat().st_mtime_ns)
    except OSError:
        return None
