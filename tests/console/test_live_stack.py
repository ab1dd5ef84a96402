"""The whole stack as processes: it comes up, answers, and ends without leaving anything behind."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import closing, contextmanager

import psutil
import pytest

from hal.base.realtime import obtainable, scheduling
from rtstack.live.client import RobotClient
from rtstack.log.reader import read_log
from rtstack.loop.end import End
from tests.support.console.stack import COMMAND, Stack

pytestmark = pytest.mark.alone
TIMEOUT_S = 120.0
REMOVE = "from hal.base.shared import remove_left; remove_left()"  # as the next start does


class MovedStack(Stack):
    """A stack whose errors are kept, and which can be moved."""

    def __init__(self, logs, port=0):
        super().__init__(logs, port=port, errors=subprocess.PIPE)

    @contextmanager
    def moving(self):
        """Take control, arm, order a demonstration, and wait until the arms move; give signs of life meanwhile."""
        with self.beating(), closing(RobotClient(self.run_folder / "robot.sock")) as robot:
            for order in ("take", "arm", "jobs/demonstration"):
                self.post(order, **({"object": "rice_box"} if "/" in order else {}))
            while (status := robot.status()).job is None or status.job.progress < 0.05:
                assert status.phase == "moving", status
                time.sleep(0.05)
            yield

    def ended(self):
        """Wait for the end; return the exit status and what went to stderr."""
        _, errors = self.process.communicate(timeout=TIMEOUT_S)
        self.client.close()
        return self.process.returncode, errors


@pytest.fixture
def stack(tmp_path):
    running = MovedStack(tmp_path / "logs")
    yield running
    if running.process.poll() is None:
        running.process.terminate()
    running.ended()


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


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGKILL])
def test_a_supervisor_that_ends_during_its_start_leaves_nothing_and_no_traceback(tmp_path, number):
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    command = [COMMAND, "up", "--port", "0", "--logs", tmp_path / "logs"]
    up = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    while len(children := psutil.Process(up.pid).children()) < 2:
        time.sleep(0.01)
    up.send_signal(number)
    said = up.communicate(timeout=TIMEOUT_S)  # its children have the same terminal
    assert said == ("", "")
    _, alive = psutil.wait_procs(children, timeout=30)
    assert alive == []
    subprocess.run([sys.executable, "-c", REMOVE], env=environment, check=True)
    assert not list(tmp_path.glob("rtstack-*"))
    assert left_behind(up.pid, *(child.pid for child in children)) == []


# each module of tests/browser ends its stack by SIGTERM
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_it_says_where_it_is_keeps_its_secret_and_ends_all_of_it(stack, number):
    assert re.fullmatch(r"rtstack is up: http://127\.0\.0\.1:\d+/\?token=[\w-]{20,}\n", stack.line)
    assert set(stack.members) == {"supervisor", "rtstack.live.robot", "console"}
    members = list(stack.members.values())
    assert left_behind(stack.process.pid) == [f"rtstack-{stack.process.pid}-mailbox"]
    token = stack.line.strip().partition("token=")[2]
    for process in members:
        assert token not in " ".join(process.cmdline())
    stack.process.send_signal(number)
    assert stack.ended() == (0, "")
    assert not any(member.is_running() for member in members[1:])
    assert left_behind(stack.process.pid) == []


@pytest.mark.parametrize(
    ("module", "what", "end"), [("rtstack.live.robot", "robot process", None), ("console", "console", End.CONSOLE_GONE)]
)
def test_when_one_dies_in_a_motion_it_says_which_and_ends_everything(stack, module, what, end):
    with stack.moving():
        everything, pids = all_of(stack), [stack.process.pid, *(child.pid for child in all_of(stack))]
        assert len(everything) >= 3
        with stack.socket("/live") as page:
            stack.members[module].kill()
            shown = ""
            while end is None and "robot process ended" not in shown:  # its pages show why before they lose the console
                shown = json.loads(page.recv(timeout=TIMEOUT_S))["unreachable"] or ""
        if end is None:
            assert shown == "The robot process ended (killed by SIGKILL). Start `rtstack up` again."
        errors = stack.process.stderr.readline()  # pyright: ignore[reportOptionalMemberAccess]
        while stack.process.poll() is None:  # who saw that presses Ctrl-C now: nothing of it may reach Python's own end
            stack.process.send_signal(signal.SIGINT)
    status, further = stack.ended()
    assert status == 1
    assert errors == f"rtstack: the {what} died: killed by SIGKILL\n"  # and nothing of its shared memory
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
    port, run = int(stack.base.rpartition(":")[2]), stack.run_folder
    assert run.is_dir()
    with stack.moving():
        robot = stack.members["rtstack.live.robot"].pid
        obtained = obtainable()
        assert scheduling(robot) == (obtained.scheduler, obtained.priority)  # the loop's thread
        with closing(RobotClient(run / "robot.sock")) as client:
            assert client.status().scheduler == obtained.scheduler
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
    trail = [json.loads(line)["action"] for line in (stack.logs / "audit.jsonl").read_text().splitlines()]
    assert trail == ["sign in", "take", "arm", "begin", "fault"]
    again = MovedStack(stack.logs, port)
    assert again.line.startswith(f"rtstack is up: http://127.0.0.1:{port}/")
    again.process.terminate()
    assert again.ended() == (0, "")


def test_a_busy_port_is_one_line_and_status_two(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        command = [COMMAND, "up", "--port", str(port), "--logs", tmp_path / "logs"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"rtstack: port {port} cannot be used")
    assert done.stderr.count("\n") == 1


def test_logs_that_cannot_be_written_are_one_line_and_status_two(tmp_path):
    (tmp_path / "logs").write_text("a file")
    command = [COMMAND, "up", "--port", "0", "--logs", tmp_path / "logs"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert json.dumps(str(tmp_path))[1:-1] in done.stderr
