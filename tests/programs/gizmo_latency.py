"""From the mouse to the robot: how long after a mouse event `tau_desired` first follows it, and where the time goes.

    python -m tests.programs.gizmo_latency [--drags 40] [--json FILE]

A stack, a real Chromium with the 3D scene, the clutch held, and the left gizmo dragged again and again from rest. The
mouse event's time is the host's clock just before it is sent to the browser; the end is the moment at which another
thread has seen, in the live rings, a tick whose command has left its place by LEAST_M: `tau_desired` of that tick
follows it (at rest a torque changes anyway, with the sensors' noise). Both ends make it longer. On the way: the event
in the page (the browser hands it out with a frame), the gizmo's message (viser's client sends the first one at once,
and further ones every 50 ms), the mailbox (the proxy, viser's server, the hand), the loop (the filter). Exit status 1
where the 95th percentile is above 80 ms, or a drag moved nothing. Nothing else should compute meanwhile; without a
graphics card the scene is drawn by the same CPUs. Ctrl-C gives what there is so far.
"""

import argparse
import json
import os
import random
import signal
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np
from playwright.sync_api import Error as BrowserError
from playwright.sync_api import sync_playwright
from rich.console import Console
from rich.progress import track

from rtstack.loop.target import TARGET
from tests.support.console.operator_hands import ARROW_M, HOME, pixel
from tests.support.console.operator_scene import Chromium, OperatorScene
from tests.support.console.stack import SoakFailed

LEAST_M = 1e-7
STEP_M = 0.02
PATIENCE_S = 2.0
REST_S = 0.5  # before and after a drag, until the command stands still
WANTED_MS = 80.0
TRIES = 5  # of holding the clutch on a machine that is too busy for it
STAGES = ("page", "message", "mailbox", "loop")
# in the scene's frame: when it was told of the mouse, and when it sent what the gizmo did; Unix time, ms
MARKS = """() => {
  const now = () => performance.timeOrigin + performance.now();
  window.marks = {};
  window.addEventListener("pointermove", () => (window.marks.page ??= now()), { capture: true });
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (data, ...rest) {
    const kind = data?.type === "send" && data.message.type;
    if (kind === "TransformControlsUpdateMessage") window.marks.message ??= now();
    return post.call(this, data, ...rest);
  };
}"""


class Watch:
    """Sees, within half a millisecond, the left hand's first change in the mailbox and in the loop. Unix time, ms."""

    def __init__(self, scene: OperatorScene) -> None:
        self._mailbox = scene.mailbox
        self._control = scene.rings.reader("/left/control")
        self._target = np.zeros(1, TARGET)
        self._over = threading.Event()
        self._places = self._now()
        self.marks: dict[str, float] = {}
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _now(self) -> dict[str, np.ndarray]:
        self._mailbox.read_target(self._target)
        record = self._control.latest()
        assert record is not None
        return {"mailbox": self._target["pose"][0, 0, :3].copy(), "loop": record["pose_ref"][0, :3].copy()}

    def _look(self) -> None:
        while not self._over.wait(0.0005):
            now, at_ms = self._now(), 1e3 * time.time()
            for name, place in now.items():
                if name == "loop" and "mailbox" not in self.marks:
                    self._places["loop"] = place  # what it was asked before
                elif name not in self.marks and np.abs(place - self._places[name]).max() > LEAST_M:
                    self.marks[name] = at_ms

    def close(self) -> dict[str, float]:
        """Look no more; return what was seen."""
        self._over.set()
        self._thread.join()
        return self.marks


