"""Injected stalls, and who the log says was late: robot and control PC in two namespaces, with a cable between.

    python -m tests.programs.blame [--stalls 200] [--seed 0] [--out DIR]

Stalls of 3 to 9 ms whose side is known: the loop's process is stopped (HOST), a FIFO process takes its CPU (HOST), its
tick computes for long (HOST), another thread collects garbage (HOST), the cable holds its packets or loses them (WIRE),
the robot's server is stopped (ROBOT). Of the late cycles in a stall the worst one has to have its label. Exit status 0
where at least 99 of 100 are right and none is laid to the other side (HOST against the others), 3 without namespaces.
"""

import argparse
import gc
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from hal.cell import Cell
from hal.fci import open_pair
from hal.realtime import beside_realtime
from hal.tracker_link import NoTracker
from rtstack.bench.loop import long_grab
from rtstack.cells import default_cell_file, load_description
from rtstack.cells.fci import approach_collisions, pad_tools
from rtstack.log.lateness import Blame, LateCycle, lateness_of
from rtstack.log.reader import read_log
from rtstack.samples import SIDES
from rtstack.topics import CYCLE_TOPICS
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification
from rtstack.trials.start_motion import start_motion
from tests.programs.link_table import LEFT, NOT_PERMITTED, RIGHT, TRACKER, Lab
from tests.support.network.namespaces import NotPermitted, permitted
from tests.support.network.relay import Cable

