"""Wrong set-ups of real arms, by command and on the wire: what is refused, with which line, and what was sent before.

    python -m tests.programs.wrong_set_ups [--json FILE]

Robots with Desk and the control PC are in namespaces of their own, at addresses as metal has them. For each set-up
`rtstack teach` runs to its end, while what the PC sends to the robots' port 1337 is captured. What the cell's file
tells is refused before a packet is sent; what Desk alone can tell (which box, whether it lets programs in), before an
arm is connected to; what only the robot can tell (its model), before Move. The right set-up passes: it moves while the
space bar is held. Exit status 0 where all of it is so, 3 without namespaces.
"""

import argparse
import datetime
import json
import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from sim_robot.desk.process import PORT as DESK_PORT
from sim_robot.desk.server import PASSWORD, USER
from sim_robot.fci.protocol import HEADER, PORT, Command
from tests.programs.link_table import BIN, LEFT, NOT_PERMITTED, RIGHT, TRACKER, Lab
from tests.support.network.namespaces import Namespace, NotPermitted, permitted
from tests.support.real_cell import CALIBRATED, write_cell_file
from tests.support.terminal import Terminal

_ETH_P_ALL, _TCP = 3, 6
FILE, DESK, ROBOT, PASSES = "the file", "Desk", "the robot", "passes"
TODAY = datetime.date.today()
Changes = Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class SetUp:
    """changes: of the right cell's file; told: who tells that it is wrong; says: in the line of the refusal."""

    name: str
    changes: Changes = ()
    left: str = LEFT
    right: str = RIGHT
    told: str = FILE
    says: str = ""
    given: bool = True


@dataclass(frozen=True, slots=True)
class Seen:
    """What came of it. connections, requests, moves: of the robots' port, as the PC sent them."""

    name: str
    told: str
    status: int
    line: str
    connections: int
    requests: int
    moves: int
    right: bool


def serials(left: str, right: str) -> Changes:
    """Return the change by which both boxes are asked who they are."""
    return [(f"[{side}]\n", f'[{side}]\ndesk = "{address}:{DESK_PORT}"\nserial = "{serial}"\n')
            for side, address, serial in (("left", LEFT, left), ("right", RIGHT, right))]  # fmt: skip


OWN = serials("simulated-left", "simulated-right")


def calibrated(text: str) -> Changes:
    """Return the change of the calibration."""
    return [(CALIBRATED, text)]


def ago(days: int) -> str:
    """Return [calibration] of so many days ago."""
    return f"[calibration]\ndate = {TODAY - datetime.timedelta(days=days)}\n"


SET_UPS = (
    SetUp("no cell file", given=False, says="--cell-file"),
    SetUp("simulated arms", [("simulated = false", "simulated = true")], says="simulated = true"),
    SetUp("no calibration", calibrated(""), says="[calibration]"),
    SetUp("calibrated tomorrow", calibrated(ago(-1)), says="after today"),
    SetUp("calibrated half a year ago", calibrated(ago(181)), says="valid until"),
    SetUp("valid for a week, calibrated before", calibrated(ago(8) + "valid_days = 7\n"), says="valid until"),
    SetUp("residuals of 3.1 mm", calibrated(ago(0) + "rms_mm = 3.1\n"), says="rms_mm"),
    SetUp("known to 3.1 mm", calibrated(CALIBRATED + "uncertainty_mm = 3.1\n"), says="uncertainty_mm"),
    SetUp("exchanged addresses", left=RIGHT, right=LEFT, says="address"),
    SetUp("another left address", left="10.77.1.19", says="[left] address"),
    SetUp("another right address", right="10.77.1.19", says="[right] address"),
    SetUp("a name instead of the address", left="left.lab", says="[left] address"),
    SetUp("one arm simulated", right="127.0.0.12", says="two real arms"),
    SetUp("the other arm simulated", left="127.0.0.11", says="two real arms"),
    SetUp("a key that is none", [("[left]\n", "[left]\nadress = 1\n")], says="adress"),
    SetUp("a serial without Desk", [("[left]\n", '[left]\nserial = "a"\n')], says="serial"),
    SetUp("brakes locked", OWN, told=DESK, says="brakes locked"),
    SetUp("exchanged boxes", serials("simulated-right", "simulated-left"), told=DESK, says="exchanged"),
    SetUp("another box on the left", serials("295341-1", "simulated-right"), told=DESK, says="another box"),
    SetUp("another box on the right", serials("simulated-left", "295341-1"), told=DESK, says="another box"),
    SetUp("another model", [*OWN, ("[left]\n", '[left]\nmodel = "fer"\n')], told=ROBOT, says="model"),
    SetUp("the right one", OWN, told=PASSES),
)  # fmt: skip


