"""STOP, pressed with any focus and dialog, on any page, at any width and moment: how soon it has the arms.

    python -m tests.programs.stop_anywhere [--repetitions 1] [--moment NAME] [--bare] [--json FILE]

Starts `rtstack up` with the simulated cell, a program that orders the motions and gives signs of life, and a real
Chromium, in which STOP is pressed in the combinations of tests/browser/test_stop_anywhere.py. Counted is from the
host's monotonic time just before the press is sent: to STOP's word in shared memory, which each tick reads and after
which nothing is armed; where arms are driven, to the first stopping torque of both; and to the last state in which a
joint moved. Another process sees each of them, so that it is never too early. Left out are a fault, which has stopped
the arms already, and the moment in which a person moves them, and they have no torque of ours. Exit status 1 where
STOP's word or the stopping torque took longer than dead_man allows. Nothing else should compute meanwhile.
"""

import argparse
import json
import os
import random
import signal
import sys
import threading
import time
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import httpx
import numpy as np
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import expect, sync_playwright
from rich.console import Console
from rich.progress import track
from rich.table import Table

from rtstack.loop.standstill import REST_DQ
from rtstack.samples import SIDES
from tests.programs.dead_man import ALLOWED_MS, BETWEEN_S, TRIES, click_on
from tests.support.console.operator_scene import PATIENCE_S, Chromium, OperatorScene, SceneFailed, wait
from tests.support.console.stack import SoakFailed, Viewer
from tests.support.console.stop_ways import WAYS, Way, come_to, lead_focus

DRIVEN = ("moving", "holding")  # moments in which the arms have a torque of ours
REST_S = 0.5  # without motion: they stand
MOMENTS = ("moving", "preparing", "holding", "armed")


@dataclass(frozen=True, slots=True)
class Stop:
    """How long each took, ms. braked: None where no arm was driven; still: None where none moved after the press."""

    asked: float
    braked: float | None
    still: float | None


class Motion(threading.Thread):
    """Sees, every millisecond, STOP's word and whether a joint moves: host's monotonic time, ns, 0 for never."""

    def __init__(self, scene: OperatorScene) -> None:
        super().__init__(daemon=True, name="motion")
        self._mailbox = scene.mailbox
        self._arms = [scene.rings.reader(f"/{side}/arm") for side in SIDES]
        self._over = threading.Event()
        self.asked_ns = self.moved_ns = 0
        self.start()

    def run(self) -> None:
        """Look until it is over."""
        while not self._over.wait(0.001):
            states = [arm.drain() for arm in self._arms]
            if any(len(state) and np.abs(state["dq"]).max() > REST_DQ for state in states):
                self.moved_ns = time.monotonic_ns()
            if self.asked_ns == 0 and self._mailbox.stop_requested:
                self.asked_ns = time.monotonic_ns()

    @property
    def moves(self) -> bool:
        """Whether a joint has moved lately."""
        return time.monotonic_ns() - self.moved_ns < 1e9 * REST_S

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        self.join()


class Cell:
    """The stack, the program that orders its motions, and the browser's page."""

    def __init__(self, browser: Chromium, logs: Path, drawn: bool) -> None:
        self.scene = OperatorScene(browser, logs, drawn)
        self.motion = Motion(self.scene)
        self._program = Viewer(self.scene.stack, answers=True)
        self.scene.take_control()
        name = self.scene.stack.run("jobs/demonstration", object="rice_box")
        self._ids = {"log": self.scene.stack.log_id(name)}

    def stop(self, way: Way, pause_s: float) -> Stop:
        """Bring a combination about and press STOP in it. Raises SceneFailed where it does not come about."""
        scene, motion, page = self.scene, self.motion, self.scene.page
        come_to(page, way, scene.stack.base, self._ids)
        lead_focus(page, way)
        self._begin(way.moment)
        expect(page.locator("#control-light")).to_have_attribute("data-state", way.moment, timeout=1e3 * PATIENCE_S)
        press = click_on(page, "#stop") if way.how == "button" else partial(page.keyboard.press, way.how)
        time.sleep(0.0 if way.moment == "preparing" else pause_s)  # that is over soon
        if scene.mailbox.stop_requested:
            raise SceneFailed("there was a STOP already")
        motion.asked_ns = 0
        began_ns = time.monotonic_ns()
        press()
        wait(lambda: motion.asked_ns, "STOP has not arrived")
        if way.moment in DRIVEN:
            wait(lambda: scene.witness.stopped, "the arms were not stopped")
        wait(lambda: not scene.active and not motion.moves, "the arms do not come to rest")
        braked_ns = scene.witness.seen_ns()[1] if way.moment in DRIVEN else None
        after = [motion.asked_ns, braked_ns, motion.moved_ns if motion.moved_ns > began_ns else None]
        asked, braked, still = (None if t_ns is None else round((t_ns - began_ns) * 1e-6, 1) for t_ns in after)
        assert asked is not None
        return Stop(asked, braked, still)

    def _begin(self, moment: str) -> None:
        """Have the program arm, and order what leads to a moment."""
        self.scene.take_control()
        self.scene.witness.begin()
        if moment in ("moving", "preparing"):
            self.scene.stack.post("jobs/demonstration", object="rice_box")
        elif moment == "holding":  # no clutch is held: the loop holds both arms where they are
            self.scene.stack.post("jobs/teleoperation", object="rice_box", stop_on_release=False)

    def close(self) -> list[str]:
        """End it; return what was left behind."""
        self._program.close()
        self.motion.close()
        return self.scene.close()


