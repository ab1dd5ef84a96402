"""From a state to its answer, by the kernel's stamps of both datagrams: our loop, libfranka's and franka-rs, by turns.

    python -m tests.programs.state_to_answer [--rounds 3] [--seconds 8] [--libfranka HEADERS]

Each client in its turn controls arms of `rtstack sim` in real time, on a network namespace of its own; nothing is asked
of the client, so that each is measured alike. HEADERS: where libfranka's `include` folder is, with that of its
submodule `common` (the wheels have none): its C++ loop is compiled against pylibfranka's library. franka-rs has no
controller that does nothing: it holds by its own impedance. Exit status 3 without namespaces and packet sockets.
"""

import argparse
import contextlib
import os
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pylibfranka

from hal.cell import Cell
from hal.fci import FciPair, open_pair
from hal.realtime import realtime_thread
from hal.tracker_link import NoTracker
from rtstack.bench.loop import long_grab
from rtstack.cells import default_cell_file, load_description
from rtstack.cells.fci import approach_collisions, pad_tools
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification
from tests.programs.link_table import NOT_PERMITTED
from tests.support.network.namespaces import Namespace, NotPermitted, permitted

LEFT, RIGHT = "127.0.0.11", "127.0.0.12"
ARMS = ((), (0,), (1,), (0, 1))  # of a mask that FciPair.wait returns
SETTLED = 500  # states until a client's caches and the robot's start are no matter any more
SHORTEST_S = 6.0  # of a demonstration
_ETH_P_IP = 0x0800  # linux/if_ether.h: packets come once, as they are received
_SO_TIMESTAMPNS, _SO_ATTACH_FILTER, _RETURN = 35, 26, 0x06  # asm-generic/socket.h, linux/filter.h
_KEPT = 64  # bytes of a packet: IP's header, UDP's, and the number of the state that both begin with
_BUFFER = 1 << 26


class Wire:
    """What goes over the loopback device of a namespace: when each state was there, and when its answer."""

    def __init__(self, namespace: Namespace) -> None:
        with namespace.inside():
            self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ETH_P_IP))
        program = struct.pack("HBBI", _RETURN, 0, 0, _KEPT)
        kept = np.frombuffer(program, np.uint8)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HL", 1, kept.ctypes.data))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._states: dict[tuple[bytes, int], int] = {}
        self._answers: dict[tuple[bytes, int], int] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._drain)
        self._thread.start()

    def _drain(self) -> None:
        robots = {socket.inet_aton(LEFT), socket.inet_aton(RIGHT)}
        while not self._over.wait(0.1):  # rarely: the kernel has stamped them
            with contextlib.suppress(BlockingIOError):
                while True:
                    packet, extra, _, _ = self._socket.recvmsg(_KEPT, 64, socket.MSG_DONTWAIT)
                    if len(packet) < 36 or packet[9] != socket.IPPROTO_UDP:
                        continue
                    seconds, ns = struct.unpack("qq", extra[0][2])
                    source, target, (number,) = packet[12:16], packet[16:20], struct.unpack_from("<Q", packet, 28)
                    if source in robots:
                        self._states.setdefault((source, number), seconds * 10**9 + ns)
                    if target in robots:
                        self._answers.setdefault((target, number), seconds * 10**9 + ns)

    def close(self) -> np.ndarray:
        """End it; return how long the answers took, us, each arm's first ones left out."""
        self._over.set()
        self._thread.join()
        self._socket.close()
        found = []
        for robot in {robot for robot, _ in self._answers}:
            keys = sorted(key for key in self._answers if key[0] == robot and key in self._states)[SETTLED:]
            found += [1e-3 * (self._answers[key] - self._states[key]) for key in keys]
        return np.array(found)


def no_op(seconds: float) -> None:
    """Our way of a state and its answer, for both arms, with no torque in it."""
    pair = _pair()
    arms, none = (pair.left, pair.right), np.zeros(7)
    with realtime_thread():
        until_s = time.monotonic() + seconds
        pair.start()
        while time.monotonic() < until_s:
            for k in ARMS[pair.wait()]:
                arms[k].read()
                arms[k].write(none)
    for arm in arms:
        arm.close()


