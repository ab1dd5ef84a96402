"""Stop times: from the cause of a stop to its first torque at both arms, for every way to stop arms served as metal.

Ways at the page of `rtstack up` (the operator holds the clutch and leads the left arm): STOP by its button and by the
space bar; the clutch's key, a phone's button and a gamepad's button let go; the browser frozen, as by a network that is
cut to the console. Ways at a terminal of `rtstack teach`: the space bar let go (from its last repetition), the terminal
closed. Ways of the network to the robots: one cable out, both out. Each is measured quietly and beside two busy loops,
those at the page also under attacks: forged states, idle connections, silent peers, bombs among the logs
(tests/support/console/attacks.py), with the memory of the robot process and of the console.

The end is the host's monotonic time at which the plant has taken the first torque of the stop, of the arm that is the
last one, at most 1 ms too late; where a robot ends the motion by itself, that. Keeps each stop in results.json: the
same command goes on. Exit status 1 where the longest is above 350 ms, or something else stopped the arms. Ctrl-C gives
what there is so far.

Takes three hours with --times 50.
"""

import contextlib
import json
import os
import random
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import httpx
import numpy as np
import typer
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import Page, sync_playwright
from rich.console import Console
from rich.table import Table

from rtstack.log.reader import read_log
from rtstack.loop.end import End
from rtstack.samples import Mode
from tests.programs import choose, program
from tests.programs.dead_man import ALLOWED_MS, BETWEEN_S, TRIES, click_on
from tests.support.console.attacks import BESIDE
from tests.support.console.operate_page import open_settings
from tests.support.console.operator_scene import CLUTCH, TOO_EARLY, Chromium, OperatorScene, SceneFailed, wait
from tests.support.console.stack import SoakFailed
from tests.support.metal.metal import Metal
from tests.support.metal.watched_robot import KEPT
from tests.support.terminal import REPEATED_S

ROOT = Path(__file__).resolve().parents[2]
SIDES = ("left", "right")
AT_ROBOTS = ("quiet", "busy")  # what can be beside a command, too: attacks are on a stack
FIRST_MS, SPREAD_MS = 400, 700  # of a demonstration's motion: on the way to the object


Act = Callable[[], object]
PAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  buttons[4] = { pressed: true, value: 1 }; // the clutch
  buttons[7] = { pressed: true, value: 0.8 }; // up
  window.pad = { id: "a pad", mapping: "standard", axes: [0, 0, 0, 0], buttons };
  navigator.getGamepads = () => [window.pad];
}"""
BUTTON_UP = "window.pad.buttons[4] = { pressed: false, value: 0 }"


def by_keys(act: Callable[[OperatorScene], Act]) -> Callable[[OperatorScene], Act]:
    """Return what takes hold by two keys, and gives what then stops the arms."""

    def begin(scene: OperatorScene) -> Act:
        scene.take_hold()
        return act(scene)

    return begin


def by_touch(scene: OperatorScene) -> Act:
    """Hold the clutch's button of a phone by a finger, and twist the phone; give what lifts the finger."""
    session = scene.page.context.new_cdp_session(scene.page)
    touch = partial(session.send, "Input.dispatchTouchEvent")
    turn = partial(session.send, "DeviceOrientation.setDeviceOrientationOverride")
    session.send("Emulation.setTouchEmulationEnabled", {"enabled": True})

    def hold(page: Page) -> None:
        open_settings(page)
        page.click("#phone")
        turn({"alpha": 0.0, "beta": 0.0, "gamma": 0.0})
        box = page.locator("#clutch").bounding_box()
        assert box is not None
        at = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
        touch({"type": "touchStart", "touchPoints": [at]})
        time.sleep(2 * BETWEEN_S)
        turn({"alpha": 20.0, "beta": 0.0, "gamma": 0.0})

    scene.take_hold(hold)
    return partial(touch, {"type": "touchEnd", "touchPoints": []})