class Drags:
    """An operator who drags the left gizmo up and down. at_m: how far up it is."""

    def __init__(self, scene: OperatorScene) -> None:
        self._scene, self._at_m, self._held = scene, 0.0, False
        self._moments = random.Random(1)
        self.lost = 0

    def drag(self) -> dict[str, float] | None:
        """Drag once; return when what was reached, ms after the mouse event, None where the arms stopped or stayed."""
        self._hold()
        page = self._scene.page
        step = STEP_M if self._at_m == 0.0 else -STEP_M
        box = page.frame_locator("#scene").locator("canvas").first.bounding_box()
        assert box is not None
        arrow = np.array(HOME["left"]) + (0.0, 0.0, ARROW_M + self._at_m)
        ends = [pixel(arrow + (0.0, 0.0, rise), box["width"], box["height"]) for rise in (0.0, step)]
        (x0, y0), (x1, y1) = [(box["x"] + x, box["y"] + y) for x, y in ends]
        page.mouse.move(x0, y0)
        page.mouse.down()
        page.wait_for_timeout(1e3 * (REST_S + 0.1 * self._moments.random()))
        (frame,) = [frame for frame in page.frames if "/viser/" in frame.url]
        frame.evaluate("() => { window.marks = {}; }")
        watch = Watch(self._scene)
        began_ms = 1e3 * time.time()
        page.mouse.move(x1, y1)
        while "loop" not in watch.marks and 1e3 * time.time() - began_ms < 1e3 * PATIENCE_S:
            time.sleep(0.002)
        marks = frame.evaluate("() => window.marks") | watch.close()
        page.mouse.up()
        page.wait_for_timeout(1e3 * REST_S)
        if self._scene.witness.stopped or "loop" not in marks:
            self._held = False
            self.lost += self._scene.witness.stopped
            return None
        self._at_m += step
        return {name: marks.get(name, np.nan) - began_ms for name in STAGES}

    def _hold(self) -> None:
        """Hold the clutch, anew where it was lost. Raises SceneFailed."""
        if self._held:
            return
        scene = self._scene
        for _ in range(TRIES):
            scene.leave()
            scene.page.mouse.up()
            scene.stack.post("teleoperation/finish") if self._runs() else None
            scene.take_hold(jog=False)
            scene.page.wait_for_timeout(2e3 * REST_S)  # the gizmo comes to the hand
            self._held, self._at_m = not scene.witness.stopped, 0.0
            if self._held:
                break
            self.lost += 1
        else:
            raise SoakFailed(f"the clutch was lost {TRIES} times in a row: this machine does not keep up with the page")
        (frame,) = [frame for frame in scene.page.frames if "/viser/" in frame.url]
        if not frame.evaluate("() => 'marks' in window"):
            frame.evaluate(MARKS)

    def _runs(self) -> bool:
        return not self._scene.witness.stopped and self._scene.active


def main() -> int:
    """Measure, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drags", type=int, default=40)
    parser.add_argument("--json", type=Path, help="write the report here, too")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    found: list[dict[str, float]] = []
    trouble: list[str] = []
    unmoved = lost = 0
    load = os.getloadavg()[0]
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = Chromium(playwright)
        scene = None
        try:
            scene = OperatorScene(browser, Path(folder) / "logs")
            drags = Drags(scene)
            for _ in track(range(options.drags), "drags", console=Console(stderr=True), transient=True):
                seen = drags.drag()
                unmoved += seen is None
                found += [seen] if seen is not None else []
                lost = drags.lost
        except KeyboardInterrupt:
            trouble.append("ended early: this is what there is so far")
        except (SoakFailed, BrowserError, httpx.HTTPError) as failed:
            trouble.append(str(failed).splitlines()[0])
        finally:
            if scene is not None:
                trouble += scene.close()
            browser.close()
    report = judged(found, unmoved, trouble)
    report |= {"clutch_lost": lost, "load": [round(load, 1), round(os.getloadavg()[0], 1)]}
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if report["trouble"] else 0


def judged(found: list[dict[str, float]], unmoved: int, trouble: list[str]) -> dict:
    """Return the figures, JSON-ready, and what is wrong with them."""
    times = np.array([[seen[name] for name in STAGES] for seen in found]).reshape(-1, len(STAGES))
    steps = np.diff(times, axis=1, prepend=0.0)
    figures: dict[str, object] = {"drags": len(found), "unmoved": unmoved, "wanted_ms": WANTED_MS}
    if unmoved:
        trouble = [*trouble, f"{unmoved} drags moved nothing"]
    if not len(found):
        return figures | {"trouble": [*trouble, "nothing was measured"]}
    p50, p95 = (round(float(p), 1) for p in np.percentile(times[:, -1], [50, 95]))
    if p95 > WANTED_MS:
        trouble = [*trouble, f"p95 is {p95:g} ms, {WANTED_MS:g} ms are wanted"]
    stages = {
        f"{name}_ms": [round(float(p), 1) for p in np.nanpercentile(steps[:, k], [50, 95])]
        for k, name in enumerate(STAGES) if not np.isnan(steps[:, k]).all()
    }  # fmt: skip
    return figures | {"p50_ms": p50, "p95_ms": p95, "p50_and_p95_by_stage": stages, "trouble": trouble}


if __name__ == "__main__":
    sys.exit(main())
