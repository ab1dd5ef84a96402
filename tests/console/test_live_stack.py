"""The whole stack as processes: it comes up, answers, and ends without leaving anything behind."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

TIMEOUT_S = 120.0

COMMAND = Path(sys.executable).with_name("rtstack")


class Stack:
    """A running stack, and what it said."""

    def __init__(self, logs: Path, port: int = 0) -> None:
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


def left_behind(pid: int) -> list[str]:
    """Names of shared memory of a supervisor that has ended."""
    return [name for name in os.listdir("/dev/shm") if name.startswith(f"rtstack-{pid}-")]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_is_and_ends_all_of_it(stack, number):
    assert re.fullmatch(r"rtstack is up: http://127\.0\.0\.1:\d+/\?token=[\w-]{20,}\n", stack.line)
    children = stack.children
    assert set(children) == {"rtstack.live.robot", "console"}
    assert left_behind(stack.process.pid) == [f"rtstack-{stack.process.pid}-mailbox"]
    stack.process.send_signal(number)
    status, errors = stack.end()
    assert (status, errors) == (0, "")
    assert not any(child.is_running() for child in children.values())
    assert left_behind(stack.process.pid) == []


def test_its_secrets_are_in_no_command_line(stack):
    token = stack.line.strip().partition("token=")[2]
    for child in [psutil.Process(stack.process.pid), *stack.children.values()]:
        assert token not in " ".join(child.cmdline())


@pytest.mark.parametrize(("module", "what"), [("rtstack.live.robot", "robot process"), ("console", "console")])
def test_when_one_dies_it_says_which_and_ends_the_other(stack, module, what):
    children = stack.children
    children[module].kill()
    status, errors = stack.end()
    assert status == 1
    # before it, Python's own resource tracker may say that it unlinks the dead process's memory
    assert errors.splitlines()[-1] == f"rtstack: the {what} died: killed by SIGKILL"
    assert "Traceback" not in errors
    assert not any(child.is_running() for child in children.values())
    assert left_behind(stack.process.pid) == []


def test_a_supervisor_that_is_killed_leaves_no_orphan(stack):
    children = list(stack.children.values())
    command = children[0].cmdline()
    run = Path(command[command.index("--run") + 1])
    assert run.is_dir()
    stack.process.kill()
    stack.process.wait()
    _, alive = psutil.wait_procs(children, timeout=30)
    assert alive == []
    assert left_behind(stack.process.pid) == []
    assert not run.exists()


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
