"""How fast a long log is reviewed, and what that costs in memory: figures for a quiet machine.

`python -m tests.programs.review LOG.mcap [--spike SECONDS]`: a console that serves for real, and Chromium beside it,
moved by real input. Every figure is from the event, as the browser dates it, to two frames after its result was drawn:
the first plot from the click on the log's link (of a log that was never read, and of one that was), a zoom from the
turn of the wheel, the key or the end of the drag to the curves of the new window, a scrub from the mouse's move on the
slider to the values at the cursor, which come once the scene was told. Each is waited for two minutes at most: what has
not come by then ends the run, with the figures so far and exit status 1. Memory is the largest of the console and of
its readers. With --spike, where one sample of left.tau_J.4 is 400 Nm, the spike is looked for at every zoom: in the
API's answer, and in the pixels of the screen. Make such a log with tests/programs/long_log.py.
"""

import argparse
import itertools
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import psutil
from playwright.sync_api import Error, Page, sync_playwright
from rich.progress import Progress

from tests.programs.long_log import SPIKE_NM
from tests.support.console.curve_pixels import drawn, highest_seen
from tests.support.console.served_console import serve_console

_CHROMIUM = "/usr/bin/chromium"
_ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"]
_WINDOW = "document.getElementById('figure-area').dataset.window"  # of the curves on the screen
_SPIKED = "left.tau_J.4"
_PATIENCE_MS = 120_000  # playwright has none for a promise of the page: whatever never comes would hang the run
_CLOSE_S = 0.1  # a shorter window goes back to the whole: where nothing changes nothing would end the wait
_HALF_S = (1000.0, 200.0, 60.0, 20.0, 5.0, 1.0, 0.3, 0.1, 0.03, 0.01)  # windows about the spike, half of each
# each input is dated by the browser; `shown` says when what it led to was on the screen
_WATCH = """
for (const kind of ['wheel', 'keydown', 'pointerup', 'pointermove'])
  addEventListener(kind, (event) => { window.newest = event.timeStamp; }, {capture: true, passive: true});
window.after = (change) => new Promise((done, fail) => {
  setTimeout(() => fail(new Error(`not within ${PATIENCE_MS} ms: ${change}`)), PATIENCE_MS);
  const look = () => (change() ? requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now()))) : setTimeout(look, 1));
  look();
});
addEventListener('DOMContentLoaded', () => {
  const points = () => Number(document.getElementById('figure-area')?.dataset.points ?? 0);
  window.first = after(points).then((ms) => performance.timeOrigin + ms);
});
""".replace("PATIENCE_MS", str(_PATIENCE_MS))  # noqa: E501


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


def opened(page: Page) -> tuple[float, float]:
    """Click on the log's link; return s until the first curves were on the screen, and until all of the log was."""
    page.goto("/logs")
    link = page.locator("#logs tbody td.when[title='long.mcap'] a")
    link.wait_for()
    start_s = time.time()
    link.click(no_wait_after=True)
    page.wait_for_url("**/logs/*")
    first_s = page.evaluate("window.first") / 1e3 - start_s
    page.evaluate("after(() => document.getElementById('share').value === 1)")
    return first_s, time.time() - start_s


class Pointer:
    """The mouse and the keyboard of whoever reviews."""

    def __init__(self, page: Page) -> None:
        self._page = page
        box = page.locator("#figure-area").bounding_box()
        track = page.locator("#slider").bounding_box()
        assert box is not None
        assert track is not None
        self._left, self._width, self._y = box["x"] + 64, box["width"] - 76, box["y"] + box["height"] / 3
        self._track = track
        self._random = np.random.default_rng(0)

    def _drawn(self, act: Callable[[], None]) -> float:
        """Do something that changes the window; return ms from its event until the new curves are on the screen."""
        self._page.evaluate(
            f"""() => {{
                const before = {_WINDOW};
                window.done = after(() => {_WINDOW} !== before).then((ms) => ms - window.newest);
            }}"""
        )
        act()
        return self._page.evaluate("window.done")

    def _window_s(self) -> float:
        return float(self._page.evaluate(f"(([from, to]) => to - from)({_WINDOW}.split(','))"))

    def zooms(self, count: int, advance: Callable[[], None]) -> list[float]:
        """Zoom by wheel, key and drag, further in and at last back to the whole log, again and again."""
        took = []
        mouse, keyboard = self._page.mouse, self._page.keyboard

        def drag() -> None:
            x = self._left + self._width * self._random.uniform(0.2, 0.5)
            mouse.move(x, self._y)
            mouse.down()
            mouse.move(x + 0.35 * self._width, self._y, steps=3)
            mouse.up()

        def wheel() -> None:
            mouse.wheel(0, -100)

        def whole() -> None:
            keyboard.press("0")

        turns = itertools.cycle([*(wheel,) * 4, lambda: keyboard.press("+"), drag, *(wheel,) * 4, drag, whole])
        for _ in range(count):
            mouse.move(self._left + self._width * self._random.uniform(0.1, 0.9), self._y)
            act = next(turns)
            while act is not whole and self._window_s() < _CLOSE_S:
                act = next(turns)
            took.append(self._drawn(act))
            advance()
        return took

    def scrubs(self, count: int, advance: Callable[[], None]) -> list[float]:
        """Drag the slider to and fro; return ms from each move of the mouse until the values there are written."""
        mouse, track = self._page.mouse, self._track
        y, took = track["y"] + track["height"] / 2, []
        mouse.move(track["x"] + track["width"] / 2, y)
        mouse.down()
        for share in self._random.uniform(0.02, 0.98, count):
            self._page.evaluate(
                """() => {
                    const before = performance.getEntriesByName('scrub').length;
                    const now = document.getElementById('now').textContent;
                    window.done = after(() => document.getElementById('now').textContent !== now
                        && performance.getEntriesByName('scrub').length > before).then((ms) => ms - window.newest);
                }"""
            )
            mouse.move(track["x"] + share * track["width"], y)
            took.append(self._page.evaluate("window.done"))
            advance()
        mouse.up()
        return took


