"""How old a camera's picture is when it is on the page: from the tick whose state is drawn to the page that shows it.

    python -m tests.programs.glass_to_glass [--seconds 20] [--rate 30] [--busy] [--json FILE]

A stack with one simulated camera (384 x 288) that draws its time into each picture, and a real Chromium with the page
Operate, without its 3D scene; the arms are held by hand. In each of its own pictures the page reads the squares back
from what it shows, and says by its clock when that was (Unix time by performance.now). The tick's own time by the host
is that of the live rings, by the fastest of many looks. `--busy`: the page computes for 30 ms in each 50 ms meanwhile.
The loop's missed ticks are counted for as long without a page that shows the camera's pictures, and with it.

Exit status 1 where the 95th percentile is above 60 ms.
"""

import argparse
import json
import os
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from playwright.sync_api import sync_playwright

from rtstack.cameras.source import STAMP_BITS, STAMP_NS, STAMP_PX
from rtstack.cells import default_cell_file
from tests.support.console.operator_scene import Chromium, OperatorScene, wait

WANTED_MS = 60.0
CAMERA = """
[cameras.front]
kind = "simulated"
position = [1.4, 0.0, 0.5]
orientation_wxyz = [0.5, -0.5, -0.5, 0.5]
width = 384
height = 288
rate_hz = {rate}
stamped = true
"""
SHOWN = "document.querySelector('#camera canvas').width"
READ = """([bits, px, busy]) => {
  window.seen = [];
  const canvas = document.querySelector("#camera canvas");
  const context = canvas.getContext("2d", { willReadFrequently: true });
  let last = -1;
  const look = () => {
    requestAnimationFrame(look);
    if (canvas.width < bits * px) return;
    const { data } = context.getImageData(0, px / 2, bits * px, 1);
    let value = 0;
    for (let k = 0; k < bits; k += 1) value = 2 * value + (data[4 * (k * px + px / 2)] > 127 ? 1 : 0);
    if (value !== last) window.seen.push([value, performance.timeOrigin + performance.now()]);
    last = value;
  };
  requestAnimationFrame(look);
  if (busy) setInterval(() => { const end = performance.now() + 30; while (performance.now() < end); }, 50);
}"""


class Clock:
    """How far the host's Unix time is ahead of the robot's, ns: the least of what is found, each half millisecond."""

    def __init__(self, scene: OperatorScene) -> None:
        self._reader = scene.rings.reader("/left/arm")
        self.ahead_ns = np.iinfo(np.int64).max
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while not self._over.wait(0.0005):
            record = self._reader.latest()
            if record is not None:
                self.ahead_ns = min(self.ahead_ns, time.time_ns() - int(record["t_ns"][0]))

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()


def run(scene: OperatorScene, seconds: float, busy: bool, camera: bool) -> tuple[dict, list[float]]:
    """Hold the arms for so long; return how many ticks were missed, and of each picture how old it was, ms."""
    page = scene.page
    page.select_option("#camera-name", "front" if camera else "")
    scene.take_hold(jog=False)
    clock = Clock(scene)
    if camera:
        wait(lambda: page.evaluate(f"{SHOWN} > {STAMP_BITS * STAMP_PX - 1}"), "no picture is shown")
        page.evaluate(READ, [STAMP_BITS, STAMP_PX, busy])
    before = _missed(scene)
    page.wait_for_timeout(1e3 * seconds)
    late = {"seconds": seconds, "missed": _missed(scene) - before}
    seen = page.evaluate("window.seen ?? []")
    clock.close()
    scene.leave()
    wait(lambda: not scene.active, "the job does not end")
    return late, [at_ms - 1e-6 * (value * STAMP_NS + clock.ahead_ns) for value, at_ms in seen[1:]]


def _missed(scene: OperatorScene) -> int:
    record = scene.rings.reader("/timing").latest()
    return 0 if record is None else int(record["missed_deadlines"][0])


def main() -> int:
    """Measure, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=30.0, help="pictures a second")
    parser.add_argument("--busy", action="store_true")
    parser.add_argument("--json", type=Path, help="write the report here, too")
    options = parser.parse_args()
    report: dict = {"load": [round(os.getloadavg()[0], 1)]}
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        cell = Path(folder) / "cell.toml"
        cell.write_text(default_cell_file().read_text() + CAMERA.format(rate=options.rate))
        browser = Chromium(playwright)
        scene = OperatorScene(browser, Path(folder) / "logs", drawn=False, options=("--cell", str(cell)))
        try:
            report["without"], _ = run(scene, options.seconds, False, camera=False)
            report["with"], ages = run(scene, options.seconds, options.busy, camera=True)
        finally:
            report["trouble"] = scene.close()
            browser.close()
    p50, p95, worst = np.percentile(ages, (50, 95, 100)).round(1).tolist()
    report["glass_to_glass"] = {"pictures": len(ages), "p50_ms": p50, "p95_ms": p95, "worst_ms": worst}
    report["load"].append(round(os.getloadavg()[0], 1))
    print(json.dumps(report, indent=2))
    if options.json is not None:
        options.json.write_text(json.dumps(report) + "\n")
    return 1 if p95 > WANTED_MS or report["trouble"] else 0


if __name__ == "__main__":
    sys.exit(main())
