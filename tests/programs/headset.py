"""Two hands in an emulated headset: how late a torque follows a hand, whether a clutch is lost, and what a grab that is
demonstrated so is worth as a reference.

    python -m tests.programs.headset [--steps 60] [--trials 20] [--demonstrations 1] [--json FILE] [--logs DIR]

A stack, a real Chromium, and npm's `iwer` as the headset: no metal, and no person. The hands are made: minimum-jerk
movements with a tremor of 0.3 mm at 9 Hz, the right hand 30 ms after the left one.

Steps: the left controller is moved by 10 mm again and again from rest; the time of that is the page's (Unix time by
performance.now), the end is when another thread sees, in the live rings, a tick whose command has left its place by
0.1 um, as in tests.programs.gizmo_latency. The wait for the headset's next picture is in it. Demonstrations: both grips
held, a grab of the rice box, finished by A and accepted by Y; and how often the pads were not led although a grip was
held. Trials: of the last demonstration, with seeds from 0 on. What the log says of each command is reported too, by
stages: between_ms two commands, which is a picture of the headset; made_to_came_ms, from the page to the console;
came_to_torque_ms, from there to the tick that takes it.

Exit status 1 where the 95th percentile is above 30 ms, a clutch was lost, or fewer than nine of ten trials succeed. The
first fault of page or arms ends it.
"""

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import expect, sync_playwright

from rtstack.log.reader import read_log
from rtstack.samples import SIDES
from rtstack.topics import HAND_TOPIC
from tests.support.console.headset import COUNT, READY_MS, REST, Person, emulate, emulator, minimum_jerk
from tests.support.console.operator_scene import Chromium, OperatorScene, wait
from tests.support.console.stack import COMMAND, SoakFailed

LEAST_M = 1e-7
STEP_M = 0.01
PATIENCE_S = 5.0
REST_S = 0.6
WANTED_MS = 30.0
WANTED_SHARE = 0.9
LET_GO_MS = 300.0  # between two commands: the hand was not leading
WRONG = re.compile("failed|stopped|without success|^Not |do not follow")
MOVE = """([x, y, z]) => {
  xr.controllers.left.position.set(x, y, z);
  return performance.timeOrigin + performance.now();
}"""


class First:
    """Sees, within half a millisecond, when the left command leaves its place. Unix time, ms."""

    def __init__(self, scene: OperatorScene) -> None:
        self._reader = scene.rings.reader("/left/control")
        record = self._reader.latest()
        assert record is not None
        self._place = record["pose_ref"][0, :3].copy()
        self.seen_ms: float | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while self.seen_ms is None and not self._over.wait(0.0005):
            record, at_ms = self._reader.latest(), 1e3 * time.time()
            if record is not None and np.abs(record["pose_ref"][0, :3] - self._place).max() > LEAST_M:
                self.seen_ms = at_ms

    def close(self) -> float | None:
        """Look no more; return when it was."""
        self._over.set()
        self._thread.join()
        return self.seen_ms


class Headset:
    """A person with the headset on, at a stack that is armed."""

    def __init__(self, scene: OperatorScene, script: Path) -> None:
        self.scene = scene
        page = self.page = scene.browser.context.new_page()
        page.set_default_timeout(READY_MS)
        emulate(page, script)
        began_s = time.monotonic()
        page.goto(f"{scene.stack.base}/headset")
        for button in ("#take", "#arm"):
            page.locator(button).click()
        expect(page.locator("#record")).to_be_enabled(timeout=READY_MS)
        self.person = Person(page)
        self.person.put_on()
        page.evaluate(COUNT)
        self.ready_s = time.monotonic() - began_s

    def until(self, selector: str, says: str) -> None:
        """Wait until a line of the page says something. Raises SoakFailed with what went wrong instead."""

        def reached() -> bool:
            for line in self.page.locator("#job-line, #errors p").all_inner_texts():
                if line != "-" and WRONG.search(line):
                    raise SoakFailed(line)
            return re.search(says, self.page.locator(selector).inner_text()) is not None

        wait(reached, f"the page does not say: {says}")

    def begin(self) -> None:
        """Record, and hold both grips."""
        person = self.person
        for side in SIDES:
            person.place(side, REST[side])
        person.press("right", "a-button")
        self.until("#headset-state", "hold a grip to lead")
        for side in SIDES:
            person.grip(side, True)
        self.until("#headset-state", "leading")

    def finish(self) -> Path:
        """Let go and finish; return the log."""
        for side in SIDES:
            self.person.grip(side, False)
        self.until("#headset-state", "hold a grip to lead")
        self.person.press("right", "a-button")
        self.until("#job-line", "succeeded")
        job = self.scene.stack.client.get("/api/status").raise_for_status().json()["job"]
        return self.scene.stack.logs / job["log"]

    def steps(self, count: int) -> list[float]:
        """Move the left hand up and down from rest; return after how long each was followed, ms. Raises SoakFailed."""
        found: list[float] = []
        x, y, z = REST["left"]
        for k in range(count):
            self.page.wait_for_timeout(1e3 * REST_S + 17 * (k % 7) / 7)
            first = First(self.scene)
            began_ms = self.page.evaluate(MOVE, [x, y + (STEP_M if k % 2 == 0 else 0.0), z])
            until_s = time.monotonic() + PATIENCE_S
            while first.seen_ms is None and time.monotonic() < until_s:
                time.sleep(0.002)
            seen_ms = first.close()
            if seen_ms is None:
                raise SoakFailed(f"step {k + 1} was not followed within {PATIENCE_S:g} s")
            found.append(seen_ms - began_ms)
        return found

    def accept(self) -> str:
        """Accept the recording; return what the page says of it."""
        self.person.press("left", "y-button")
        self.until("#job-line", "Accepted")
        return self.page.locator("#job-line").inner_text()


