"""What twenty viewers cost the loop: its missed deadlines with them and without them, by turns in one run.

    python tests/bench/viewers.py [--minutes 10] [--viewers 20] [--turn 30] [--json FILE]

Starts `rtstack up` with the simulated cell. One operator moves both arms by hand all the time. Every other turn as many
viewers look on: each has the live stream and the light scene, with a camera, and reads all it is sent. They are one
process of low priority, since real ones are on machines of their own. Minutes are of each kind. The simulated cell
waits for its loop and counts no missed deadline, so a period over 2 ms is one: a robot would not wait. Exit status 1
where there are more with viewers than without, beyond chance (one-sided binomial test, 5 %), or where the viewers were
shown too little for this to mean anything. Nothing else should compute meanwhile. Ctrl-C gives what
there is so far.
"""

import argparse
import asyncio
import json
import math
import os
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
from rich.progress import Progress
from scipy.stats import binomtest
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from console.tokens import Scope, Tokens
from rtstack.log.ring import RingReader, Rings
from rtstack.samples import Mode

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.bench.soak import LATE_US, SoakFailed, Stack, Viewer

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
    periods_us: list[float] = field(default_factory=list)
    views: int = 0
    scene_messages: int = 0

    def report(self) -> dict:
        """Return it JSON-ready."""
        million = max(1, self.ticks) / 1e6
        return {
            "seconds": round(self.seconds, 1), "ticks": self.ticks, "missed_deadlines": self.missed,
            "missed_per_million_ticks": round(self.missed / million, 1),
            "periods_over_2_ms_per_million_ticks": round(self.late / million, 1),
            "period_p99_us": round(float(np.percentile(self.periods_us, 99)), 1) if self.periods_us else None,
        }  # fmt: skip


class Hands:
    """The operator's hands: the clutch is held, and both go up and down."""

    def __init__(self, stack: Stack) -> None:
        self._address = stack.base.replace("http", "ws") + "/api/teleoperation/hand"
        self._headers = {"cookie": "; ".join(f"{name}={value}" for name, value in stack.client.cookies.items())}
        self._origin = stack.base
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._move, daemon=True)
        self._thread.start()
        self.error: str | None = None

    def _move(self) -> None:
        with connect(self._address, origin=self._origin, additional_headers=self._headers, proxy=None) as socket:
            while not self._over.wait(BEAT_S):
                up = 0.3 * math.sin(2.0 * math.pi * time.monotonic() / SWAY_S)
                way = [0.0, 0.0, up, 0.0, 0.0, 0.0]
                try:
                    socket.send(json.dumps({"clutch": True, "deflection": {"left": way, "right": way}}))
                    self.error = json.loads(socket.recv(timeout=10.0))["error"]
                except (ConnectionClosed, TimeoutError) as error:
                    self.error = str(error)
                    return

    def close(self) -> None:
        """Let go."""
        self._over.set()
        self._thread.join()


async def look(base: str, token: str, count: int) -> None:
    """Be the viewers until SIGTERM; then print how much they were shown."""
    os.nice(10)
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
    print(json.dumps({"views": shown["/live"], "scene_messages": shown["/viser/light"], "lost": lost}))


def measure(reader: RingReader, seconds: float, turns: Turns) -> None:
    """Add the loop's next seconds to what is known of such turns."""
    reader.drain()
    counted: int | None = None
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        time.sleep(0.1)
        records = reader.drain()
        if not len(records):
            continue
        counts = records["missed_deadlines"]
        steps = np.diff(counts, prepend=counts[0] if counted is None else counted)
        turns.missed += int(np.where(steps >= 0, steps, counts).sum())  # each job counts from zero again
        counted = int(counts[-1])
        periods = records["period_us"][np.isfinite(records["period_us"])]
        turns.ticks += len(records)
        turns.late += int((periods > LATE_US).sum())
        turns.periods_us += periods.tolist()
    turns.seconds += seconds


def watched(stack: Stack, token: str, count: int, reader: RingReader, seconds: float, turns: Turns) -> None:
    """Measure while viewers look on. Raises SoakFailed where they lost sight of it."""
    command = [sys.executable, __file__, "--look", stack.base, token, "--viewers", str(count)]
    viewers = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        time.sleep(SETTLE_S)
        measure(reader, seconds, turns)
    finally:
        viewers.terminate()
        said, _ = viewers.communicate(timeout=30.0)
    shown = json.loads(said or '{"views": 0, "scene_messages": 0, "lost": -1}')
    if shown["lost"]:
        raise SoakFailed(f"{shown['lost']} of the viewers' sockets were closed")
    turns.views += shown["views"]
    turns.scene_messages += shown["scene_messages"]


def operate(stack: Stack, rings: Rings) -> Hands:
    """Take control, arm, and begin to move both arms by hand."""
    stack.post("take", operator="bench")
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
    parser.add_argument("--look", nargs=2, metavar=("BASE", "TOKEN"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.look:
        asyncio.run(look(*options.look, options.viewers))
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    kinds = {"without": Turns(), "with": Turns()}
    trouble: list[str] = []
    with TemporaryDirectory() as folder:
        stack = Stack(Path(folder) / "logs")
        page = hands = None
        try:
            words = stack.members["console"].cmdline()
            rings = Rings.attach(words[words.index("--rings") + 1])
            reader = rings.reader("/timing")
            _, token = Tokens(stack.logs).create("viewers", Scope.VIEW)
            page = Viewer(stack, answers=True)
            hands = operate(stack, rings)
            rounds = max(1, round(60.0 * options.minutes / options.turn))
            with Progress(transient=True) as progress:
                for _ in progress.track(range(rounds), description="turns"):
                    time.sleep(SETTLE_S)
                    measure(reader, options.turn, kinds["without"])
                    watched(stack, token, options.viewers, reader, options.turn, kinds["with"])
                    if hands.error:
                        raise SoakFailed(f"the operator's hand was refused: {hands.error}")
        except KeyboardInterrupt:
            print("ended early: what there is so far", file=sys.stderr)
        except SoakFailed as error:
            trouble.append(str(error))
        finally:
            for part in (hands, page):
                if part is not None:
                    part.close()
            trouble += stack.end()
    report = judged(kinds["without"], kinds["with"], options.viewers, trouble)
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if report["trouble"] else 0


def judged(without: Turns, looked_at: Turns, viewers: int, trouble: list[str]) -> dict:
    """Return both kinds side by side, and what is wrong with them."""
    total, ticks = without.late + looked_at.late, without.ticks + looked_at.ticks
    chance = 1.0
    if total:
        chance = binomtest(looked_at.late, total, looked_at.ticks / ticks, alternative="greater").pvalue
    if chance < CHANCE:
        trouble = [*trouble, "deadlines are missed more often with viewers than without"]
    per_second = max(1e-9, looked_at.seconds * viewers)
    views_hz = looked_at.views / per_second
    if views_hz < LEAST_VIEWS_HZ:
        trouble = [*trouble, f"each viewer was shown {views_hz:.1f} views a second, not {LEAST_VIEWS_HZ:g} or more"]
    return {
        "viewers": viewers, "without": without.report(), "with": looked_at.report(),
        "p_value_of_more_misses": round(chance, 4), "views_per_viewer_per_s": round(views_hz, 1),
        "scene_messages_per_viewer_per_s": round(looked_at.scene_messages / per_second, 1), "trouble": trouble,
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
