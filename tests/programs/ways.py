"""The ways that a new user goes most, in a real browser: how long each takes, and how many clicks and keys.

    python -m tests.programs.ways [--trials 15] [--width 1280] [--height 720] [--json FILE]

Starts `rtstack up` with the simulated cell and an empty folder of logs, opens the address that it prints in Chromium,
and presses what a person would who takes what the forms propose. Seconds are of the wall clock, from the first press to
what the way leads to, and contain what the arms and the machine take: a person adds the time to read and to point. A
key is each press, a clutch that is held counts once, as a drag does. Shift is the sum of all layout shifts that
Chromium reports on the way's pages, those while a page is loaded too. Exit status 1 where a way did not lead there.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import Page, expect, sync_playwright
from rich.console import Console
from rich.table import Table

from tests.support.console.chromium import ARGUMENTS, CHROMIUM
from tests.support.console.operator_hands import HOME, Operator

COMMAND = Path(sys.executable).with_name("rtstack")
PATIENCE_MS = 120_000  # the tick may have to be compiled first
JOG_S = 1.0
MOST_TABS = 200
RAISED_M, CLOSED_M, LIFTED_M = 0.05, 0.31, 0.15  # of both hands, from home, to grab the box by hand
# of the page itself, not of the scene's frame; https://wicg.github.io/layout-instability/
SHIFTS = """if (window === top) new PerformanceObserver((list) => {
  for (const shift of list.getEntries()) window.layoutShifted(shift.value);
}).observe({type: 'layout-shift', buffered: true});"""


@dataclass
class Way:
    """One way. seconds: None where it did not lead there, and `problem` says why."""

    name: str
    clicks: int = 0
    keys: int = 0
    shift: float = 0.0
    seconds: float | None = None
    problem: str = ""


class Hand:
    """Presses what a person does, and counts."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.way = Way("")
        page.expose_function("layoutShifted", self._shifted)
        page.add_init_script(SHIFTS)

    def _shifted(self, value: float) -> None:
        self.way.shift += value

    def click(self, selector: str) -> None:
        """Click once it can be clicked."""
        self.way.clicks += 1
        self.page.locator(selector).first.click()

    def type(self, selector: str, text: str) -> None:
        """Click into a field and replace what stands there."""
        self.click(selector)
        self.page.keyboard.press("Control+a")
        self.page.keyboard.type(text)
        self.way.keys += 1 + len(text)

    def key(self, key: str) -> None:
        """Press a key."""
        self.way.keys += 1
        self.page.keyboard.press(key)

    def tab_to(self, selector: str) -> None:
        """Press Tab until this has the focus, once it can have it."""
        expect(self.page.locator(selector).first).to_be_enabled(timeout=PATIENCE_MS)
        for _ in range(MOST_TABS):
            if self.page.evaluate("selector => document.activeElement.matches(selector)", selector):
                return
            self.key("Tab")
        raise AssertionError(f"{selector} is not reached by Tab")

    def sees(self, selector: str, text: str = "") -> None:
        """Wait until something is shown, with this text somewhere in it."""
        expect(self.page.locator(selector).first).to_be_visible(timeout=PATIENCE_MS)
        if text:
            expect(self.page.locator(selector).first).to_contain_text(re.compile(text), timeout=PATIENCE_MS)

    def drawn(self) -> None:
        """Wait until a log's review has curves at the cursor."""
        self.sees("#legends .legend, #legends > *")


def first_trial(hand: Hand, address: str) -> None:
    """Sign in, take control, arm, record the scripted demonstration, run a trial; up to its card."""
    hand.page.goto(address)
    for press in ("#take", "#arm", "#tab-demonstration", "#demonstration [type=submit]"):
        hand.click(press)
    hand.sees("#job-line", "succeeded")
    hand.click("#tab-trial")
    hand.click("#trial [type=submit]")
    hand.sees("#trial-card", "success|unexpected|failure")


def review_of_it(hand: Hand) -> None:
    """From the card to curves and scene at the impact."""
    hand.click("#card-open")
    hand.drawn()