def whole_tick(seconds: float) -> None:
    """Our loop with all that is in it: a demonstration by both arms, into a log."""
    description, _ = load_description(None)
    asked, pair = DemonstrationSpecification(), _pair()
    cell = Cell("fci", pair.left, pair.right, NoTracker(), pair, own_clocks=True, cycles=pair.cycles)
    with tempfile.TemporaryDirectory() as folder:
        log = open_log(Path(folder) / "whole.mcap", asked, description, "realtime", default_cell_file())
        try:
            script = long_grab(max(SHORTEST_S, seconds))
            result = run_demonstration(asked, description, cell, RunContext(log), script=script)
        finally:
            cell.close()
    if not result.success:
        sys.exit(result.failure_reason)


def _pair() -> FciPair:
    description, _ = load_description(None)
    return open_pair(LEFT, RIGHT, pad_tools(description), approach_collisions(description))


def franka_rs(seconds: float) -> None:
    """franka-rs: its loop in Rust holds the left arm's joints."""
    import franka

    robot = franka.Robot(LEFT, realtime="ignore")
    with robot.joint_targets():
        time.sleep(seconds)


OURS = {"no-op, both arms": no_op, "whole tick, both arms": whole_tick, "franka-rs, its impedance": franka_rs}
CPP = "libfranka, C++, no-op"


def compiled_loop(headers: Path, folder: Path) -> Path:
    """Compile libfranka's own loop with a controller that does nothing, against the wheel's library."""
    library, program = Path(pylibfranka.__file__).parent / "libfranka.so", folder / "no_op"
    source = Path(__file__).with_name("clients") / "no_op.cpp"
    subprocess.run(
        ["g++", "-O2", "-std=c++17", f"-I{headers}", str(source), "-o", str(program), str(library),
         "-Wl,--unresolved-symbols=ignore-in-shared-libs", f"-Wl,-rpath,{library.parent}"],
        check=True,
    )  # fmt: skip
    return program


def measure(command: list[str], seconds: float) -> np.ndarray:
    """Serve a cell, let a client control its arms; return how long its answers took, us."""
    namespace = Namespace()
    serve = ["-m", "sim_robot.fci", "--left", LEFT, "--right", RIGHT, "--phase-us", "500", "--cpu", "0"]
    server = namespace.start(sys.executable, *serve, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        if not server.stdout.readline().startswith("serving"):
            raise RuntimeError("the simulated robot did not start")
        wire = Wire(namespace)
        try:
            done = namespace.run(*command, stdout=subprocess.DEVNULL, timeout=60.0 + 10.0 * seconds)
        finally:
            answers = wire.close()
        if done.returncode:
            print(f"{command}: ended with {done.returncode}", file=sys.stderr)
        return answers
    finally:
        server.terminate()
        server.communicate(timeout=30.0)
        namespace.close()


def main() -> int:
    """Measure in turns, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--libfranka", type=Path)
    parser.add_argument("--client", choices=OURS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.client:
        OURS[options.client](options.seconds)
        return 0
    try:
        permitted()
    except NotPermitted as error:
        print(error, file=sys.stderr)
        return NOT_PERMITTED
    me = [sys.executable, "-m", "tests.programs.state_to_answer", "--seconds", str(options.seconds), "--client"]
    with tempfile.TemporaryDirectory() as folder:
        clients = {name: [*me, name] for name in OURS}
        if options.libfranka:
            program = compiled_loop(options.libfranka.resolve(), Path(folder))
            clients[CPP] = [str(program), LEFT, str(round(1e3 * options.seconds))]
        print("| round | client | answers | p50 us | p99 us |\n|---|---|---|---|---|", flush=True)
        for number in range(1, options.rounds + 1):
            for name, command in clients.items():
                us = measure(command, options.seconds)
                p50, p99 = np.percentile(us, (50.0, 99.0)) if len(us) else (np.nan, np.nan)
                print(f"| {number} | {name} | {len(us)} | {p50:.1f} | {p99:.1f} |", flush=True)
    print(f"load of this machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} CPUs")
    return 0


if __name__ == "__main__":
    sys.exit(main())
