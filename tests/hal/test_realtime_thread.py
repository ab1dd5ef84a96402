"""Real-time threads, who stands beside them, and what neither may pass on."""

import ctypes
import platform
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import TypeVar

from hal.base.realtime import PRIORITY, beside_realtime, realtime_thread, scheduling
from hal.fci.sockets import open_sockets

ASK = (
    "from hal.base.realtime import beside_realtime, obtainable, scheduling",
    "beside_realtime(); print(*scheduling()); print(obtainable().scheduler)",
)


Given = TypeVar("Given")
Scheduling = tuple[str, int]


def _in_a_thread(task: Callable[[], Given]) -> Given:
    """Return what a task gives in a thread of its own: how this one is scheduled stays as it is."""
    given: list[Given] = []
    thread = threading.Thread(target=lambda: given.append(task()))
    thread.start()
    thread.join()
    return given[0]


def _child() -> Scheduling:
    with subprocess.Popen(["sleep", "60"]) as child:
        try:
            return scheduling(child.pid)
        finally:
            child.kill()


def test_who_is_beside_a_real_time_thread_stands_below_it_and_above_the_ordinary_and_nobody_inherits_it() -> None:
    def beside() -> tuple[Scheduling, Scheduling, Scheduling]:
        beside_realtime()
        return scheduling(), _in_a_thread(scheduling), _child()

    def realtime() -> tuple[Scheduling, Scheduling, Scheduling]:
        with realtime_thread():
            return scheduling(), _in_a_thread(scheduling), _child()

    now = scheduling()
    (loop, loops_thread, loops_child), (side, sides_thread, sides_child) = _in_a_thread(realtime), _in_a_thread(beside)
    assert scheduling() == now
    assert loops_thread == loops_child == sides_thread == sides_child == ("other", 0)
    if loop == ("other", 0):  # no right to it here: nobody has it then
        assert side == loop
        return
    assert loop == ("fifo", PRIORITY)
    assert side[0] == "fifo"
    assert 0 < side[1] < PRIORITY


def test_without_the_right_everything_stays_ordinary_and_nothing_is_said() -> None:
    code = (
        f"import os, resource; resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0)); {ASK[0]}; "
        f"os.getuid() or os.setuid(65534); {ASK[1]}"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert (done.stdout, done.stderr) == ("other 0\nother\n", "")


def _slice_ns() -> int:
    """The calling thread's slice as the kernel tells it: sched_getattr(2), 0 where it is the kernel's own."""
    attributes = ctypes.create_string_buffer(48)
    number = {"x86_64": 315, "aarch64": 275}[platform.machine()]
    assert ctypes.CDLL(None).syscall(number, 0, attributes, len(attributes), 0) == 0
    return int(struct.unpack("=IIQiIQQQ", attributes.raw)[5])


def test_an_ordinary_thread_has_short_slices_as_long_as_it_keeps_real_time() -> None:
    def slices() -> tuple[int, int, int]:
        before = _slice_ns()
        with realtime_thread(priority=0):
            return before, _slice_ns(), scheduling()[1]

    kernel = tuple(int(part) for part in platform.release().split(".")[:2])
    before, within, priority = _in_a_thread(slices)
    assert priority == 0
    assert within == (100_000 if kernel >= (6, 12) else before)
    assert _slice_ns() == before


def test_sockets_of_this_machine_alone_are_no_robots() -> None:
    before = open_sockets(socket.SOCK_STREAM)
    left, right = socket.socketpair()
    with left, right, socket.socket(socket.AF_INET, socket.SOCK_STREAM) as other:
        assert {number for number, _ in open_sockets(socket.SOCK_STREAM) - before} == {other.fileno()}