def demonstration(hand: Hand) -> None:
    """Record one more scripted demonstration, armed."""
    hand.click("#tab-demonstration")
    hand.click("#demonstration [type=submit]")
    hand.sees("#job-line", r"Demonstration \d+ .*succeeded")


def shifted_trial(hand: Hand) -> None:
    """Again, with the object 10 mm further, from the card."""
    hand.click("#card-again-shifted")
    hand.sees("#job-line", r"\) runs")
    hand.sees("#trial-card", "success|unexpected|failure")


def by_hand(hand: Hand) -> None:
    """Record by hand: hold the clutch, move up for a second, let go; up to the log of it."""
    page = hand.page
    hand.click("#tab-hand")
    hand.click("#record")
    hand.sees("#clutch[data-state=ready]")
    for key in ("c", "e"):
        page.keyboard.down(key)
    hand.sees("#clutch[data-state=held]")
    page.wait_for_timeout(1e3 * JOG_S)
    for key in ("e", "c"):
        page.keyboard.up(key)
    hand.way.keys += 2
    hand.sees("#job-line", "succeeded|without success")


def grab_by_mouse(hand: Hand) -> None:
    """Record a grab with the mouse alone, a drag of a gizmo is the clutch, and accept it as a reference."""
    page = hand.page
    recordings = page.locator("#logs tbody tr", has_text="recording")
    before = recordings.count()
    for press in ("#tab-hand", "#drag-holds", "label:has([name=release][value=hold])", "#record"):
        hand.click(press)
    hand.sees("#clutch[data-state=ready]")
    operator = Operator(SimpleNamespace(page=page))
    operator.wait_for_scene()  # with the gizmos
    operator.grips = {side: np.array(place) for side, place in HOME.items()}
    for coupling, axis, metres in (("linked", 2, RAISED_M), ("mirrored", 1, -CLOSED_M), ("linked", 2, LIFTED_M)):
        hand.click(f"label:has([name=coupling][value={coupling}])")
        operator.drag("left", axis, metres, coupling)
        hand.way.clicks += 1
    hand.click("#finish")
    hand.sees("#job-line", "succeeded")
    expect(recordings).to_have_count(before + 1, timeout=PATIENCE_MS)
    hand.click("#logs tr:has-text('recording') [data-decision=open]")
    hand.sees("#facts", "Detected impact")
    hand.click("#accept")
    hand.sees("#verdict", "Accepted")


def by_keys(hand: Hand) -> None:
    """Without a mouse: take control, arm, run a trial, open its review. The page has just been opened."""
    for press in ("#take", "#arm"):
        hand.tab_to(press)
        hand.key("Enter")
    hand.tab_to("#tabs [aria-selected=true]")
    while not hand.page.locator("#tab-trial[aria-selected=true]").count():
        hand.key("ArrowRight")
    hand.tab_to("#trial [type=submit]")
    hand.key("Enter")
    hand.sees("#job-line", r"\) runs")
    hand.sees("#trial-card", "success|unexpected|failure")
    hand.tab_to("#card-open")
    hand.key("Enter")
    hand.drawn()


def compare_two(hand: Hand) -> None:
    """From any page: both trials in one view, at their impacts."""
    hand.click(".rail a[href='/logs']")
    rows = hand.page.locator("#logs tbody tr", has_text="trial")
    for row in (0, 1):
        hand.way.clicks += 1
        rows.nth(row).locator("input[type=checkbox]").click()
    hand.click("#compare")
    hand.drawn()
    hand.sees("#overlays > *")
    hand.sees("#difference-count", r"\d|nothing")


def campaign(hand: Hand) -> None:
    """From any page: the sample of the papers' comparison, up to its first progress. The arms were disarmed."""
    hand.click(".rail a[href='/campaigns']")
    hand.click("#start [type=submit]")
    hand.sees("#state", "running")
    hand.sees("#progress-line", r"\d+ of \d+")


def cancel_campaign(hand: Hand) -> None:
    """End it."""
    hand.click("#cancel-campaign")
    hand.sees("#state", "interrupted|failed|finished")


