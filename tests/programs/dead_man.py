"""Dead-man: how long after its cause the arms are given the first torque of a stop, for every way to let go.

    python -m tests.programs.dead_man [--headset] [--repetitions 10] [--cause NAME] [--bare] [--json FILE]

Starts `rtstack up` with the simulated cell, and a real Chromium in which an operator holds the clutch by a key and jogs
the left arm by another. Then: the key is released, STOP is pressed by the space bar and by its button, the tab is
hidden by another tab, the tab is closed, the browser is frozen (SIGSTOP to all of its processes), its page is (to the
renderers), the console is killed (-9). Counted is from the host's monotonic time just before the cause is sent to the
moment at which another process has seen, in the live rings, both arms in a tick that stops: both ends make it longer.
The cause comes at any moment between two signs of life. `--headset`: the operator wears the one that npm's `iwer`
emulates, holds both grips and moves the left hand; a controller or the headset is taken off, the tab is closed, the
network is gone (the loopback device of a network namespace, which all of them are in), the browser is killed (-9).
Exit status 1 where the longest is above 350 ms, or where
something else has stopped the arms. Nothing else should compute meanwhile. Ctrl-C gives what there is so far.
"""

import argparse
import json
import os
import random
import re
import signal
import statistics
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import httpx
import psutil
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import Page, Playwright, sync_playwright
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from rtstack.loop.end import End
from tests.support.console.headset import emulator
from tests.support.console.headset_scene import HeadsetScene
from tests.support.console.operator_scene import CLUTCH, TOO_EARLY, Chromium, OperatorScene, SceneFailed, wait
from tests.support.console.stack import SoakFailed
from tests.support.network.namespaces import Namespace, NotPermitted, permitted

ALLOWED_MS = 350.0
BETWEEN_S = 0.1  # two signs of life, generously: the cause comes at any moment of it
NOT_PERMITTED = 3  # exit status
TRIES = 3  # of a repetition whose moment was not reached


@dataclass(frozen=True, slots=True)
class Cause:
    """A way to let go. ready: gives what brings it about, with nothing else left to do.

    says: the reason in the events; spends: whether the stack ends with it; kills: whether the browser does.
    """

    name: str
    ready: Callable[[OperatorScene], Callable[[], object]]
    says: str
    spends: bool = False
    kills: bool = False


LOST = f"{End.RELEASED}: the page lost"
CAUSES = (
    Cause(
        "key released", lambda scene: partial(scene.page.keyboard.up, CLUTCH), f"{End.RELEASED}: .*clutch was let go"
    ),
    Cause("STOP by space bar", lambda scene: partial(scene.page.keyboard.press, "Space"), str(End.STOP_REQUESTED)),
    Cause("STOP by button", lambda scene: click_on(scene.page, "#stop"), str(End.STOP_REQUESTED)),
    Cause("tab hidden", lambda scene: scene.browser.blank.bring_to_front, LOST),
    Cause("tab closed", lambda scene: scene.page.close, LOST),
    Cause("browser frozen", lambda scene: scene.browser.freeze, str(End.CLUTCH_QUIET)),
    Cause("page frozen", lambda scene: partial(freeze, scene.browser.renderers()), str(End.CLUTCH_QUIET)),
    Cause("console killed", lambda scene: scene.console.kill, f"{End.CONSOLE_GONE}: its process has died", spends=True),
)
HEADSET_CAUSES = (
    Cause("controller off", lambda scene: in_page(scene, "xr.controllers.left.connected = false"), LOST),
    Cause("headset off", lambda scene: in_page(scene, "xr.updateVisibilityState('hidden')"), LOST),
    Cause("tab closed", lambda scene: scene.page.close, LOST),
    Cause("network gone", lambda scene: cast(HeadsetScene, scene).cut, str(End.CLUTCH_QUIET), kills=True),
    Cause("browser killed", lambda scene: scene.browser.kill, LOST, kills=True),
)


@dataclass(frozen=True, slots=True)
class Stop:
    """What a cause led to: after how long, ms; how many ticks after the loop said why, and what it said."""

    delay_ms: float
    ticks: int
    reason: str


@dataclass(slots=True)
class Found:
    """What was found of one cause. missed: moments that were not reached, and stops before anybody let go."""

    stops: list[Stop] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def report(self) -> dict:
        """Return it JSON-ready."""
        delays = [round(stop.delay_ms, 1) for stop in self.stops]
        return {
            "repetitions": len(delays), "median_ms": statistics.median(delays) if delays else None,
            "worst_ms": max(delays, default=None), "missed": self.missed, "delays_ms": delays,
            "reasons": sorted({stop.reason for stop in self.stops}),
        }  # fmt: skip


