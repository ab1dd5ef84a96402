"""The simulated robot in a process of its own, at loopback addresses that nobody else has."""

import contextlib
import ctypes
import itertools
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from math import degrees
from pathlib import Path

import typer

from hal.displacement import Displacement
from hal.errors import HardwareError
from hal.realtime import ANY_CPU, robot_cpu
from hal.tracker_link import TrackerLink
from rtstack.model.cell_description import load_cell_description
from rtstack.trials.errors import TrialError

_FCI_PORT = 1337
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_END_S = 5.0
_pairs = itertools.count()
_libc = ctypes.CDLL(None)


class Simulator:
    """A running simulated robot. `report` is what it said about its own pace, once it has been closed."""

    def __init__(
        self, object_name: str, displacement: Displacement | float, seed: int, *, lockstep: bool,
        faults: Path | None = None, cell_file: Path | None = None,
    ) -> None:  # fmt: skip
        """Start it, and wait until it serves. object_name: empty for none; faults: a script of them.

        cell_file: of a lab, with objects of its own.

        Raises HardwareError with what it says.
        """
        shift = Displacement.of(displacement)
        self.tracker = TrackerLink()
        self.report = ""
        said: str | None = None
        host, port = self.tracker.address
        # away from the loop, which takes the last CPU: server and loop together fill most of a period
        pace = ["--lockstep"] if lockstep else ["--cpu", str(robot_cpu())]
        for self.left, self.right in _free_pairs():
            command = [
                sys.executable, "-m", "sim_robot.fci", "--tracker", f"{host}:{port}",
                "--left", self.left, "--right", self.right, "--object", object_name or "none",
                f"--displacement-mm={shift.y_m * 1e3!r}", f"--displacement-x-mm={shift.x_m * 1e3!r}",
                f"--yaw-deg={degrees(shift.yaw_rad)!r}", "--seed", str(seed),
                *([] if cell_file is None else ["--cell-file", str(cell_file)]),
                *([] if faults is None else ["--faults", str(faults)]),
            ]  # fmt: skip
            # a group of its own: Ctrl-C is for the loop, which brakes first. If we are killed, the kernel ends it.
            self._process = subprocess.Popen(
                command + pace,
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                start_new_session=True, preexec_fn=_end_with_parent,
            )  # fmt: skip
            said = self._wait_until_it_serves()
            if said is None:
                return
            self._end()
            if "in use" not in said:
                break
        self.tracker.close()
        raise HardwareError(f"the simulated robot did not start: {said or 'no free loopback address'}")

    def _wait_until_it_serves(self) -> str | None:
        """Return None when it serves, what it said when it ended."""
        assert self._process.stdout is not None
        said = ""
        for line in self._process.stdout:
            if line.startswith("serving"):
                return None
            said = line.strip() or said
        return said or f"exit status {self._process.wait()}"

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def close(self) -> None:
        """End the process and wait for it; never raises. May be called twice."""
        self._end()
        self.tracker.close()

    def _end(self) -> None:
        process = self._process
        if process.returncode is None:
            process.terminate()
        try:
            rest, _ = process.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            rest, _ = process.communicate()
        except ValueError:  # its pipe was closed before
            return
        self.report = rest.strip() or self.report


def _end_with_parent() -> None:
    """In the child: be sent SIGTERM when the parent ends, however it ends."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _free_pairs() -> Iterator[tuple[str, str]]:
    """Pairs of loopback addresses of this process: the process id keeps two of them apart."""
    for attempt in range(20):
        first = 2 * (next(_pairs) % 120) + 1
        group = (os.getpid() + 251 * attempt) % 60_000
        prefix = f"127.{16 + group // 250 % 239}.{1 + group % 250}"
        pair = (f"{prefix}.{first}", f"{prefix}.{first + 1}")
        if all(map(_free, pair)):
            yield pair


def _free(address: str) -> bool:
    with contextlib.suppress(OSError), socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, _FCI_PORT))
        return True
    return False


def chosen_cpu(cpu: int | None) -> int:
    """Return where a served robot is to stay, -1 for anywhere. Raises TrialError for a CPU that we have not."""
    ours = os.sched_getaffinity(0)
    if cpu is not None and cpu != ANY_CPU and cpu not in ours:
        raise TrialError(f"--cpu {cpu}: choose one of {', '.join(map(str, sorted(ours)))}, or -1 for any")
    return robot_cpu() if cpu is None else cpu


def serve(
    arguments: list[str], left: str, right: str, object_name: str, displacement: dict[str, float],
    cell_file: Path | None,
) -> None:  # fmt: skip
    """Serve in this process until Ctrl-C. arguments: further ones of `python -m sim_robot.fci`.

    displacement: its options (displacement-mm and the like) with their values.
    """
    signal.signal(signal.SIGINT, lambda number, frame: os._exit(0))  # the imports take seconds, and nothing runs yet
    from sim_robot.fci.__main__ import main

    if cell_file is not None:
        load_cell_description(cell_file)  # the other keys are the controller's: a mistake in them is one here, too
    cell = f"--cell fci:{left},{right}"
    thing = f" --object {object_name}" * (object_name != "rice_box")
    shift = "".join(f" --{option}={value:g}" for option, value in displacement.items() if value != 0.0)
    file = "" if cell_file is None else f" --cell-file {cell_file}"
    trial = f"run a trial against it: rtstack trial --reference REC.mcap {cell}{thing}{shift}{file}"
    if object_name == "none":
        trial = f"there is nothing to grab: play a log on it: rtstack play LOG.mcap {cell}"
    status = main(
        [f"--left={left}", f"--right={right}", f"--object={object_name}"]
        + [f"--{option}={value!r}" for option, value in displacement.items()]
        + [f"--cell-file={cell_file}"] * (cell_file is not None)
        + arguments,
        prog="rtstack sim",
        next_step=trial,
    )
    if status:
        raise typer.Exit(status)