def sweep(hand: Hand, trials: int) -> None:
    """From any page: a sweep over the object's displacement, up to the plot of its means."""
    first = -10 * (trials // 2)
    hand.click(".rail a[href='/trials']")
    hand.type("#trial input[name=displacements_mm]", f"{first}:10:{first + 10 * (trials - 1)}")
    hand.click("#trial [type=submit]")
    hand.page.locator("#queue tbody tr").nth(trials - 1).wait_for(timeout=PATIENCE_MS)
    hand.click("#past-failures")
    hand.click("#queue-start")
    hand.click("#tab-means")
    hand.sees("#means-plot")
    ended = hand.page.locator("#means-table td").nth(1)
    expect(ended).to_have_text(re.compile(rf"\d+ of {trials}$"), timeout=trials * PATIENCE_MS)


def stop_and_recover(hand: Hand) -> None:
    """STOP in the middle of a trial, by the space bar, then arm again."""
    hand.click("#tab-trial")
    hand.click("#trial [type=submit]")
    hand.sees("#control-light[data-state=moving]")
    hand.page.keyboard.press("Space")
    hand.way.keys += 1
    hand.sees("#job-line", "stopped")
    hand.click("#arm")
    hand.sees("#control-light[data-state=armed]")


@contextmanager
def running_stack(logs: Path) -> Iterator[str]:
    """Run `rtstack up`; give the address that it prints."""
    process = subprocess.Popen(
        [str(COMMAND), "up", "--port", "0", "--logs", str(logs)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().removeprefix("rtstack is up: ").strip()
    finally:
        process.terminate()
        process.wait(60.0)


def measured(hand: Hand, name: str, go: Callable[[], None]) -> Way:
    """Go a way, and count."""
    hand.way = Way(name)
    began_s = time.monotonic()
    try:
        go()
        hand.way.seconds = round(time.monotonic() - began_s, 1)
    except (BrowserError, AssertionError) as failed:
        hand.way.problem = str(failed).splitlines()[0]
    return hand.way


def main() -> int:
    """Go all ways, print a table and one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=15, help="of the sweep; 0: without it")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=720)
    parser.add_argument("--json", type=Path, help="write the report here, too")
    options = parser.parse_args()
    ways: list[Way] = []
    load = os.getloadavg()[0]
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        with running_stack(Path(folder) / "logs") as address:
            page = browser.new_page(viewport={"width": options.width, "height": options.height})
            page.set_default_timeout(PATIENCE_MS)
            hand = Hand(page)

            def go(name: str, way: Callable[[], None]) -> None:
                ways.append(measured(hand, name, way))
                print(ways[-1], file=sys.stderr)

            go("address, first demonstration and trial, its card", lambda: first_trial(hand, address))
            go("the same trial with the object 10 mm further", lambda: shifted_trial(hand))
            go("the review of an impact, from the card", lambda: review_of_it(hand))
            page.goto(address.split("?")[0])
            go("one more scripted demonstration", lambda: demonstration(hand))
            go("a second by hand, recorded, with keys", lambda: by_hand(hand))
            go("a grab by mouse alone, recorded and accepted", lambda: grab_by_mouse(hand))
            page.goto(address.split("?")[0])
            page.click("#release")
            go("control, a trial, its review: by keys alone", lambda: by_keys(hand))
            page.goto(address.split("?")[0])
            go("STOP in a trial, and armed again", lambda: stop_and_recover(hand))
            go("two trials compared", lambda: compare_two(hand))
            if options.trials:
                go(f"a sweep of {options.trials} trials, with its plot", lambda: sweep(hand, options.trials))
            page.goto(address.split("?")[0])
            page.click("#disarm")
            go("a campaign's sample, until it counts", lambda: campaign(hand))
            measured(hand, "", lambda: cancel_campaign(hand))
        browser.close()
    table = Table("way", "seconds", "clicks", "keys", "shift", "")
    for way in ways:
        table.add_row(way.name, "" if way.seconds is None else str(way.seconds), str(way.clicks), str(way.keys),
                      f"{way.shift:.3f}", way.problem)  # fmt: skip
    Console(stderr=True).print(table)
    report = {"ways": [asdict(way) for way in ways], "load": [round(load, 1), round(os.getloadavg()[0], 1)]}
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if any(way.problem for way in ways) else 0


if __name__ == "__main__":
    sys.exit(main())
