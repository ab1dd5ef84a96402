"""What twenty viewers cost the loop: its missed deadlines with them, without them, and beside a stand-in, by turns.

    python -m tests.programs.viewers [--minutes 10] [--viewers 20] [--turn 30] [--json FILE] [--logs DIR]
        [--left ADDRESS --right ADDRESS]

Starts `rtstack up` with the simulated cell. One operator moves both arms by hand all the time. Every third turn as many
viewers look on: each has the live stream and the light scene, with a camera, and reads all it is sent. They are one
process of low priority. Real viewers are on machines of their own, and this process takes computing time here; so in
another third of the turns a stand-in takes as much (a process of the same priority that computes as long, as often),
and has nothing to do with us. Minutes are of each kind.

The simulated cell of `rtstack up` waits for the loop and counts no missed deadline: there a period over 2 ms is one.
With --left and --right it is arms that are served (`rtstack sim`), and do not wait. The report says how the loop's
thread was scheduled in each kind's turns, what the console and the others used of a core, and what the host took. A
turn in which the operator loses the arms (a clutch that goes quiet for 0.3 s ends it) counts to there, and the
teleoperation is begun again. Exit status 1 where periods over 2 ms are more frequent with viewers than without them, or
than beside the stand-in, beyond chance (one-sided Mann-Whitney test over turns, 5 %: late ticks come in bursts), where
the operator lost the arms more often with viewers, or where the viewers were shown too little for this to mean
anything. Nothing else should compute meanwhile. Ctrl-C gives what there is so far. --logs keeps the teleoperation's
log: a long one, as the loop writes it.
"""

import argparse
import asyncio
import json
import math
import os
import select
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import psutil
from rich.progress import Progress
from scipy.stats import mannwhitneyu
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from console.tokens import Scope, Tokens
from hal.realtime import scheduling
from rtstack.live.standalone import find_rings
from rtstack.log.ring import RingReader, Rings
from rtstack.safety.arming import Phase
from rtstack.samples import Mode
from rtstack.teleoperation.stamp import Sender
from tests.programs.soak import LATE_US
from tests.support.console.stack import SoakFailed, Stack, Viewer

COMMAND = [sys.executable, "-m", "tests.programs.viewers"]
STAND_IN_S = 0.05  # between its bouts: views come that often
SETTLE_S = 3.0  # after viewers came or went
LEAST_VIEWS_HZ = 10.0  # of the 20 that are sent to each viewer
CHANCE = 0.05
BEAT_S = 0.05
LONGEST_START_S = 240.0  # of a teleoperation: the tick may have to be compiled first
SWAY_S = 6.0  # of the operator's hands, up and down
CAMERA = msgspec.msgpack.encode(
    {
        "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [1.5, 0.0, 1.0], "fov": 0.8,
        "near": 0.01, "far": 100.0, "image_height": 900, "image_width": 1440, "look_at": [0.0, 0.0, 0.3],
        "up_direction": [0.0, 0.0, 1.0],
    }
)  # fmt: skip


@dataclass(slots=True)
class Turns:
    """What the loop did in all turns of one kind."""

    seconds: float = 0.0
    ticks: int = 0
    missed: int = 0
    late: int = 0
    late_shares: list[float] = field(default_factory=list)  # of each turn's ticks
    schedulers: set[str] = field(default_factory=set)
    periods_us: list[float] = field(default_factory=list)
    console_cpu_s: float = 0.0
    others_cpu_s: float = 0.0
    stolen_s: float = 0.0
    operator_lost: int = 0
    looked_s: float = 0.0
    views: int = 0
    scene_messages: int = 0

    def report(self) -> dict:
        """Return it JSON-ready."""
        million = max(1, self.ticks) / 1e6
        return {
            "seconds": round(self.seconds, 1), "loop_scheduler": ", ".join(sorted(self.schedulers)),
            "ticks": self.ticks, "missed_deadlines": self.missed,
            "missed_per_million_ticks": round(self.missed / million, 1),
            "periods_over_2_ms_per_million_ticks": round(self.late / million, 1),
            "periods_over_2_ms_per_million_ticks_by_turn": [round(1e6 * share, 1) for share in self.late_shares],
            "period_p99_us": round(float(np.percentile(self.periods_us, 99)), 1) if self.periods_us else None,
            "console_share_of_a_core": round(self.console_cpu_s / max(1e-9, self.seconds), 3),
            "viewers_or_stand_in_share_of_a_core": round(self.others_cpu_s / max(1e-9, self.seconds), 3),
            "stolen_by_the_host_share_of_all_cores": round(
                self.stolen_s / max(1e-9, self.seconds * (psutil.cpu_count() or 1)), 4
            ),
            "operator_lost_the_arms": self.operator_lost,
        }  # fmt: skip