def click_on(page: Page, selector: str) -> Callable[[], object]:
    """Return what clicks into the middle of an element, without looking for it then."""
    box = page.locator(selector).bounding_box()
    assert box is not None
    return partial(page.mouse.click, box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def in_page(scene: OperatorScene, script: str) -> Callable[[], object]:
    """Return what carries a script out in the page."""
    return partial(scene.page.evaluate, script)


def freeze(processes: list[psutil.Process]) -> None:
    """Have processes stand still."""
    for process in processes:
        process.suspend()


def stop_by(cause: Cause, scene: OperatorScene, pause_s: float) -> Stop:
    """Bring a cause about while the arms follow. Raises SceneFailed where they stopped earlier, or not at all."""
    scene.take_hold()
    witness = scene.witness
    try:
        act = cause.ready(scene)
        time.sleep(pause_s)
        began_ns = time.monotonic_ns()
        act()
        wait(lambda: witness.stopped, "the arms were not stopped")
        first_ns, last_ns = witness.seen_ns()
        if first_ns < began_ns:
            raise SceneFailed(TOO_EARLY)
        wait(lambda: witness.reason is not None, "nobody said why the arms were stopped")
    finally:
        scene.leave()
    t_ns, reason = witness.reason or (0, "")
    return Stop((last_ns - began_ns) * 1e-6, round((witness.last_t_ns() - t_ns) * 1e-6), reason)


class Bench:
    """The causes one after another, with a stack and a browser for as long as they live.

    scene: makes one of a browser and a folder for its logs.
    """

    def __init__(
        self, playwright: Playwright, folder: Path, found: dict[str, Found],
        scene: Callable[[Chromium, Path], OperatorScene],
    ) -> None:  # fmt: skip
        self._playwright, self._folder, self._found, self._make = playwright, folder, found, scene
        self._moments = random.Random(1)
        self._scene: OperatorScene | None = None
        self._stacks = 0
        self._browser: Chromium | None = None
        self.trouble: list[str] = []

    def repeat(self, cause: Cause) -> None:
        """Bring a cause about once, again where its moment was not reached."""
        found = self._found[cause.name]
        for _ in range(TRIES):
            try:
                stop = stop_by(cause, self._now(), BETWEEN_S * self._moments.random())
            except (SoakFailed, BrowserError, httpx.HTTPError) as failed:
                found.missed.append(str(failed).splitlines()[0])
                self.end()
                continue
            found.stops.append(stop)
            if not re.match(cause.says, stop.reason):
                self.trouble.append(f"{cause.name}: the arms stopped because {stop.reason!r}")
            if cause.spends or cause.kills:
                self.end(by_itself=cause.spends)
            return
        self.trouble.append(f"{cause.name}: not measured: {found.missed[-1]}")

    def _now(self) -> OperatorScene:
        if self._scene is None:
            self._stacks += 1
            self._browser = Chromium(self._playwright)
            self._scene = self._make(self._browser, self._folder / str(self._stacks))
        return self._scene

    def end(self, by_itself: bool = False) -> None:
        """End the stack that runs, and its browser; by_itself: it has, and says so by its exit status."""
        scene, self._scene = self._scene, None
        if scene is not None:
            self.trouble += [what for what in scene.close() if not (by_itself and what == "exit status 1")]
        browser, self._browser = self._browser, None
        if browser is not None:
            browser.close()


def own_network(stack: ExitStack) -> Namespace:
    """Enter a network namespace, with all that is started from now on. Raises SystemExit where there are none."""
    try:
        permitted()
        network = Namespace()
    except NotPermitted as error:
        print(error, file=sys.stderr)
        raise SystemExit(NOT_PERMITTED) from None
    stack.callback(network.close)
    network.enter()
    return network


def show(found: dict[str, Found]) -> None:
    """Print the table."""
    table = Table("cause", "stops", "median ms", "worst ms", "ticks from reason", "not reached")
    for name, of in found.items():
        delays = [stop.delay_ms for stop in of.stops]
        ticks = [stop.ticks for stop in of.stops]
        figures = (
            [f"{statistics.median(delays):.0f}", f"{max(delays):.0f}", str(max(ticks))] if delays else ["", "", ""]
        )
        table.add_row(name, str(len(delays)), *figures, str(len(of.missed)))
    Console(stderr=True).print(table)


def main() -> int:
    """Measure, print a table and one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=10, help="of each cause")
    names = dict.fromkeys(cause.name for cause in CAUSES + HEADSET_CAUSES)
    parser.add_argument("--headset", action="store_true", help="with an emulated headset")
    parser.add_argument("--cause", action="append", choices=list(names), help="only this one")
    parser.add_argument(
        "--bare", action="store_true", help="the page without the 3D scene, for a machine without a graphics card"
    )
    parser.add_argument("--json", type=Path, help="write the report here, too")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    causes = HEADSET_CAUSES if options.headset else CAUSES
    chosen = [cause for cause in causes if not options.cause or cause.name in options.cause]
    found = {cause.name: Found() for cause in chosen}
    trouble: list[str] = []
    load = os.getloadavg()[0]
    with TemporaryDirectory() as folder, ExitStack() as stack:
        if options.headset:
            script, network = emulator(Path(folder)), own_network(stack)
            scene = partial(HeadsetScene, script=script, network=network)
        else:
            scene = partial(OperatorScene, drawn=not options.bare)
        bench = Bench(stack.enter_context(sync_playwright()), Path(folder), found, scene)
        try:
            with Progress(console=Console(stderr=True), transient=True) as progress:
                task = progress.add_task("dead-man", total=options.repetitions * len(chosen))
                for cause in chosen:
                    for _ in range(options.repetitions):
                        progress.update(task, description=cause.name)
                        bench.repeat(cause)
                        progress.advance(task)
        except KeyboardInterrupt:
            trouble.append("ended early: this is what there is so far")
        finally:
            bench.end()
    delays = [stop.delay_ms for of in found.values() for stop in of.stops]
    worst_ms = round(max(delays, default=0.0), 1)
    trouble += bench.trouble
    if worst_ms > ALLOWED_MS:
        trouble.append(f"the longest took {worst_ms:g} ms, {ALLOWED_MS:g} ms are allowed")
    show(found)
    report = {
        "causes": {name: of.report() for name, of in found.items()}, "worst_ms": worst_ms, "allowed_ms": ALLOWED_MS,
        "load": [round(load, 1), round(os.getloadavg()[0], 1)], "trouble": trouble,
    }  # fmt: skip
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if trouble else 0


if __name__ == "__main__":
    sys.exit(main())
