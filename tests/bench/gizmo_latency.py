"""From the mouse to the robot: how long after a mouse event the arms are first asked for something else.

`python tests/bench/gizmo_latency.py --drags 40`: a stack, a real Chromium, the clutch held, and one gizmo dragged again
and again from rest. Each mouse event's time is the host's monotonic clock, before it is sent to the browser; the loop's
is taken from the live rings, in which every tick's record of the command and the desired torque stand as soon as they
are out. Counted is the first tick whose command has left its place by LEAST_M, and `tau_desired` is of that tick: at
rest a torque changes anyway, with the sensors' noise. Nothing else should compute meanwhile.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import sync_playwright

from rtstack.live.client import RUN_PREFIX, SOCKET_NAME
from rtstack.log.ring import RingReader, Rings

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.browser.conftest import ARGUMENTS, CHROMIUM, Console
from tests.browser.test_gizmos import ARROW_M, HOME, Operator, pixel

LEAST_M = 1e-7
PATIENCE_S = 2.0
WANTED_MS = 80.0


def main() -> int:
    """Measure, print one JSON object; status 1 where the 95th percentile is more than is wanted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drags", type=int, default=40)
    drags = parser.parse_args().drags
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        stack = subprocess.Popen(
            [sys.executable, "-m", "rtstack", "up", "--port", "0", "--logs", f"{folder}/logs"],
            stdout=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": folder},
        )  # fmt: skip
        try:
            assert stack.stdout is not None
            address = stack.stdout.readline().removeprefix("rtstack is up: ").strip()
            delays_ms = _measure(address, _rings(Path(folder)), drags)
        finally:
            stack.terminate()
            stack.wait(60)
    p50, p95 = np.percentile(delays_ms, [50, 95])
    print(json.dumps({"drags": len(delays_ms), "p50_ms": round(p50, 1), "p95_ms": round(p95, 1), "wanted": WANTED_MS}))
    return int(p95 > WANTED_MS)


def _rings(folder: Path) -> Rings:
    """Attach to the live rings: the console's command line names them."""
    (socket,) = folder.glob(f"{RUN_PREFIX}*/{SOCKET_NAME}")
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
            if "--rings" in words and str(socket.parent) in words:
                return Rings.attach(words[words.index("--rings") + 1])
    raise SystemExit("the console does not run")


def _command(reader: RingReader) -> NDArray[np.float64]:
    """Return where the left arm is asked to be, m."""
    record = reader.latest()
    assert record is not None
    return record["pose_ref"][0, :3].copy()


def _measure(address: str, rings: Rings, drags: int) -> list[float]:
    reader = rings.reader("/left/control")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
        operator = Operator(Console(page, address))
        operator.begin("#practise")
        page.check("input[name=release][value=stop]", force=True)
        operator.hold()
        box = page.frame_locator("#scene").locator("canvas").first.bounding_box()
        assert box is not None
        delays_ms, at = [], 0.0
        for number in range(drags):
            step = 0.02 if number % 2 == 0 else -0.02
            ends = [np.array(HOME["left"]) + (0, 0, ARROW_M + rise) for rise in (at, at + step)]
            pixels = [pixel(end, box["width"], box["height"]) for end in ends]
            (x0, y0), (x1, y1) = [(box["x"] + x, box["y"] + y) for x, y in pixels]
            page.mouse.move(x0, y0)
            page.mouse.down()
            page.wait_for_timeout(400)  # until the command stands still
            before = _command(reader)
            began_s = time.monotonic()
            page.mouse.move(x1, y1)
            while np.abs(_command(reader) - before).max() < LEAST_M:
                if time.monotonic() - began_s > PATIENCE_S:
                    break
            else:
                delays_ms.append(1e3 * (time.monotonic() - began_s))
            page.mouse.up()
            at += step
            page.wait_for_timeout(400)
        page.keyboard.up("c")
        browser.close()
    if len(delays_ms) < drags:
        print(f"{drags - len(delays_ms)} of {drags} drags moved nothing", file=sys.stderr)
    return delays_ms


if __name__ == "__main__":
    sys.exit(main())
