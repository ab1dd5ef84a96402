"""The whole stack on one machine: a supervisor, the robot process and the console, started and ended in order.

It holds the listening socket before anything starts, and both children's standard input, so that they end with it.
"""

import os
import select
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

from hal.base.shared import private_folder, remove_left
from rtstack.loop.mailbox import remove_mailbox

LOOPBACK = "127.0.0.1"
# Python warns of shared memory that a killed process left; `remove_left` removes it
_QUIET = ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), "ignore:resource_tracker")))
_START_TIMEOUT_S = 90.0  # compiled code may have to be compiled for this machine first
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_SHOWN_S = 0.5  # until each page shows why the stack ends
_END_TIMEOUT_S = 10.0  # a controlled stop, the end of the log, and a margin


class StackError(Exception):
    """The stack cannot go on; the message is one line, `status` the exit status."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True, slots=True)
class StackSettings:
    """What to start. `kind` is the cell as the command line spells it; port 0 takes a free one. host: where the console
    listens; https: it speaks nothing else.
    """

    port: int
    logs: Path
    cell: Path
    kind: str = "direct"
    host: str = LOOPBACK
    https: bool = False


class _Ended(Exception):
    """The end was requested: Ctrl-C, SIGTERM, or a terminal that was closed."""


def run_stack(settings: StackSettings) -> int:
    """Run the stack until Ctrl-C, SIGTERM or SIGHUP. Returns the exit status: 1 when a process died, 2 for bad input.

    The program is to end after it: from the end's beginning on, these signals are ignored.
    """
    # the kernel's handler writes at once; one of Python's waits for its turn, and its exception may be lost
    request, woken = socket.socketpair()
    woken.setblocking(False)
    signal.set_wakeup_fd(woken.fileno(), warn_on_full_buffer=False)
    for number in _ENDING:
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as nohup has set it
            signal.signal(number, lambda *_: None)
    try:
        with ExitStack() as stack:
            stack.callback(remove_left)  # of a robot process that was killed
            try:
                _supervise(settings, stack, request.fileno())
            finally:
                for number in _ENDING:
                    signal.signal(number, signal.SIG_IGN)  # nothing may interrupt the orderly end
    except _Ended:
        return 0
    except StackError as error:
        with suppress(OSError):  # the terminal was closed
            print(f"rtstack: {error}", file=sys.stderr, flush=True)
        return error.status
    return 0


def _supervise(settings: StackSettings, stack: ExitStack, request: int) -> None:
    listener = stack.enter_context(listen(settings.port, settings.host))
    folder = stack.enter_context(private_folder("run"))
    name = f"rtstack-{os.getpid()}"
    stack.callback(remove_mailbox, f"{name}-mailbox")
    shared = [
        "--run", str(folder), "--name", name, "--logs", str(settings.logs), "--cell", str(settings.cell),
        "--kind", settings.kind,
    ]  # fmt: skip
    robot = _Child("robot process", "rtstack.live.robot", shared)
    stack.callback(robot.end)
    served = ["--listener", str(listener.fileno()), *["--https"] * settings.https]
    console = _Child("console", "console", [*shared, *served], inherited=(listener.fileno(),))
    stack.callback(console.end)  # ended first: callbacks run backwards
    console.say(robot.first_line(request))  # both import at the same time, which takes seconds
    print(f"rtstack is up: {console.first_line(request)}", flush=True)
    if request in select.select([robot.exit, console.exit, request], [], [])[0]:
        raise _Ended
    robot.tell(signal.SIGHUP)  # at once, and with the true reason: a console that has died is not STOP
    child = robot if robot.ended else console
    how = child.how_it_ended()
    if child is robot:
        console.say(f"The robot process ended ({how}). Start `rtstack up` again.")
        time.sleep(_SHOWN_S)
    raise StackError(f"the {child.what} died: {how}", status=1)


def listen(port: int, host: str = LOOPBACK) -> socket.socket:
    """Return the console's listening socket. Raises StackError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)
    except (OSError, OverflowError) as error:
        listener.close()
        where, option = (f"port {port}", "--port") if host == LOOPBACK else (f"{host}, port {port}", "--host or --port")
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise StackError(f"{where} cannot be used: {reason}; choose another one with {option}", status=2) from None
    return listener


class _Child:
    """A child process in a session of its own, which Ctrl-C does not reach. exit: a descriptor, ready at its end."""

    def __init__(self, what: str, module: str, arguments: list[str], inherited: tuple[int, ...] = ()) -> None:
        self.what = what
        # without a buffer nothing is left to be written when a pipe is closed
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
            start_new_session=True, pass_fds=inherited, env=os.environ | {"PYTHONWARNINGS": _QUIET},
        )  # fmt: skip
        self.exit = os.pidfd_open(self._process.pid)

    def first_line(self, request: int) -> str:
        """Return the line that says that the child is ready. Raises StackError without one, _Ended at a request."""
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout, request], [], [], _START_TIMEOUT_S)
        if request in ready:
            raise _Ended
        if not ready:
            raise StackError(f"the {self.what} did not start within {_START_TIMEOUT_S:g} s", status=1)
        line = self._process.stdout.readline().decode().strip()
        if not line:
            how = self.how_it_ended()
            raise StackError(f"the {self.what} did not start: {how}", status=2 if self._process.returncode == 2 else 1)
        return line

    def say(self, line: str) -> None:
        """Write a line to the child's standard input, if it still lives."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.write(f"{line}\n".encode())

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def how_it_ended(self) -> str:
        """Say how, of a child that has ended."""
        status = self._process.wait()
        if status < 0:
            return f"killed by {signal.Signals(-status).name}"
        return f"exit status {status}; its reason is above"

    def tell(self, number: signal.Signals) -> None:
        """Send the child a signal, if it still lives."""
        with suppress(OSError):
            self._process.send_signal(number)

    def end(self) -> None:
        """End the child in order, and by force when it does not answer."""
        self.tell(signal.SIGTERM)
        try:
            self._process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            print(f"rtstack: the {self.what} does not end, killing it", file=sys.stderr, flush=True)
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        os.close(self.exit)