STALL_MS = (3.0, 9.0)
A_RUN = 25  # stalls, a quiet time between each two
QUIET_S = 0.6
TRIES = 5
AFTER_US = 2000.0  # what comes so shortly after a stall belongs to it
BEGINNING_S, END_S = 3.0, 4.0  # of a demonstration, without stalls
GARBAGE = 150_000  # containers that a collection looks at: it takes some 5 ms
EXPECTED = {
    "stopped": Blame.HOST, "hog": Blame.HOST, "tick": Blame.HOST, "collection": Blame.HOST,
    "cable held": Blame.WIRE, "cable lost": Blame.WIRE, "server": Blame.ROBOT,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stall:
    """What was held up, from when to when, us of the host's monotonic clock."""

    kind: str
    begun_us: float
    ended_us: float


class InTick:
    """A stop signal that is looked at in each tick, and computes when it is told to; and a thread that collects."""

    def __init__(self) -> None:
        self._until_ns = 0
        self._garbage: list[list] = []
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def stop_requested(self) -> bool:
        """False, later."""
        for_ns, self._until_ns = self._until_ns, 0
        if for_ns:
            until = time.monotonic_ns() + for_ns
            while time.monotonic_ns() < until:
                pass
        return False

    def _listen(self) -> None:
        beside_realtime()
        for line in sys.stdin:
            kind, ms = line.split()
            if not self._garbage:  # by now what there was before the run is frozen, and no collection looks at it
                for _ in range(GARBAGE // 300):
                    self._garbage.extend([] for _ in range(300))
                    time.sleep(1e-3)
            if kind == "tick":
                self._until_ns = round(1e6 * float(ms))
            else:
                gc.collect()


def control(log: Path, seconds: float) -> None:
    """The control PC: a demonstration with a long carry, whose log goes to a file."""
    description, _ = load_description(None)
    asked = DemonstrationSpecification()
    pair = open_pair(LEFT, RIGHT, pad_tools(description), approach_collisions(description))
    cell = Cell("fci", pair.left, pair.right, NoTracker(), pair, own_clocks=True, cycles=pair.cycles)
    try:
        way = start_motion(cell, description, asked.object)
        context = RunContext(open_log(log, asked, description, "realtime", default_cell_file()), stop=InTick())
        print("ready", flush=True)
        result = run_demonstration(asked, description, cell, context, way=way, script=long_grab(seconds))
        print(json.dumps(result.as_dict()), flush=True)
    finally:
        cell.close()


def hog(cpu: int) -> None:
    """Take a CPU for as many ms as each line says."""
    os.sched_setaffinity(0, {cpu})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(95))
    print("ready", flush=True)
    for line in sys.stdin:
        until = time.monotonic_ns() + round(1e6 * float(line))
        while time.monotonic_ns() < until:
            pass
        print("done", flush=True)


class Stalls:
    """Makes them, from outside."""

    def __init__(self, lab: Lab, robot: subprocess.Popen, loop: subprocess.Popen, cpu: int) -> None:
        self._lab, self._robot, self._loop = lab, robot, loop
        self._hog = subprocess.Popen(
            [sys.executable, "-m", "tests.programs.blame", "--hog", str(cpu)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._hog.stdout is not None
        self._hog.stdout.readline()

    def make(self, kind: str, ms: float) -> Stall:
        """Make one of so many ms, and wait for its end."""
        begun_us = 1e-3 * time.monotonic_ns()
        stopped = {"stopped": self._loop.pid, "cable held": self._lab.relay_pid, "server": self._robot.pid}.get(kind)
        if stopped is not None:
            os.kill(stopped, signal.SIGSTOP)
            time.sleep(1e-3 * ms)
            os.kill(stopped, signal.SIGCONT)
        elif kind == "cable lost":
            self._lab.set(Cable(loss=1.0))
            time.sleep(1e-3 * ms)
            self._lab.set(Cable())
        elif kind == "hog":
            _say(self._hog, f"{ms}")
            assert self._hog.stdout is not None
            self._hog.stdout.readline()
        else:
            _say(self._loop, f"{kind} {ms}")
            time.sleep(2e-3 * ms + 10e-3)  # a collection takes as long as it takes
        return Stall(kind, begun_us, 1e-3 * time.monotonic_ns())

    def close(self) -> None:
        """End the hog."""
        self._hog.communicate()


def _say(process: subprocess.Popen, line: str) -> None:
    assert process.stdin is not None
    process.stdin.write(line + "\n")
    process.stdin.flush()


def run(kinds: list[str], chance: random.Random, log: Path) -> tuple[list[Stall], dict]:
    """Make these stalls during one run; return them and what the loop said."""
    lab = Lab(chance.randrange(1000))
    cpus = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(lab.relay_pid, {cpus[0]})
    os.sched_setscheduler(lab.relay_pid, os.SCHED_FIFO, os.sched_param(90))  # a cable waits for no robot
    serve = f"-m sim_robot.fci --left {LEFT} --right {RIGHT} --tracker {TRACKER} --cpu {cpus[0]}".split()
    robot = lab.robot.start(
        sys.executable, *serve, "--phase-us", "500", "--drift-ppm", "50",
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    loop = None
    try:
        assert robot.stdout is not None
        if not robot.stdout.readline().startswith("serving"):
            raise RuntimeError("the simulated robot did not start")
        seconds = BEGINNING_S + END_S + len(kinds) * (QUIET_S + 2e-3 * STALL_MS[1] + 0.02)
        loop = lab.control.start(
            sys.executable, "-m", "tests.programs.blame", "--control", log, "--seconds", str(seconds),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert loop.stdout is not None
        stalls = Stalls(lab, robot, loop, cpus[-1])
        if loop.stdout.readline() != "ready\n":
            raise RuntimeError("the loop did not start")
        _wait_for_motion(log, loop)
        if loop.poll() is None:
            stalls.make("tick", 0.0)  # the first word makes the garbage
        time.sleep(BEGINNING_S)
        made = []
        for kind in kinds:
            time.sleep(QUIET_S * chance.uniform(0.8, 1.2))
            if loop.poll() is None:
                made.append(stalls.make(kind, chance.uniform(*STALL_MS)))
        said = loop.stdout.readline()
        stalls.close()
        return made, json.loads(said or "{}")
    finally:
        for process in filter(None, (loop, robot)):
            process.terminate()
            process.communicate(timeout=60.0)
        lab.close()


def _wait_for_motion(log: Path, loop: subprocess.Popen) -> None:
    """Wait until the log has grown beyond its beginning, or its run has ended: the arms go their way to the start
    before."""
    deadline_s = time.monotonic() + 240.0
    before = -1
    while time.monotonic() < deadline_s:
        size = log.stat().st_size if log.exists() else 0
        if loop.poll() is not None or (before > 0 and size > before + 200_000):
            return
        before = before if before > 0 else size
        time.sleep(0.1)
    raise RuntimeError("the arms did not begin to move")


def labels(stalls: list[Stall], log: Path) -> tuple[list[tuple[Stall, LateCycle | None]], int, int]:
    """Return each stall that the log has with its worst late cycle, how many cycles were late outside of them, and how
    many there were."""
    read = read_log(log)
    found = lateness_of(read)
    if found is None:
        return [], 0, 0
    cycles = {side: read.topic(topic) for side, topic in zip(SIDES, CYCLE_TOPICS, strict=True)}
    logged_us = max(own["arrived_us"][-1] for own in cycles.values())
    start_ns = min(int(own["t_ns"][0]) for own in cycles.values())
    spans = []
    for late in found.late:
        own = cycles[late.side]
        cycle = own[int(abs(own["t_ns"] - start_ns - round(1e9 * late.t_s)).argmin())]
        spans.append((cycle["arrived_us"] - late.outside_us, cycle["arrived_us"] + cycle["answered_us"]))
    worst: list[tuple[Stall, LateCycle | None]] = []
    inside = set()
    for stall in (one for one in stalls if one.ended_us + AFTER_US < logged_us):
        within = [k for k, (a, b) in enumerate(spans) if a <= stall.ended_us + AFTER_US and b >= stall.begun_us - 500.0]
        inside |= set(within)
        worst.append((stall, max((found.late[k] for k in within), key=lambda one: one.late_us, default=None)))
    return worst, len(spans) - len(inside), found.cycles


def main() -> int:
    """Make the stalls, and print what became of each kind."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--stalls", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="folder for the logs")
    parser.add_argument("--control", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--seconds", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--hog", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.control is not None:
        control(options.control, options.seconds)
        return 0
    if options.hog is not None:
        hog(options.hog)
        return 0
    try:
        permitted()
    except NotPermitted as error:
        print(f"no network namespaces here: {error}", file=sys.stderr)
        return NOT_PERMITTED
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(98))
    chance = random.Random(options.seed)
    kinds = [list(EXPECTED)[k % len(EXPECTED)] for k in range(options.stalls)]
    chance.shuffle(kinds)
    counts: dict[str, Counter] = {kind: Counter() for kind in EXPECTED}
    wrong_side = right = done = outside = cycles = 0
    with tempfile.TemporaryDirectory() as scratch:
        out = options.out or Path(scratch)
        out.mkdir(parents=True, exist_ok=True)
        for number in range(0, len(kinds), A_RUN):
            log = out / f"{number:03d}.mcap"
            log.unlink(missing_ok=True)
            for _ in range(TRIES):  # a cable as slow as this one may lose an arm before there was any stall
                made, said = run(kinds[number : number + A_RUN], chance, log)
                if made:
                    break
                log.unlink(missing_ok=True)
            worst, elsewhere, of = labels(made, log)
            outside, cycles, done = outside + elsewhere, cycles + of, done + len(worst)
            for stall, late in worst:
                name = "none late" if late is None else f"{late.blame} {late.cause}".strip()
                counts[stall.kind][name] += 1
                if late is not None:
                    right += late.blame is EXPECTED[stall.kind]
                    wrong = (late.blame is Blame.HOST) != (EXPECTED[stall.kind] is Blame.HOST)
                    wrong_side += wrong
                    if late.blame is not EXPECTED[stall.kind]:
                        print(f"{log.name}: {stall} was laid to {late}", file=sys.stderr)
            print(f"{log.name}: {len(worst)} stalls, {said.get('failure_reason') or 'well ended'}", file=sys.stderr)
    for kind, names in counts.items():
        print(f"{kind:<12} {EXPECTED[kind]:<6} {', '.join(f'{n} x {name}' for name, n in names.most_common())}")
    print(
        f"{right} of {done} right, {wrong_side} on the wrong side; "
        f"{outside} of {cycles} cycles late without a stall of ours"
    )
    return int(right < 0.99 * done or wrong_side > 0 or done < options.stalls)


if __name__ == "__main__":
    sys.exit(main())