def spike(page: Page, address: str, t_s: float, end_s: float, seen: dict[str, list[float]]) -> None:
    """Note each zoom's window, what the API says is the peak, and how high the curve is on the screen."""
    seen |= {"window_s": [], "api_nm": [], "pixels_nm": []}
    for half_s in _HALF_S:
        first, last = max(0.0, t_s - half_s), min(end_s, t_s + half_s)
        cursor = first if first > 0.0 else last
        page.goto(f"{address}?signals={_SPIKED}&from={first:.3f}&to={last:.3f}&t={cursor:.3f}")
        page.evaluate("window.first")
        page.wait_for_timeout(500)
        seen["window_s"].append(round(last - first, 3))
        seen["api_nm"].append(max(drawn(page, _SPIKED)[0]["y"]))
        seen["pixels_nm"].append(round(highest_seen(page, _SPIKED, t_s), 1))


def main() -> int:
    """Measure and print. Returns 1 where it ended early, or the spike is not seen at some zoom."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--count", type=int, default=60, help="zooms and scrubs")
    parser.add_argument("--spike", type=float, help="where left.tau_J.4 has one sample of 400 Nm, s")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    memory, complete = Memory(), True
    figures: dict[str, object] = {}
    looked: dict[str, list[float]] = {}
    try:
        with TemporaryDirectory(dir=options.log.resolve().parent) as folder, Progress(transient=True) as progress:
            os.link(options.log, Path(folder) / "long.mcap")
            memory.start()
            steps = progress.add_task("reviewing", total=2 * options.count + 2)
            review(Path(folder), options.count, options.spike, figures, looked, lambda: progress.advance(steps))
    except (KeyboardInterrupt, Error) as error:
        complete = False
        print(f"ended early: {str(error).splitlines()[0] if str(error) else 'what there is so far'}", file=sys.stderr)
    figures |= {
        "console_mb": round(memory.console_mb),
        "reader_mb": round(memory.readers_mb),
        "load": round(os.getloadavg()[0], 1),
        **{f"spike_{key}": values for key, values in looked.items()},
    }
    print(json.dumps(figures) if options.json else "\n".join(f"{key:26} {value}" for key, value in figures.items()))
    missed = [value for key in ("api_nm", "pixels_nm") for value in looked.get(key, []) if value < 0.95 * SPIKE_NM]
    return 0 if complete and not missed else 1


def review(
    folder: Path,
    count: int,
    spike_s: float | None,
    figures: dict[str, object],
    looked: dict[str, list[float]],
    advance: Callable[[], None],
) -> None:
    """Review the log in a folder, and fill in what was found as it is found."""
    with sync_playwright() as playwright, serve_console(folder) as served:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=_ARGUMENTS)
        page = browser.new_context(viewport={"width": 1440, "height": 900}, base_url=served.base).new_page()
        page.set_default_timeout(_PATIENCE_MS)
        page.add_init_script(_WATCH)
        page.goto(f"/?token={served.parts.sign_in.token}")
        first_s, whole_s = opened(page)
        figures["first_plot_never_read_s"] = round(first_s, 2)
        figures["whole_log_never_read_s"] = round(whole_s, 2)
        advance()
        figures["first_plot_read_before_s"] = round(opened(page)[0], 2)
        advance()
        page.wait_for_timeout(5000)  # the scene's page has come up
        pointer = Pointer(page)
        for name, act in (("zoom", pointer.zooms), ("scrub", pointer.scrubs)):
            took_ms = act(count, advance)
            page.keyboard.press("0")
            for share in (50, 95):
                figures[f"{name}_ms_p{share}"] = round(float(np.percentile(took_ms, share)), 1)
        if spike_s is not None:
            end_s = float(page.locator("#slider").get_attribute("max") or "nan")
            spike(page, page.url.split("?")[0], spike_s, end_s, looked)
        browser.close()


if __name__ == "__main__":
    sys.exit(main())