def by_gamepad(scene: OperatorScene) -> Act:
    """Hold the clutch's button of a gamepad, and press its trigger; give what lets the button go."""
    scene.take_hold(lambda page: page.evaluate(PAD))
    return partial(scene.page.evaluate, BUTTON_UP)


@dataclass(frozen=True, slots=True)
class PageWay:
    """A way to stop at the page. begin: takes hold, and gives what brings the stop about; device: is of that page."""

    name: str
    begin: Callable[[OperatorScene], Act]
    says: str
    device: bool = False


@dataclass(frozen=True, slots=True)
class TerminalWay:
    """A way to stop a command at a terminal: its key is let go, or it is closed (hang_up); cut: arms whose cable is
    pulled meanwhile."""

    name: str
    says: str
    hang_up: bool = False
    cut: tuple[int, ...] = ()


STOPPED, LET_GO = str(End.STOP_REQUESTED), f"{End.RELEASED}: .*clutch was let go"
WAYS: tuple[PageWay | TerminalWay, ...] = (
    PageWay("STOP by button", by_keys(lambda scene: click_on(scene.page, "#stop")), STOPPED),
    PageWay("STOP by space bar", by_keys(lambda scene: partial(scene.page.keyboard.press, "Space")), STOPPED),
    PageWay("clutch's key let go", by_keys(lambda scene: partial(scene.page.keyboard.up, CLUTCH)), LET_GO),
    PageWay("phone's button let go", by_touch, LET_GO, device=True),
    PageWay("gamepad's button let go", by_gamepad, LET_GO, device=True),
    PageWay("network to the console cut", by_keys(lambda scene: scene.browser.freeze), str(End.CLUTCH_QUIET)),
    TerminalWay("space bar at the terminal let go", f"{End.RELEASED}|{STOPPED}"),
    TerminalWay("terminal closed", f"{STOPPED}|{End.RELEASED}", hang_up=True),
    TerminalWay("network to one robot cut", f"{End.HARDWARE}|{End.SAFETY}", cut=(1,)),
    TerminalWay("network to both robots cut", f"{End.HARDWARE}|{End.SAFETY}", cut=(0, 1)),
)


@dataclass(frozen=True, slots=True)
class Stop:
    """What a cause led to: after how long, ms, and what the loop said; memory of robot process and console, MB."""

    delay_ms: float
    reason: str
    memory_mb: tuple[int, ...] = ()