class Capture(threading.Thread):
    """What a namespace sends to the port of the arms."""

    def __init__(self, namespace: Namespace) -> None:
        super().__init__(daemon=True, name="capture")
        with namespace.inside():
            self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ETH_P_ALL))
        self._streams: dict[tuple[bytes, int], dict[int, bytes]] = {}
        self.start()

    def run(self) -> None:
        """Listen until it is closed."""
        while True:
            try:
                packet = self._socket.recv(65536)
            except OSError:
                return
            header = (packet[0] & 15) * 4
            if packet[0] >> 4 != 4 or packet[9] != _TCP or len(packet) < header + 20:
                continue
            source, target, sequence = struct.unpack_from("!HHI", packet, header)
            if target == PORT:
                payload = packet[header + (packet[header + 12] >> 4) * 4 : struct.unpack_from("!H", packet, 2)[0]]
                self._streams.setdefault((packet[16:20], source), {})[sequence] = payload

    def take(self) -> tuple[int, list[Command]]:
        """Return how many connections there were since the last time, and their requests."""
        streams, self._streams = self._streams, {}
        requests = []
        for segments in streams.values():
            data = b"".join(payload for _, payload in sorted(segments.items()))
            while len(data) >= HEADER.size:
                number, _, size = HEADER.unpack_from(data)
                requests.append(Command(number))
                data = data[max(size, HEADER.size) :]
        return len(streams), requests

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()


def try_out(set_up: SetUp, lab: Lab, capture: Capture, folder: Path, environment: dict[str, str]) -> Seen:
    """Run the command on one set-up."""
    path, log = folder / "cell.toml", folder / "out.mcap"
    text = write_cell_file(path, LEFT, RIGHT, TRACKER)
    for old, new in set_up.changes:
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text)
    command = [BIN / "rtstack", "teach", log, "--cell", f"fci:{set_up.left},{set_up.right}"]
    command += ["--cell-file", path] if set_up.given else []
    if set_up.told in (ROBOT, PASSES):
        lab.control.run(BIN / "rtstack", "desk", "start", "--cell-file", path, env=environment, capture_output=True)
    capture.take()
    terminal = Terminal()
    ends = terminal.theirs
    process = lab.control.start(*command, stdin=ends, stdout=ends, stderr=ends, env=environment)
    terminal.hold(until=lambda _: process.poll() is not None)
    status = process.wait(300.0)
    connections, requests = capture.take()
    moves = sum(request is Command.MOVE for request in requests)
    lines = [line.strip() for line in terminal.said.splitlines() if line.startswith("rtstack: ")]
    refused = status == 2 and len(lines) == 1 and set_up.says in lines[0] and not log.exists()
    right = {
        FILE: refused and connections == 0,
        DESK: refused and connections == 0,
        ROBOT: refused and moves == 0,
        PASSES: status == 0 and moves > 0 and log.exists(),
    }[set_up.told]
    return Seen(set_up.name, set_up.told, status, " ".join(lines)[:300], connections, len(requests), moves, right)


def main() -> int:
    """Try them out, and print a line for each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, help="write what was seen here, too")
    options = parser.parse_args()
    try:
        permitted()
    except NotPermitted as error:
        print(f"no network namespaces here: {error}", file=sys.stderr)
        return NOT_PERMITTED
    seen: list[Seen] = []
    with TemporaryDirectory() as scratch:
        environment = os.environ | {
            "XDG_CONFIG_HOME": scratch, "RTSTACK_DESK_USER": USER, "RTSTACK_DESK_PASSWORD": PASSWORD,
        }  # fmt: skip
        lab = Lab(0)
        robot = lab.robot.start(
            BIN / "rtstack", "sim", "--left", LEFT, "--right", RIGHT, "--tracker", TRACKER, "--desk", "--lockstep",
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        capture = Capture(lab.control)
        try:
            assert robot.stdout is not None
            if not robot.stdout.readline().startswith("serving"):
                raise RuntimeError("the simulated robot did not start")
            desks = (f"--left={LEFT}:{DESK_PORT}", f"--right={RIGHT}:{DESK_PORT}")
            lab.control.run(BIN / "rtstack", "desk", "status", *desks, env=environment, capture_output=True,
                            input="yes\nyes\n", text=True)  # fmt: skip
            for set_up in SET_UPS:
                folder = Path(scratch) / str(len(seen))
                folder.mkdir()
                seen.append(try_out(set_up, lab, capture, folder, environment))
                one = seen[-1]
                print(f"{'ok   ' if one.right else 'WRONG'} {one.name}: {one.connections} connections, {one.moves} of "
                      f"{one.requests} requests are Move, status {one.status}: {one.line}", flush=True)  # fmt: skip
        finally:
            capture.close()
            robot.terminate()
            robot.communicate(timeout=60.0)
            lab.close()
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(one) for one in seen]) + "\n")
    print(f"{sum(one.right for one in seen)} of {len(seen)} as they should be")
    return int(not all(one.right for one in seen))


if __name__ == "__main__":
    sys.exit(main())