class Hands:
    """The operator's hands: the clutch is held, and both go up and down."""

    def __init__(self, stack: Stack) -> None:
        self._address = stack.base.replace("http", "ws") + "/api/teleoperation/hand"
        self._headers = {"cookie": "; ".join(f"{name}={value}" for name, value in stack.client.cookies.items())}
        self._origin = stack.base
        self._over = threading.Event()
        self.error: str | None = None
        self._thread = threading.Thread(target=self._move, daemon=True)
        self._thread.start()

    def _move(self) -> None:
        sender = Sender()
        with connect(self._address, origin=self._origin, additional_headers=self._headers, proxy=None) as socket:
            while not self._over.wait(BEAT_S):
                up = 0.3 * math.sin(2.0 * math.pi * time.monotonic() / SWAY_S)
                way = [0.0, 0.0, up, 0.0, 0.0, 0.0]
                try:
                    message = {"clutch": True, "deflection": {"left": way, "right": way}}
                    socket.send(json.dumps(sender.stamped(message)))
                    self.error = sender.saw(json.loads(socket.recv(timeout=10.0)))["error"]
                except (ConnectionClosed, TimeoutError) as error:
                    self.error = str(error)
                    return

    def close(self) -> None:
        """Let go."""
        self._over.set()
        self._thread.join()


async def look(base: str, token: str, count: int) -> None:
    """Be the viewers until SIGTERM: print a line once all of them look, and at the end how much they were shown."""
    os.nice(10)
    looking: list[str] = []
    began_s: list[float] = []
    shown = {"/live": 0, "/viser/light": 0}
    headers = {"authorization": f"Bearer {token}"}

    async def page(path: str) -> None:
        protocols = [f"viser-v{version('viser')}"] if path.startswith("/viser") else None
        address = base.replace("http", "ws") + path
        async with connect_async(
            address, additional_headers=headers, subprotocols=protocols, max_size=None, proxy=None, compression=None
        ) as socket:
            if protocols:
                await socket.send(CAMERA)
            looking.append(path)
            if len(looking) == 2 * count:
                shown.update(dict.fromkeys(shown, 0))
                began_s.append(time.monotonic())
                print("all of them look", flush=True)
            async for _ in socket:
                shown[path] += 1

    over = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, over.set)
    pages = [asyncio.create_task(page(path)) for path in shown for _ in range(count)]
    await over.wait()
    lost = sum(task.done() for task in pages)
    for task in pages:
        task.cancel()
    await asyncio.wait(pages)
    seconds = time.monotonic() - began_s[0] if began_s else 0.0
    said = {"seconds": seconds, "views": shown["/live"], "scene_messages": shown["/viser/light"], "lost": lost}
    print(json.dumps(said))


def stand_in(share: float) -> None:
    """Take this share of a core in bouts until SIGTERM, as the viewers' process does, and nothing else."""
    os.nice(10)
    over = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: over.set())
    began_s, used_s = time.monotonic(), time.process_time()
    while not over.wait(STAND_IN_S):
        while time.process_time() - used_s < share * (time.monotonic() - began_s):
            pass


