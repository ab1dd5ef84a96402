"""The whole stack as processes: it comes up, answers, and ends without leaving anything behind."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import psutil
import pytest

from hal.realtime import obtainable, scheduling
from rtstack.live.client import RobotClient
from rtstack.log.reader import read_log
from rtstack.loop.end import End

pytestmark = pytest.mark.alone
TIMEOUT_S = 120.0

COMMAND = Path(sys.executable).with_name("rtstack")


class Stack:
    """A running stack, and what it said."""

    def __init__(self, logs: Path, port: int = 0) -> None:
        self.logs = logs
        self.process = subprocess.Popen(
            [str(COMMAND), "up", "--port", str(port), "--logs", str(logs)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline()

    @property
    def children(self) -> dict[str, psutil.Process]:
        """The robot process and the console."""
        found = {}
        for child in psutil.Process(self.process.pid).children():
            words = child.cmdline()
            found[words[words.index("-m") + 1]] = child
        return found

    @property
    def run(self) -> Path:
        """The folder of the robot process's socket."""
        command = self.children["console"].cmdline()
        return Path(command[command.index("--run") + 1])

    def start_a_job(self) -> None:
        """Sign in, take control, arm, order a demonstration, and wait until the arms move: over HTTP, as a program."""
        address, token = self.line.split()[-1].split("/?token=")
        client = httpx.Client(base_url=address, trust_env=False, timeout=60.0)
        page = client.get("/", params={"token": token}, follow_redirects=True).text
        words = re.search(r'name="csrf-token" content="([^"]+)"', page)
        assert words is not None
        client.headers["x-csrf-token"] = words[1]
        for order in ("take", "arm", "jobs/demonstration"):
            client.post(f"/api/{order}", json={"object": "rice_box"} if "/" in order else {}).raise_for_status()

        def beat() -> None:
            try:
                while client.post("/api/beat").status_code in (200, 409):
                    time.sleep(0.2)
            except httpx.HTTPError:
                pass  # the console is gone
            client.close()

        threading.Thread(target=beat, daemon=True).start()
        robot = RobotClient(self.run / "robot.sock")
        try:
            while (status := robot.status()).job is None or status.job.progress < 0.05:
                assert status.phase == "moving", status
                time.sleep(0.05)
        finally:
            robot.close()

    def end(self) -> tuple[int, str]:
        """Wait for the end; return the exit status and what went to stderr."""
        _, errors = self.process.communicate(timeout=TIMEOUT_S)
        return self.process.returncode, errors


@pytest.fixture
def stack(tmp_path):
    running = Stack(tmp_path / "logs")
    yield running
    if running.process.poll() is None:
        running.process.terminate()
    running.end()


def left_behind(*pids: int) -> list[str]:
    """Names of shared memory of processes that have ended."""
    return [name for name in os.listdir("/dev/shm") if name.startswith(tuple(f"rtstack-{pid}-" for pid in pids))]


def all_of(stack: Stack) -> list[psutil.Process]:
    """Every process of a stack below the supervisor: the log process is the robot process's."""
    return psutil.Process(stack.process.pid).children(recursive=True)


def log_of(stack: Stack):
    """Return the only log."""
    (path,) = stack.logs.glob("*.mcap")
    return read_log(path)


# each module of tests/browser ends its stack by SIGTERM
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_it_says_where_it_is_keeps_its_secret_and_ends_all_of_it(stack, number):
    assert re.fullmatch(r"rtstack is up: http://127\.0\.0\.1:\d+/\?token=[\w-]{20,}\n", stack.line)
    children = stack.children
    assert set(children) == {"rtstack.live.robot", "console"}
    assert left_behind(stack.process.pid) == [f"rtstack-{stack.process.pid}-mailbox"]
    token = stack.line.strip().partition("token=")[2]
    for process in [psutil.Process(stack.process.pid), *children.values()]:
        assert token not in " ".join(process.cmdline())
    stack.process.send_signal(number)
    status, errors = stack.end()
    assert (status, errors) == (0, "")
    assert not any(child.is_running() for child in children.values())
    assert left_behind(stack.process.pid) == []


