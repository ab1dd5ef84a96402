"""Dead-man: how long after its cause the arms are given the first torque of a stop, for every way to let go.

Starts `rtstack up` with the simulated cell, and a real Chromium in which an operator holds the clutch by a key and jogs
the left arm by another. Then: the key is released, STOP is pressed by the space bar and by its button, the tab is
hidden by another tab, the tab is closed, the browser is frozen (SIGSTOP to all of its processes), its page is (to the
renderers), the console is killed (-9). Counted is from the host's monotonic time just before the cause is sent to the
moment at which another process has seen, in the live rings, both arms in a tick that stops: both ends make it longer.
The cause comes at any moment between two signs of life. Exit status 1 where the longest is above
350 ms, or where something else has stopped the arms. Nothing else should compute meanwhile. Ctrl-C gives what there is
so far.

Takes a quarter of an hour, on a quiet machine.
"""

import json
import os
import random
import re
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import httpx
import psutil
import typer
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import Page, Playwright, sync_playwright
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from rtstack.loop.end import End
from tests.programs import choose, program
from tests.support.console.operator_scene import CLUTCH, TOO_EARLY, Chromium, OperatorScene, SceneFailed, wait
from tests.support.console.stack import SoakFailed

ALLOWED_MS = 350.0
BETWEEN_S = 0.1  # two signs of life, generously: the cause comes at any moment of it
TRIES = 3  # of a repetition whose moment was not reached


@dataclass(frozen=True, slots=True)
class Cause:
    """A way to let go. ready: gives what brings it about, with nothing else left to do.

    says: the reason in the events; spends: whether the stack ends with it.
    """

    name: str
    ready: Callable[[OperatorScene], Callable[[], object]]
    says: str
    spends: bool = False


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
    """The causes one after another, with a stack and a browser for as long as they live."""

    def __init__(self, playwright: Playwright, folder: Path, found: dict[str, Found], drawn: bool) -> None:
        self._playwright, self._folder, self._found, self._drawn = playwright, folder, found, drawn
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
            if cause.spends:
                self.end(by_itself=True)
            return
        self.trouble.append(f"{cause.name}: not measured: {found.missed[-1]}")

    def _now(self) -> OperatorScene:
        if self._scene is None:
            self._stacks += 1
            self._browser = Chromium(self._playwright)
            self._scene = OperatorScene(self._browser, self._folder / str(self._stacks), self._drawn)
        return self._scene

    def end(self, by_itself: bool = False) -> None:
        """End the stack that runs, and its browser; by_itself: it has, and says so by its exit status."""
        scene, self._scene = self._scene, None
        if scene is not None:
            self.trouble += [what for what in scene.close() if not (by_itself and what == "exit status 1")]
        browser, self._browser = self._browser, None
        if browser is not None:
            browser.close()


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


def main(
    repetitions: Annotated[int, typer.Option(help="of each cause")] = 10,
    cause: Annotated[list[str] | None, typer.Option(help="only this one")] = None,
    bare: Annotated[bool, typer.Option("--bare", help="without the 3D scene, as without a graphics card")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="write the report here, too")] = None,
) -> int:
    """Measure, print a table and one JSON object."""
    names = choose(cause, [cause.name for cause in CAUSES])
    chosen = [cause for cause in CAUSES if cause.name in names]
    found = {cause.name: Found() for cause in chosen}
    trouble: list[str] = []
    load = os.getloadavg()[0]
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        bench = Bench(playwright, Path(folder), found, drawn=not bare)
        try:
            with Progress(console=Console(stderr=True), transient=True) as progress:
                task = progress.add_task("dead-man", total=repetitions * len(chosen))
                for cause in chosen:
                    for _ in range(repetitions):
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
    if json_file is not None:
        json_file.write_text(json.dumps(report) + "\n")
    return 1 if trouble else 0


if __name__ == "__main__":
    program(main)