def delay_ms(metal: Metal, began_ns: int, first_t_ns: dict[int, int]) -> float:
    """Return how long after began_ns the last arm had its first torque of the stop, or left its motion by itself.

    first_t_ns: robot's time of the state that was answered by it, of each arm (0, 1) that had one.
    """
    seen = metal.seen
    ends = []
    for side in range(len(SIDES)):
        found = [int(seen["left_ns"][side])] if seen["left_ns"][side] >= began_ns else []
        if side in first_t_ns:
            # an answer that comes late counts a millisecond later: this is never too early
            found.append(int(seen["taken_ns"][side][(first_t_ns[side] // 1_000_000 + 1) % KEPT]))
        if not found:
            raise SceneFailed(f"the {SIDES[side]} arm was not stopped")
        ends.append(min(found))
    if min(ends) < began_ns:
        raise SceneFailed(TOO_EARLY)
    return (max(ends) - began_ns) * 1e-6


class Bench:
    """Stops the arms, in a stack and a browser or at terminals, for as long as they live."""

    def __init__(self, playwright, folder: Path, drawn: bool, beside: str) -> None:
        """beside: what goes on meanwhile, a name of BESIDE."""
        self._playwright, self._folder, self._drawn, self._beside = playwright, folder, drawn, BESIDE[beside]
        self._attack = contextlib.ExitStack()
        self._moments = random.Random(os.getpid())
        self._metal: Metal | None = None
        self._browser: Chromium | None = None
        self._scene: OperatorScene | None = None
        self._number = 0

    def stop_by(self, way: PageWay | TerminalWay) -> Stop:
        """Bring a stop about once. Raises SoakFailed, BrowserError, httpx.HTTPError where it did not come to that."""
        pages = isinstance(way, PageWay)
        if not pages:
            self.end()  # robots at home: the way to the start is not in the log
        try:
            if pages:
                return self._at_page(way)
            with self._beside(None):
                return self._at_terminal(way)
        except BaseException:
            self.end()
            raise

    def _metal_now(self) -> Metal:
        if self._metal is None:
            self._number += 1
            folder = self._folder / str(self._number)
            folder.mkdir()
            self._metal = metal = Metal(folder, lockstep=False)
            metal.write_file()
            metal.serve(["--object", "rice_box", "--seed", "3"])
        return self._metal

    def _at_page(self, way: PageWay) -> Stop:
        metal = self._metal_now()
        if self._scene is None:
            self._browser = Chromium(self._playwright)
            arms = ["--left", metal.left, "--right", metal.right, "--cell-file", str(metal.cell_file)]
            self._scene = OperatorScene(self._browser, metal.folder / "logs", self._drawn, arms)
            self._attack.enter_context(self._beside(self._scene.stack))
        scene, witness = self._scene, self._scene.witness
        act = way.begin(scene)
        try:
            time.sleep(BETWEEN_S * self._moments.random())
            began_ns = time.monotonic_ns()
            act()
            wait(lambda: witness.stopped, "the arms were not stopped")
            wait(lambda: witness.reason is not None, "nobody said why the arms were stopped")
            members = scene.stack.members
            memory = tuple(members[name].memory_info().rss >> 20 for name in ("rtstack.live.robot", "console"))
            stop = Stop(delay_ms(metal, began_ns, witness.first_t_ns()), (witness.reason or (0, ""))[1], memory)
        finally:
            scene.leave()
            if way.device:
                scene.page.close()
        return stop

    def _at_terminal(self, way: TerminalWay) -> Stop:
        metal = self._metal_now()
        seen, log = metal.seen, metal.folder / f"{time.monotonic_ns()}.mcap"
        seen["cut"] = 0
        due_ms = int(seen["moving_ticks"]) + FIRST_MS + round(SPREAD_MS * self._moments.random())
        began: list[int] = []

        def let_go(_said: str) -> bool:
            if began or seen["moving_ticks"] < due_ms:
                return bool(began) and not way.cut
            began.append(time.monotonic_ns())
            seen["cut"][list(way.cut)] = 1
            return not way.cut

        words = ["teach", str(log), "--cell", metal.kind, "--cell-file", str(metal.cell_file)]
        with metal.command(words, leads=way.hang_up) as running:
            status = running.carry_out(lambda: running.terminal.hold("grab", let_go, way.hang_up))
            said = running.terminal.said
        if not began or not log.exists():
            raise SceneFailed(f"the moment was not reached: {said.splitlines()[-1:]}, exit status {status}")
        # a key that is let go is not repeated: its last repetition was the repetition's time before
        began_ns = began[0] - (0 if way.cut or way.hang_up else round(1e9 * REPEATED_S))
        found = read_log(log)
        first = {}
        for number, side in enumerate(SIDES):
            control = found.topic(f"/{side}/control")
            stopping = control["t_ns"][control["mode"] == Mode.STOPPING]
            if len(stopping):
                first[number] = int(stopping[0])
        log.unlink()
        reason = found.metadata.get("result", {}).get("failure_reason", "")
        return Stop(delay_ms(metal, began_ns, first), reason)

    def end(self) -> None:
        """End what goes on beside, the stack, the browser and the robots."""
        self._attack.close()
        scene, self._scene = self._scene, None
        if scene is not None:
            with contextlib.suppress(BrowserError):
                scene.close()
        browser, self._browser = self._browser, None
        if browser is not None:
            browser.close()
        metal, self._metal = self._metal, None
        if metal is not None:
            metal.end()


def measure(
    bench: Bench, way: PageWay | TerminalWay, load: str, stops: dict[str, list[dict]], times: int, kept: Path
) -> list[str]:
    """Stop the arms until there are as many stops as wanted, keep them; return what was wrong."""
    measured, missed, trouble = stops.setdefault(f"{way.name} | {load}", []), 0, []
    while len(measured) < times and missed < TRIES:
        try:
            stop = bench.stop_by(way)
        except (SoakFailed, BrowserError, httpx.HTTPError) as failed:
            missed += 1
            print(f"{way.name}, {load}: not reached: {str(failed).splitlines()[0]}", flush=True)
            continue
        missed = 0
        measured.append({"delay_ms": round(stop.delay_ms, 2), "reason": stop.reason, "memory_mb": stop.memory_mb})
        kept.write_text(json.dumps(stops))
        print(f"{way.name}, {load}: {stop.delay_ms:.1f} ms: {stop.reason}", flush=True)
        if not re.match(way.says, stop.reason):
            trouble.append(f"{way.name}: the arms stopped because {stop.reason!r}")
    if len(measured) < times:
        trouble.append(f"{way.name}, {load}: only {len(measured)} of {times}")
    return trouble


def show(stops: dict[str, list[dict]]) -> list[dict]:
    """Print the table; return its rows."""
    rows = []
    table = Table("way", "beside", "stops", "p50 ms", "p95 ms", "worst ms", "MB of robot process, console")
    for load in BESIDE:
        for way in WAYS:
            found = stops.get(f"{way.name} | {load}", [])
            delays = [stop["delay_ms"] for stop in found]
            memory = [stop["memory_mb"] for stop in found if stop.get("memory_mb")]
            if delays:
                p50, p95 = np.percentile(delays, (50, 95))
                row = {"way": way.name, "load": load, "stops": len(delays)}
                row |= {
                    "p50_ms": round(float(p50), 1),
                    "p95_ms": round(float(p95), 1),
                    "worst_ms": round(max(delays), 1),
                }
                row |= {"memory_mb": [max(each) for each in zip(*memory, strict=True)]}
                rows.append(row)
                table.add_row(*map(str, rows[-1].values()))
    Console(stderr=True, width=120).print(table)
    return rows


def main(
    times: Annotated[int, typer.Option(help="of each way and load")] = 50,
    way: Annotated[list[str] | None, typer.Option(help="only this one")] = None,
    load: Annotated[list[str] | None, typer.Option(help=f"only this one: {', '.join(BESIDE)}")] = None,
    drawn: Annotated[bool, typer.Option("--drawn", help="with the 3D scene")] = False,
    out: Path = ROOT / "out" / "stop_times",
    fresh: Annotated[bool, typer.Option("--fresh", help="measure again what is kept")] = False,
) -> int:
    """Measure, print a table and one JSON object."""
    names, loads = choose(way, [each.name for each in WAYS]), choose(load, BESIDE)
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "results.json"
    stops: dict[str, list[dict]] = json.loads(kept.read_text()) if kept.exists() and not fresh else {}
    trouble: list[str] = []
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        try:
            for name in loads:
                (place := Path(folder) / name).mkdir()
                bench = Bench(playwright, place, drawn, name)
                try:
                    for each in WAYS:
                        if each.name in names and (isinstance(each, PageWay) or name in AT_ROBOTS):
                            trouble += measure(bench, each, name, stops, times, kept)
                finally:
                    bench.end()
        except KeyboardInterrupt:
            trouble.append("ended early: this is what there is so far")
    rows = show(stops)
    worst_ms = max((row["worst_ms"] for row in rows), default=0.0)
    if worst_ms > ALLOWED_MS:
        trouble.append(f"the longest took {worst_ms:g} ms, {ALLOWED_MS:g} ms are allowed")
    report = {"rows": rows, "allowed_ms": ALLOWED_MS, "load": os.getloadavg()[0], "trouble": trouble}
    print(json.dumps(report, indent=1))
    return 1 if trouble else 0


if __name__ == "__main__":
    program(main)
