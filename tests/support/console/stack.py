"""`rtstack up` in a process of its own, an operator's session at its console, and pages that look on."""

import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

COMMAND = Path(sys.executable).with_name("rtstack")
LONGEST_JOB_S = 300.0


class SoakFailed(Exception):
    """The stack did not do what was asked. The message is one line."""


@contextmanager
def repeated(act: Callable[[], object], every_s: float) -> Iterator[None]:
    """Call `act` again and again in a thread, whatever of the network's errors it raises."""
    over = threading.Event()

    def go_on() -> None:
        while not over.wait(every_s):
            with suppress(OSError, httpx.HTTPError):
                act()

    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class Stack:
    """`rtstack up`, and a session of an operator at its console."""

    def __init__(self, logs: Path, arms: Sequence[str] = (), port: int = 0, errors: int | None = None) -> None:
        """arms: options of `rtstack up`, none for the simulated cell; errors: where its stderr goes, as in Popen."""
        self.logs = logs
        command = [str(COMMAND), "up", "--port", str(port), "--logs", str(logs), *arms]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline()
        found = re.search(r"(http://\S+?)/\?token=(\S+)", self.line)
        if found is None:
            raise SoakFailed("the stack did not come up: see above")
        self.base, token = found.groups()
        self.client = httpx.Client(base_url=self.base, trust_env=False, timeout=60.0, follow_redirects=True)
        page = self.client.get("/", params={"token": token}).raise_for_status().text
        word = re.search(r'name="csrf-token" content="([^"]+)"', page)
        if word is None:
            raise SoakFailed("the page has no word for its requests")
        self.headers = {"x-csrf-token": word.group(1)}
        self._members = [psutil.Process(self.process.pid), *psutil.Process(self.process.pid).children()]

    @property
    def members(self) -> dict[str, psutil.Process]:
        """Supervisor, robot process and console, by the module that each runs."""
        named = {"supervisor": self._members[0]}
        for process in self._members[1:]:
            words = process.cmdline()
            if "-m" in words:
                named[words[words.index("-m") + 1]] = process
        return named

    @property
    def run_folder(self) -> Path:
        """The folder of the robot process's socket."""
        words = self.members["console"].cmdline()
        return Path(words[words.index("--run") + 1])

    @contextmanager
    def beating(self) -> Iterator[None]:
        """Give the operator's signs of life meanwhile."""
        with repeated(lambda: self.client.post("/api/beat", json={}, headers=self.headers), 0.2):
            yield

    def post(self, path: str, **body: object) -> dict:
        """Make a change. Raises SoakFailed with what the console says."""
        answer = self.client.post(f"/api/{path}", json=body, headers=self.headers)
        if answer.is_error:
            raise SoakFailed(f"{path}: {answer.status_code} {answer.text}")
        return answer.json()

    def socket(self, path: str) -> ClientConnection:
        """Open a WebSocket as a page of the session does."""
        cookie = "; ".join(f"{name}={value}" for name, value in self.client.cookies.items())
        address = self.base.replace("http", "ws") + path
        return connect(address, origin=Origin(self.base), additional_headers={"cookie": cookie}, proxy=None)

    def run(self, path: str, **order: object) -> str:
        """Order a job and wait for its end; return the name of its log. Raises SoakFailed where it failed."""
        self.post(path, **order)
        deadline_s = time.monotonic() + LONGEST_JOB_S
        while time.monotonic() < deadline_s:
            job = self.client.get("/api/status").raise_for_status().json()["job"]
            if job is not None and job["state"] in ("done", "stopped", "failed"):
                if job["state"] != "done":
                    raise SoakFailed(f"{job['title']}: {job['state']}: {job['reason']}")
                return job["log"]
            time.sleep(0.1)
        raise SoakFailed(f"{path}: no end within {LONGEST_JOB_S:g} s")

    def log_id(self, name: str) -> str:
        """Return the id of a log by its name."""
        return next(row["id"] for row in self.client.get("/api/logs").raise_for_status().json() if row["name"] == name)

    def end(self) -> list[str]:
        """End it as Ctrl-C does; return who or what was left behind."""
        self.client.close()
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=60.0)
        _, left = psutil.wait_procs(self._members[1:], timeout=10.0)
        shared = [path.name for process in self._members for path in Path("/dev/shm").glob(f"rtstack-{process.pid}-*")]
        status = [f"exit status {self.process.returncode}"] if self.process.returncode else []
        return status + [f"left behind: {what}" for what in (*left, *shared)]


class Viewer:
    """A page that is open: it reads the live socket, and the operator's answers each view."""

    def __init__(self, stack: Stack, answers: bool) -> None:
        self._answers, self._socket = answers, stack.socket("/live")
        self.views = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        with self._socket as socket:
            while not self._over.is_set():
                try:
                    socket.recv(timeout=1.0)
                except TimeoutError:
                    continue
                except ConnectionClosed:
                    return
                self.views += 1
                if self._answers:
                    socket.send("beat")

    def close(self) -> None:
        """Close the page."""
        self._over.set()
        self._thread.join()
