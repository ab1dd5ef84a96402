"""The simulated robot in a process of its own, at loopback addresses of its own."""

import contextlib
import itertools
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from math import degrees
from pathlib import Path

from hal.base.realtime import end_with_parent, robot_cpu
from hal.displacement import Displacement
from hal.errors import HardwareError
from hal.tracker import TrackerFrames
from hal.tracker_link import TrackerLink
from hal.wire import PORT
from rtstack.samples import SIDES

_END_S = 5.0
_pairs = itertools.count()


class Simulator:
    """A running simulated robot. `report` is what it said about its own pace, once it has been closed."""

    def __init__(
        self, object_name: str, displacement: Displacement | float, seed: int, *, lockstep: bool,
        faults: Path | None = None, cell_file: Path | None = None, profile: str = "ideal",
        frames: TrackerFrames | None = None, more: Sequence[str] = (), sides: Sequence[str] = SIDES,
    ) -> None:  # fmt: skip
        """Start it, and wait until it serves.

        object_name: empty for none; faults: a script of them; cell_file: of a lab, with objects of its own; profile:
        see sim_robot.profile; frames: of its tracker; more: options of `rtstack sim`, as they are written there. sides:
        the arms that there are; `left`, `right`: their addresses or None. Raises HardwareError with what it says.
        """
        shift = Displacement.of(displacement)
        self.tracker = TrackerLink(frames=frames)
        self.report = ""
        said: str | None = None
        host, port = self.tracker.address
        # away from the loop, which takes the last CPU: server and loop together fill most of a period
        pace = ["--lockstep"] if lockstep else ["--cpu", str(robot_cpu())]
        only = [] if len(sides) > 1 else ["--only", *sides]
        for pair in _free_pairs():
            addresses = {side: address for side, address in zip(SIDES, pair, strict=True) if side in sides}
            self.left, self.right = map(addresses.get, SIDES)
            command = [
                sys.executable, "-m", "rtstack", "sim", "--tracker", f"{host}:{port}",
                *(f"--{side}={address}" for side, address in addresses.items()), *only,
                "--object", object_name or "none",
                f"--displacement-mm={shift.y_m * 1e3!r}", f"--displacement-x-mm={shift.x_m * 1e3!r}",
                f"--yaw-deg={degrees(shift.yaw_rad)!r}", "--seed", str(seed), "--profile", profile,
                *([] if cell_file is None else ["--cell-file", str(cell_file)]),
                *([] if faults is None else ["--faults", str(faults)]),
            ]  # fmt: skip
            # a group of its own: Ctrl-C is for the loop, which brakes first. If we are killed, the kernel ends it.
            self._process = subprocess.Popen(
                [*command, *pace, *more],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                start_new_session=True, preexec_fn=end_with_parent,
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
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Its exit status, negative for the signal that has killed it; None while it runs."""
        return self._process.returncode

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
        probe.bind((address, PORT))
        return True
    return False
