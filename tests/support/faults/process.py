"""A case in a process of its own, forked from one that has imported everything; nobody of it survives unnoticed."""

import contextlib
import ctypes
import json
import os
import select
import shutil
import signal
import sys
import threading
import time
import traceback
from pathlib import Path

import psutil

from tests.support.faults.case import Case, Ground
from tests.support.faults.catalogue import case_name
from tests.support.faults.model import CaseResult, Fault, Moment

PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h
NAME = "RTSTACK_FAULT_CASE"  # in the environment of a case and of all that it starts
LONGEST_S = 120.0
GRACE_S = 5.0  # for what a case has started to end by itself


def take_charge() -> None:
    """Become the parent of every process whose parents end, so that none can hide; SIGTERM is a Ctrl-C, too."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


class CaseProcess:
    """A running case. A process stands between it and this one, which the case may kill."""

    def __init__(self, fault: Fault, moment: Moment, ground: Ground, folder: Path) -> None:
        self.fault, self.moment = fault, moment
        self._name, self._folder = case_name(fault, moment), folder
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self._began_s = time.monotonic()
        said, says = os.pipe()
        held, self._lifeline = os.pipe()
        self._between = os.fork()
        if self._between == 0:
            os.setsid()  # a Ctrl-C in the terminal is for the one that orders the cases
            os.close(said)
            os.close(self._lifeline)
            case = os.fork()
            if case == 0:
                os.close(says)
                self._become_case(ground, held)
            os.write(says, str(case).encode())
            os.close(says)
            os.waitpid(case, 0)
            os._exit(0)
        os.close(says)
        os.close(held)
        with open(said, "rb") as answer:
            self._pid = int(answer.read())
        self.descriptor = os.pidfd_open(self._pid)

    def _become_case(self, ground: Ground, held: int) -> None:
        status = 1
        try:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_DFL)
            os.environ[NAME] = self._name
            output = os.open(self._folder / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            nothing = os.open(os.devnull, os.O_RDONLY)
            for descriptor, target in ((nothing, 0), (output, 1), (output, 2)):
                os.dup2(descriptor, target)
            threading.Thread(target=_end_with, args=(held,), daemon=True).start()
            result = Case(self.fault, self.moment, ground, self._folder).play()
            (self._folder / "result.json").write_text(json.dumps(result.as_dict()))
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return bool(select.select((self.descriptor,), (), (), 0.0)[0])

    @property
    def hangs(self) -> bool:
        """Whether it takes longer than any case may."""
        return time.monotonic() - self._began_s > LONGEST_S

    def result(self) -> CaseResult:
        """Return its result once it has ended, or what became of it; and end what it has left behind."""
        hung = not self.ended
        if hung:
            self.kill()
        path = self._folder / "result.json"
        if path.exists():
            result = CaseResult(**json.loads(path.read_text()))
        else:
            result = CaseResult(self.fault.name, self.moment, self.fault.expected(self.moment).text)
            what = f"it hung for {LONGEST_S:g} s" if hung else f"it broke off: {self._last_words()}"
            result.misses.append(what)
        self._reap()
        result.misses += self._left_behind()
        return result

    def _last_words(self) -> str:
        lines = (self._folder / "output.txt").read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "without a word"

    def kill(self) -> None:
        """End it and everything that it has started."""
        for process in self._family():
            with contextlib.suppress(psutil.Error):
                process.kill()
        self._reap()

    def _family(self) -> list[psutil.Process]:
        found = []
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.Error):
                if process.environ().get(NAME) == self._name or process.pid in (self._pid, self._between):
                    found.append(process)
        return found

    def _reap(self) -> None:
        if self._lifeline >= 0:
            os.close(self._lifeline)
            self._lifeline = -1
        for pid in (self._between, self._pid):
            with contextlib.suppress(ChildProcessError):
                os.waitpid(pid, 0)

    def _left_behind(self) -> list[str]:
        """Return who and what is still there, and end and remove it."""
        _, orphans = psutil.wait_procs([p for p in self._family() if p.pid != self._between], timeout=GRACE_S)
        found = [f"process left behind: {' '.join(orphan.cmdline()[1:4])}" for orphan in orphans]
        for orphan in orphans:
            with contextlib.suppress(psutil.Error):
                orphan.kill()
                orphan.wait(GRACE_S)
        for path in Path("/dev/shm").glob(f"rtstack-{self._pid}-*"):
            found.append(f"shared memory left behind: {path.name}")
            path.unlink(missing_ok=True)
        with contextlib.suppress(ChildProcessError):  # those who ended before they were looked for
            while os.waitpid(-1, os.WNOHANG)[0]:
                continue
        return found


def _end_with(descriptor: int) -> None:
    """Die as soon as the other end of the pipe closes: who has ordered this case is not there any more."""
    while os.read(descriptor, 1):
        continue
    os.kill(os.getpid(), signal.SIGKILL)