def measure(
    reader: RingReader, stack: Stack, hands: Hands, seconds: float, turns: Turns, others: psutil.Process | None = None
) -> None:
    """Add the loop's next seconds, the console's and the others', to what is known of such turns.

    Not what it does once the operator has lost the arms: it is idle then, and an ordinary thread.
    """
    console, loop = stack.members["console"], stack.members["rtstack.live.robot"].pid
    ticks, late = turns.ticks, turns.late
    reader.drain()
    began_s, used_s, stolen_s = time.monotonic(), _cpu_s(console), psutil.cpu_times().steal
    others_s = 0.0 if others is None else _cpu_s(others)
    counted: int | None = None
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and not hands.error:
        time.sleep(0.1)
        records = reader.drain()
        if not len(records):
            continue
        counts = records["missed_deadlines"]
        steps = np.diff(counts, prepend=counts[0] if counted is None else counted)
        if not hands.error:
            turns.schedulers.add(scheduling(loop)[0])
        turns.missed += int(np.where(steps >= 0, steps, counts).sum())  # each job counts from zero again
        counted = int(counts[-1])
        periods = records["period_us"][np.isfinite(records["period_us"])]
        turns.ticks += len(records)
        turns.late += int((periods > LATE_US).sum())
        turns.periods_us += periods.tolist()
    if turns.ticks > ticks:
        turns.late_shares.append((turns.late - late) / (turns.ticks - ticks))
    turns.seconds += time.monotonic() - began_s
    turns.console_cpu_s += _cpu_s(console) - used_s
    turns.others_cpu_s += 0.0 if others is None else _cpu_s(others) - others_s
    turns.stolen_s += psutil.cpu_times().steal - stolen_s


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


def beside(stack: Stack, hands: Hands, share: float, reader: RingReader, seconds: float, turns: Turns) -> None:
    """Measure beside the stand-in."""
    other = subprocess.Popen([*COMMAND, "--stand-in", str(share)])
    try:
        time.sleep(SETTLE_S)
        measure(reader, stack, hands, seconds, turns, psutil.Process(other.pid))
    finally:
        other.terminate()
        other.wait(timeout=30.0)


def watched(
    stack: Stack, hands: Hands, token: str, count: int, reader: RingReader, seconds: float, turns: Turns
) -> None:
    """Measure while viewers look on. Raises SoakFailed where they lost sight of it."""
    command = [*COMMAND, "--look", stack.base, token, "--viewers", str(count)]
    viewers = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        if not select.select([viewers.stdout], [], [], LONGEST_START_S)[0]:
            raise SoakFailed("not all viewers can look on")
        time.sleep(SETTLE_S)
        measure(reader, stack, hands, seconds, turns, psutil.Process(viewers.pid))
    finally:
        viewers.terminate()
        said, _ = viewers.communicate(timeout=30.0)
    shown = json.loads((said.splitlines() or ['{"seconds": 0, "views": 0, "scene_messages": 0, "lost": -1}'])[-1])
    if shown["lost"]:
        raise SoakFailed(f"{shown['lost']} of the viewers' sockets were closed")
    turns.looked_s += shown["seconds"]
    turns.views += shown["views"]
    turns.scene_messages += shown["scene_messages"]


def operate(stack: Stack, rings: Rings) -> Hands:
    """Take control, arm, and begin to move both arms by hand; after the loss of a clutch or of torque control, too."""
    stack.post("take", operator="bench")
    if stack.client.get("/api/status").raise_for_status().json()["phase"] == Phase.FAULT:
        stack.post("recover")
    stack.post("arm")
    stack.post("jobs/teleoperation", object="rice_box", stop_on_release=False)
    deadline_s = time.monotonic() + LONGEST_START_S
    told = rings.reader("/right/control")
    while (record := told.latest()) is None or record["mode"][0] != Mode.TELEOPERATION:
        if time.monotonic() > deadline_s:
            raise SoakFailed("the teleoperation does not begin")
        time.sleep(0.1)
    return Hands(stack)