def of_commands(log: Path) -> dict:
    """Return what a log says of its commands."""
    hand = read_log(log).topic(HAND_TOPIC)
    made, came = hand["made_us"] * 1e-3, hand["came_us"] * 1e-3
    picture, gaps_ms = (hand["picture_us"] - hand["seen_us"]) * 1e-3, np.diff(hand["t_ns"]) * 1e-6
    gaps_ms = gaps_ms[gaps_ms < LET_GO_MS]
    stages = {
        "between_ms": gaps_ms, "made_to_came_ms": made - came, "came_to_torque_ms": came, "made_to_torque_ms": made,
        "torque_to_picture_ms": picture,
    }  # fmt: skip
    figures = {name: np.percentile(values, (50, 95)).round(1).tolist() for name, values in stages.items()}
    dropped = {name: int(hand[name][-1]) for name in hand.dtype.names or () if name.startswith("dropped")}
    return {"commands": len(hand), **figures, "longest_between_ms": round(float(gaps_ms.max()), 1), **dropped}


def trial(reference: Path, seed: int, folder: Path) -> tuple[bool, str]:
    """Run one trial in simulated time; return whether it succeeded, and why not."""
    log = folder / f"trial{seed}.mcap"
    order = ["trial", "--reference", str(reference), "--seed", str(seed), "--log", str(log)]
    done = subprocess.run([str(COMMAND), *order], capture_output=True, text=True)
    lines = (done.stdout + done.stderr).strip().splitlines()
    return done.returncode == 0, "" if done.returncode == 0 else (lines or ["nothing"])[-1]


def main() -> int:
    """Measure, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--demonstrations", type=int, default=1)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--reference", type=Path, help="only the trials, of this recording")
    parser.add_argument("--json", type=Path, help="write the report here, too")
    parser.add_argument("--logs", type=Path, help="keep the logs here")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    report: dict = {"emulated": "iwer, minimum-jerk hands with tremor", "load": [round(os.getloadavg()[0], 1)]}
    trouble: list[str] = []
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        logs = options.logs or Path(folder) / "logs"
        reference = options.reference
        if reference is None:
            browser = Chromium(playwright)
            scene = None
            try:
                scene = OperatorScene(browser, logs, drawn=False)
                reference = demonstrate(Headset(scene, emulator(Path(folder))), options, report, trouble)
            except KeyboardInterrupt:
                trouble.append("ended early: this is what there is so far")
            except (SoakFailed, BrowserError, httpx.HTTPError, AssertionError) as failed:
                trouble.append(str(failed).splitlines()[0])
            finally:
                if scene is not None:
                    trouble += scene.close()
                browser.close()
        if reference is not None and options.trials:
            won, failures, may_fail = 0, [], options.trials * (1.0 - WANTED_SHARE)
            for seed in range(options.trials):
                success, why = trial(reference, seed, Path(folder))
                won += success
                failures += [] if success else [why]
                if len(failures) > may_fail + 1e-9:
                    trouble.append(f"trials: {len(failures)} of {won + len(failures)} did not succeed: {why}")
                    break
            report["trials"] = {"succeeded": won, "of": won + len(failures), "not": failures}
    report |= {"load": [*report["load"], round(os.getloadavg()[0], 1)], "trouble": trouble}
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if trouble else 0


def demonstrate(headset: Headset, options: argparse.Namespace, report: dict, trouble: list[str]) -> Path | None:
    """Measure the steps and record the demonstrations; return the last recording."""
    report["from_address_to_armed_s"] = round(headset.ready_s, 1)
    if options.steps:
        headset.begin()
        found = headset.steps(options.steps)
        p50, p95 = np.percentile(found, (50, 95)).round(1).tolist()
        report["hand_to_torque"] = {"steps": len(found), "p50_ms": p50, "p95_ms": p95, **of_commands(headset.finish())}
        if p95 > WANTED_MS:
            trouble.append(f"hand to torque: p95 {p95:g} ms, {WANTED_MS:g} ms are allowed")
    recording = None
    for seed in range(options.demonstrations):
        headset.begin()
        headset.person.play(minimum_jerk(seed))
        recording = headset.finish()
        report.setdefault("demonstrations", []).append(of_commands(recording) | {"page": headset.accept()})
    report["clutch_lost"] = headset.page.evaluate("() => window.lost")
    if report["clutch_lost"]:
        trouble.append(f"the clutch was lost {report['clutch_lost']} times")
    return recording


if __name__ == "__main__":
    sys.exit(main())
