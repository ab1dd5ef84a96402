"""Where processes are killed: robots that keep their own time, and `rtstack trial` or `rtstack up` that moves them."""

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from hal.fci import open_pair
from hal.state import RobotMode
from rtstack.cells import default_cell_file
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable
from rtstack.live.protocol import DemonstrationRequest
from rtstack.log.ring import RingReader, Rings
from rtstack.samples import Mode

COMMAND = Path(sys.executable).with_name("rtstack")
MOVING_S = 0.8  # of the robot's time in motion, before anything is killed
LONGEST_START_S = 120.0
LONGEST_END_S = 60.0
OPERATOR = "fault matrix"
_numbers = itertools.count(1)


class SceneFailed(Exception):
    """The moment was not reached. The message is one line."""


class Robots:
    """`rtstack sim` at addresses of its own: it outlives who moves it, and keeps 1 kHz. options: more of its own."""

    def __init__(self, folder: Path, options: Sequence[str] = ()) -> None:
        prefix = f"127.{70 + os.getpid() // 250 % 20}.{1 + os.getpid() % 250}"
        number = 4 * (next(_numbers) % 60)
        self.left, self.right = f"{prefix}.{number + 1}", f"{prefix}.{number + 2}"
        tracker = f"{prefix}.{number + 3}:1341"
        self.cell = folder / "cell.toml"
        self.cell.write_text(default_cell_file().read_text().replace("127.0.0.1:1341", tracker))
        arguments = ["sim", "--left", self.left, "--right", self.right, "--tracker", tracker, *options]
        self.process = subprocess.Popen([str(COMMAND), *arguments], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        if not self.process.stdout.readline().startswith("serving"):
            raise SceneFailed("the simulated robots do not serve")

    def look(self) -> tuple[str, bool]:
        """Open both arms as somebody else would; say how they are, and whether they are at rest. Recovers them."""
        pair = open_pair(self.left, self.right)
        try:
            errors = [arm.reflex() for arm in (pair.left, pair.right)]
            pair.recover()
            states = [arm.read() for arm in (pair.left, pair.right)]
            still = all(state.robot_mode is RobotMode.IDLE and abs(state.record["dq"]).max() < 0.02 for state in states)
            words = [f"reflex ({', '.join(names)})" if names else "idle" for names in errors]
            return f"left {words[0]}, right {words[1]}, recovered" + (", at rest" if still else ""), still
        finally:
            pair.close()

    def close(self) -> None:
        """End them."""
        end(self.process)


class Watched:
    """The rings of a process: what its loop has published last."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._arms: RingReader | None = None
        self._modes: RingReader | None = None

    def wait_until_moving(self, alive) -> None:
        """Wait until the loop has been moving the arms for a while. Raises SceneFailed."""
        deadline_s, begun_ns = time.monotonic() + LONGEST_START_S, 0
        while time.monotonic() < deadline_s and alive():
            self._attach()
            mode, t_ns = self._latest()
            moving = mode in (Mode.TELEOPERATION, Mode.ANTE_IMPACT)
            begun_ns = (begun_ns or t_ns) if moving else 0
            if moving and t_ns - begun_ns > MOVING_S * 1e9:
                return
            time.sleep(0.02)
        raise SceneFailed("the arms did not get into motion")

    def _attach(self) -> None:
        if self._arms is not None:
            return
        for path in Path("/dev/shm").glob(f"rtstack-{self._pid}-*"):
            with contextlib.suppress(Exception):  # it may not be whole yet, or be the mailbox
                rings = Rings.attach(path.name)
                self._arms, self._modes = rings.reader("/left/arm"), rings.reader("/left/control")

    def _latest(self) -> tuple[Mode, int]:
        control = self._modes.latest() if self._modes is not None else None
        return (Mode.IDLE, 0) if control is None else (Mode(int(control["mode"][0])), int(control["t_ns"][0]))

    @property
    def last_t_ns(self) -> int:
        """Robot's time of the newest state that was published."""
        newest = self._arms.latest() if self._arms is not None else None
        return 0 if newest is None else int(newest["t_ns"][0])


class Trial:
    """`rtstack trial` on robots: the process of the loop, and its log process."""

    def __init__(self, robots: Robots, reference: Path, folder: Path) -> None:
        self.log = folder / "trial.mcap"
        arguments = ["trial", "--reference", reference, "--log", self.log, "--cell-file", robots.cell]
        arguments += ["--cell", f"fci:{robots.left},{robots.right}"]
        self.process = subprocess.Popen(
            [str(COMMAND), *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.loop = psutil.Process(self.process.pid)
        self.watched = Watched(self.process.pid)

    def processes(self) -> dict[str, psutil.Process]:
        """Return who can be killed, by name."""
        return {"trial": self.loop, "log": child(self.loop, "rtstack.log.process")}

    def wait_until_moving(self) -> None:
        """Wait for the moment. Raises SceneFailed."""
        self.watched.wait_until_moving(lambda: self.process.poll() is None)

    def close(self) -> None:
        """End it."""
        end(self.process)


class Stack:
    """`rtstack up` on robots, with an operator who has ordered a demonstration."""

    def __init__(self, robots: Robots, folder: Path) -> None:
        self._logs = folder / "logs"
        arguments = ["up", "--port", 0, "--logs", self._logs, "--cell", robots.cell]
        arguments += ["--left", robots.left, "--right", robots.right]
        self.process = subprocess.Popen(
            [str(COMMAND), *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line.startswith("rtstack is up"):
            raise SceneFailed(f"the stack does not come up: {line.strip()}")
        self.loop = child(psutil.Process(self.process.pid), "rtstack.live.robot")
        words = self.loop.cmdline()
        self.run = Path(words[words.index("--run") + 1])
        self._client = RobotClient(self.run / "robot.sock")
        self._over = threading.Event()
        self._client.take(OPERATOR)
        self._beating = threading.Thread(target=self._beat, daemon=True)
        self._beating.start()
        self._client.arm(OPERATOR)
        self._client.start(DemonstrationRequest(operator=OPERATOR))
        self.watched = Watched(self.loop.pid)

    def _beat(self) -> None:
        while not self._over.wait(0.2):
            with contextlib.suppress(RobotRefused, RobotUnreachable):
                self._client.beat(OPERATOR)

    def processes(self) -> dict[str, psutil.Process]:
        """Return who can be killed, by name."""
        supervisor = psutil.Process(self.process.pid)
        return {
            "supervisor": supervisor,
            "robot process": self.loop,
            "console": child(supervisor, "console"),
            "log": child(self.loop, "rtstack.log.process"),
        }

    @property
    def log(self) -> Path:
        """The log of the demonstration. Raises SceneFailed."""
        for path in self._logs.glob("*.mcap"):
            if "recovered" not in path.name:
                return path
        raise SceneFailed("there is no log")

    def wait_until_moving(self) -> None:
        """Wait for the moment. Raises SceneFailed."""
        try:
            self.watched.wait_until_moving(lambda: self.process.poll() is None and self._job_runs())
        except SceneFailed as failed:
            raise SceneFailed(f"{failed}: {self._client.status().job}") from None

    def _job_runs(self) -> bool:
        job = self._client.status().job
        return job is not None and job.active

    def reason(self) -> str:
        """Return what the robot process says of its job's end, once it has ended."""
        deadline_s = time.monotonic() + LONGEST_END_S
        while time.monotonic() < deadline_s:
            job = self._client.status().job
            if job is not None and not job.active:
                return job.reason or "success"
            time.sleep(0.05)
        raise SceneFailed("the job does not end")

    def close(self) -> None:
        """End it."""
        self._over.set()
        self._client.close()
        end(self.process)


def child(parent: psutil.Process, module: str) -> psutil.Process:
    """Return the child that runs a module. Raises SceneFailed."""
    for process in parent.children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if module in process.cmdline():
                return process
    raise SceneFailed(f"no process {module}")


def end(process: subprocess.Popen) -> str:
    """End a process in order, by force where it does not; return what else it said."""
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGINT)
    try:
        said, _ = process.communicate(timeout=LONGEST_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        said, _ = process.communicate()
    except ValueError:  # its pipe was read to the end before
        said = ""
    return said or ""