@pytest.mark.parametrize(
    ("module", "what", "end"),
    [("rtstack.live.robot", "robot process", None), ("console", "console", End.CONSOLE_GONE)],
)
def test_when_one_dies_in_a_motion_it_says_which_and_ends_everything(stack, module, what, end):
    stack.start_a_job()
    everything, pids = all_of(stack), [stack.process.pid, *(child.pid for child in all_of(stack))]
    assert len(everything) >= 3
    stack.children[module].kill()
    errors = ""  # Python's own resource tracker may say first that it unlinks the dead process's memory
    while "died" not in errors:
        errors += stack.process.stderr.readline()  # pyright: ignore[reportOptionalMemberAccess]
    while stack.process.poll() is None:  # whoever saw that presses Ctrl-C now: nothing of it may reach Python's own end
        stack.process.send_signal(signal.SIGINT)
    status, further = stack.end()
    assert status == 1
    assert errors.splitlines()[-1] == f"rtstack: the {what} died: killed by SIGKILL"
    assert "Traceback" not in errors
    assert further == ""
    _, alive = psutil.wait_procs(everything, timeout=30)  # the log process finishes its file
    assert alive == []
    assert left_behind(*pids) == []
    if end is None:
        assert log_of(stack).metadata["log"]["ended"] == "the program died"
    else:
        assert log_of(stack).metadata["result"]["failure_reason"].startswith(end)


@pytest.mark.long
def test_a_supervisor_that_is_killed_in_a_motion_leaves_nothing_and_the_next_one_starts(stack):
    port = int(stack.line.split(":")[-1].split("/")[0])
    run = stack.run
    assert run.is_dir()
    stack.start_a_job()
    robot = stack.children["rtstack.live.robot"].pid
    obtained = obtainable()
    assert scheduling(robot) == (obtained.scheduler, obtained.priority)  # the loop's thread
    client = RobotClient(run / "robot.sock")
    assert client.status().scheduler == obtained.scheduler
    client.close()
    assert {scheduling(process.pid)[0] for process in all_of(stack) if process.pid != robot} == {"other"}
    everything, pids = all_of(stack), [stack.process.pid, *(child.pid for child in all_of(stack))]
    stack.process.kill()
    stack.process.wait()
    _, alive = psutil.wait_procs(everything, timeout=30)
    assert alive == []
    assert left_behind(*pids) == []
    assert not run.exists()
    metadata = log_of(stack).metadata
    assert metadata["result"]["failure_reason"].startswith(End.PARENT_GONE)
    assert json.loads(metadata["trial"]["host"])["loop_scheduler"] == obtained.scheduler
    again = Stack(stack.logs, port)
    assert again.line.startswith(f"rtstack is up: http://127.0.0.1:{port}/")
    again.process.terminate()
    assert again.end() == (0, "")
    trail = [json.loads(line)["action"] for line in (stack.logs / "audit.jsonl").read_text().splitlines()]
    assert trail == ["sign in", "take", "arm", "begin", "fault"]


def test_a_busy_port_is_one_line_and_status_two(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        stack = Stack(tmp_path / "logs", port)
        status, errors = stack.end()
    assert status == 2
    assert stack.line == ""
    assert errors.startswith(f"rtstack: port {port} cannot be used")
    assert errors.count("\n") == 1


def test_logs_that_cannot_be_written_are_one_line_and_status_two(tmp_path):
    (tmp_path / "logs").write_text("a file")
    stack = Stack(tmp_path / "logs")
    status, errors = stack.end()
    assert status == 2
    assert "Traceback" not in errors
    assert json.dumps(str(tmp_path))[1:-1] in errors
