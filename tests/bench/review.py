"""How fast a long log is reviewed, and what that costs in memory: figures for a quiet machine.

`python tests/bench/review.py LOG.mcap`: a console that serves for real, and Chromium beside it. Measured are the first
plot (from opening the page to curves on the screen: of a log that was never read, and of one that was), when all of a
log that was never read is on the screen, zooming (from a change of the window until plotly has drawn it), scrubbing
(from the cursor to the answer, once the scene was told), and the largest memory of the console and its readers.
Make a log with tests/bench/long_log.py.
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
import psutil
from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from served_console import serve_console

_CHROMIUM = "/usr/bin/chromium"
_ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"]
_LONG_MS = 600_000
_PAUSE_S = 0.25


class Memory(threading.Thread):
    """Follows the memory of this process, which is the console, and of its children, Chromium left out."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.console_mb = 0.0
        self.readers_mb = 0.0

    def run(self) -> None:
        """Look ten times a second."""
        own = psutil.Process(os.getpid())
        while True:
            self.console_mb = max(self.console_mb, own.memory_info().rss / 1e6)
            try:
                readers = [child for child in own.children() if "console.review.conversion" in child.cmdline()]
                self.readers_mb = max(self.readers_mb, sum(child.memory_info().rss for child in readers) / 1e6)
            except psutil.Error:
                pass  # it has ended meanwhile
            time.sleep(0.1)


def opened(page: Page, address: str) -> tuple[float, float]:
    """Open a log; return s until the first curves were drawn, and until all of the log was."""
    start_s = time.monotonic()
    page.goto(address)
    page.locator("#figure .main-svg").first.wait_for(timeout=_LONG_MS)
    first_s = time.monotonic() - start_s
    page.locator("#share").evaluate(
        """share => new Promise(done => {
            const look = () => (share.value === 1 ? done() : setTimeout(look, 20));
            look();
        })"""
    )
    return first_s, time.monotonic() - start_s


def measured(page: Page, name: str, act: list[str]) -> list[float]:
    """Carry out scripts one after the other; return the durations that the page has measured, ms."""
    page.evaluate("name => performance.clearMeasures(name)", name)
    for script in act:
        before = page.evaluate("name => performance.getEntriesByName(name).length", name)
        page.evaluate(script)
        deadline_s = time.monotonic() + 30.0
        while page.evaluate("name => performance.getEntriesByName(name).length", name) == before:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{name}: nothing happened after {script}")
            time.sleep(0.02)
        time.sleep(_PAUSE_S)
    return page.evaluate("name => performance.getEntriesByName(name).map(entry => entry.duration)", name)


def zooms(count: int) -> list[str]:
    """Keys that zoom in eleven times and go back to the whole log, again and again, about changing moments."""
    keys = ["+"] * 11 + ["0"]
    press = "window.dispatchEvent(new KeyboardEvent('keydown', {key: '%s'}))"
    return [press % keys[number % len(keys)] for number in range(count)]


def scrubs(count: int) -> list[str]:
    """Moves of the slider to places all over the log."""
    move = (
        "(() => { const slider = document.getElementById('slider'); slider.value = %f * slider.max;"
        " slider.dispatchEvent(new Event('input')); })()"
    )
    return [move % share for share in np.random.default_rng(0).random(count)]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--count", type=int, default=60, help="zooms and scrubs")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    memory = Memory()
    with TemporaryDirectory(dir=options.log.resolve().parent) as folder, sync_playwright() as playwright:
        os.link(options.log, Path(folder) / "long.mcap")
        with serve_console(Path(folder)) as served:
            memory.start()
            browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=_ARGUMENTS)
            page = browser.new_context(viewport={"width": 1440, "height": 900}, base_url=served.base).new_page()
            page.goto(f"/?token={served.parts.sign_in.token}")
            page.goto("/logs")
            address = page.locator("#logs tbody a", has_text="long.mcap").get_attribute("href") or ""
            never_read_s, whole_s = opened(page, address)
            read_s, _ = opened(page, address)
            page.wait_for_timeout(5000)  # the scene's page has come up
            zoom_ms = measured(page, "curves", zooms(options.count))
            scrub_ms = measured(page, "scrub", scrubs(options.count))
            browser.close()
    figures = {
        "first_plot_never_read_s": round(never_read_s, 2),
        "whole_log_never_read_s": round(whole_s, 2),
        "first_plot_read_before_s": round(read_s, 2),
        "zoom_ms_p50": round(float(np.percentile(zoom_ms, 50)), 1),
        "zoom_ms_p95": round(float(np.percentile(zoom_ms, 95)), 1),
        "scrub_ms_p50": round(float(np.percentile(scrub_ms, 50)), 1),
        "scrub_ms_p95": round(float(np.percentile(scrub_ms, 95)), 1),
        "console_mb": round(memory.console_mb),
        "reader_mb": round(memory.readers_mb),
        "load": round(os.getloadavg()[0], 1),
    }
    print(json.dumps(figures) if options.json else "\n".join(f"{key:26} {value}" for key, value in figures.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