def show(found: dict[Way, list[Stop]]) -> None:
    """Print a line for each combination, and one for each moment."""
    table = Table("page", "focus", "dialog", "width", "moment", "by", "STOP, ms", "torque, ms", "last motion, ms")
    for way, stops in found.items():
        worst = [max((ms for ms in column if ms is not None), default=None) for column in columns(stops)]
        table.add_row(way.page, way.focus, way.dialog, str(way.width), way.moment, way.how,
                      *("" if ms is None else f"{ms:.0f}" for ms in worst))  # fmt: skip
    Console(stderr=True, width=150).print(table)


def columns(stops: list[Stop]) -> list[tuple[float | None, ...]]:
    """Return what was measured by what it is: asked, braked, still."""
    return list(zip(*((stop.asked, stop.braked, stop.still) for stop in stops), strict=True)) or [(), (), ()]


def by_moment(found: dict[Way, list[Stop]]) -> dict[str, dict]:
    """Return, of each moment, how many combinations there are, and median and worst of what was measured, ms."""
    summary = {}
    for moment in MOMENTS:
        stops = [stop for way, of in found.items() if way.moment == moment for stop in of]
        told: dict[str, object] = {"combinations": sum(way.moment == moment for way in found), "stops": len(stops)}
        for name, column in zip(("asked", "braked", "still"), columns(stops), strict=True):
            known = [ms for ms in column if ms is not None]
            told[name] = [round(median(known), 1), max(known)] if known else None
        summary[moment] = told
    return summary


def main() -> int:
    """Measure, print a table and one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=1, help="of each combination")
    parser.add_argument("--moment", choices=MOMENTS, help="only this one")
    parser.add_argument("--bare", action="store_true", help="without the 3D scene, as for dead_man")
    parser.add_argument("--json", type=Path, help="write the report here, too")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    moments, trouble, load = random.Random(1), [], os.getloadavg()[0]
    found: dict[Way, list[Stop]] = {
        way: [] for way in WAYS if way.moment in MOMENTS and options.moment in (None, way.moment)
    }
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = Chromium(playwright)
        cell = Cell(browser, Path(folder) / "logs", drawn=not options.bare)
        try:
            again = [way for way in found for _ in range(options.repetitions)]
            for way in track(again, "STOP", console=Console(stderr=True), transient=True):
                for _ in range(TRIES):  # of a moment that was over before the press
                    try:
                        found[way].append(cell.stop(way, BETWEEN_S * moments.random()))
                        break
                    except (AssertionError, SoakFailed, BrowserError, httpx.HTTPError) as failed:
                        missed = f"{way}: {str(failed).splitlines()[0]}"
                        print(missed, file=sys.stderr)
                else:
                    trouble.append(missed)
        except KeyboardInterrupt:
            trouble.append("ended early: this is what there is so far")
        finally:
            trouble += cell.close()
            browser.close()
    for way, stops in found.items():
        for stop in stops:
            if max(stop.asked, stop.braked or 0.0) > ALLOWED_MS:
                trouble.append(f"{way}: {stop}")
    show(found)
    report = {
        "moments": by_moment(found), "ways": {str(way): [asdict(stop) for stop in of] for way, of in found.items()},
        "allowed_ms": ALLOWED_MS, "load": [round(load, 1), round(os.getloadavg()[0], 1)], "trouble": trouble,
    }  # fmt: skip
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if trouble else 0


if __name__ == "__main__":
    sys.exit(main())