def main() -> int:
    """Measure by turns, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="of each kind")
    parser.add_argument("--viewers", type=int, default=20)
    parser.add_argument("--turn", type=float, default=30.0, help="length of a turn, s")
    parser.add_argument("--json", type=Path, help="write the report here, too")
    parser.add_argument("--left", help="address of the left arm")
    parser.add_argument("--right", help="address of the right arm")
    parser.add_argument("--logs", type=Path, help="keep the logs here, a gigabyte in ten minutes")
    parser.add_argument("--stand-in", type=float, metavar="SHARE", help=argparse.SUPPRESS)
    parser.add_argument("--look", nargs=2, metavar=("BASE", "TOKEN"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.look:
        asyncio.run(look(*options.look, options.viewers))
        return 0
    if options.stand_in is not None:
        stand_in(options.stand_in)
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    kinds = {"with": Turns(), "stand-in": Turns(), "without": Turns()}
    trouble: list[str] = []
    with TemporaryDirectory() as folder:
        arms = ("--left", options.left, "--right", options.right) if options.left else ()
        stack = Stack(options.logs or Path(folder) / "logs", arms)
        page = hands = None
        try:
            words = stack.members["console"].cmdline()
            rings = Rings.attach(find_rings(Path(words[words.index("--run") + 1])))
            reader = rings.reader("/timing")
            _, token = Tokens(stack.logs).create("viewers", Scope.VIEW)
            page = Viewer(stack, answers=True)
            hands = operate(stack, rings)
            rounds = max(1, round(60.0 * options.minutes / options.turn))
            with Progress(transient=True) as progress:
                for turn in progress.track(range(3 * rounds), description="turns"):
                    name = list(kinds)[turn % 3]
                    kind = kinds[name]
                    time.sleep(SETTLE_S)
                    if name == "with":
                        watched(stack, hands, token, options.viewers, reader, options.turn, kind)
                    elif name == "stand-in":
                        share = kinds["with"].others_cpu_s / max(1.0, kinds["with"].seconds)
                        beside(stack, hands, share, reader, options.turn, kind)
                    else:
                        measure(reader, stack, hands, options.turn, kind)
                    if hands.error:
                        print(f"the operator lost the arms: {hands.error}", file=sys.stderr)
                        kind.operator_lost += 1
                        hands.close()
                        hands = operate(stack, rings)
        except KeyboardInterrupt:
            print("ended early: what there is so far", file=sys.stderr)
        except SoakFailed as error:
            trouble.append(str(error))
        finally:
            for part in (hands, page):
                if part is not None:
                    part.close()
            trouble += stack.end()
    report = judged(kinds, options.viewers, trouble)
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if report["trouble"] else 0


def judged(kinds: dict[str, Turns], viewers: int, trouble: list[str]) -> dict:
    """Return the kinds side by side, and what is wrong with them."""
    looked_at, other = kinds["with"], kinds["stand-in"]
    chances: dict[str, float] = {}
    for name in ("without", "stand-in"):
        shares = looked_at.late_shares, kinds[name].late_shares
        chances[name] = float(mannwhitneyu(*shares, alternative="greater").pvalue) if all(shares) else 1.0
        if chances[name] < CHANCE:
            trouble = [*trouble, f"deadlines are missed more often with viewers than in the turns {name!r}"]
    if looked_at.operator_lost > other.operator_lost:
        trouble = [*trouble, "the operator lost the arms more often with viewers than beside the stand-in"]
    per_second = max(1e-9, looked_at.looked_s * viewers)
    views_hz = looked_at.views / per_second
    if views_hz < LEAST_VIEWS_HZ:
        trouble = [*trouble, f"each viewer was shown {views_hz:.1f} views a second, not {LEAST_VIEWS_HZ:g} or more"]
    return {
        "viewers": viewers, **{name: turns.report() for name, turns in kinds.items()},
        "p_value_of_more_misses_than": {name: round(chance, 4) for name, chance in chances.items()},
        "views_per_viewer_per_s": round(views_hz, 1),
        "scene_messages_per_viewer_per_s": round(looked_at.scene_messages / per_second, 1), "trouble": trouble,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
