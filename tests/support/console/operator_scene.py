"""An operator at work: `rtstack up`, a Chromium of its own, both hands on the keys, and a witness at the live rings.

The browser is started here, not by playwright: playwright makes every page believe that it is in front and has the
keyboard, and then no page is ever hidden.
"""

import contextlib
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from playwright.sync_api import Page, Playwright

from rtstack.live.standalone import find_rings
from rtstack.log.ring import Rings
from rtstack.loop.end import End
from rtstack.samples import SIDES, Mode
from tests.support.console.chromium import ARGUMENTS, CHROMIUM, leave_scene_undrawn
from tests.support.console.stack import SoakFailed, Stack

OPERATOR = "operator"
CLUTCH, JOG = "c", "e"  # keys: hold the clutch, left hand up
FOLLOWING_M_S = 0.05  # asked of the left arm: it follows the hand
TOO_EARLY = "the arms stopped before anybody let go"
PATIENCE_S = 240.0  # the tick may have to be compiled first, on a busy machine
_LOOK_S = 0.001
_ENDED = ("done", "stopped", "failed")


class SceneFailed(SoakFailed):
    """The moment was not reached. The message is one line."""


class Chromium:
    """A browser without anybody's defaults, in a process group of its own. `blank` is a second tab of its window."""

    def __init__(self, playwright: Playwright) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="rtstack-chromium-", ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [CHROMIUM, *ARGUMENTS, "--no-first-run", "--disable-breakpad", "--window-size=1280,720",
             "--remote-debugging-port=0", f"--user-data-dir={self._folder.name}", "about:blank"],
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            said = Path(self._folder.name) / "DevToolsActivePort"
            wait(lambda: said.exists() and len(said.read_text().split()) == 2, "the browser does not start")
            port, path = said.read_text().split()
            browser = playwright.chromium.connect_over_cdp(f"ws://127.0.0.1:{port}{path}", no_defaults=True)
            self.context = browser.contexts[0]
            self.blank = self.context.pages[0] if self.context.pages else self.context.new_page()
        except BaseException:
            self.close()
            raise

    def freeze(self) -> None:
        """Have every process of the browser stand still."""
        os.killpg(self._process.pid, signal.SIGSTOP)

    def kill(self) -> None:
        """Kill every process of the browser."""
        os.killpg(self._process.pid, signal.SIGKILL)

    def renderers(self) -> list[psutil.Process]:
        """Return the processes that carry out its pages."""
        children = psutil.Process(self._process.pid).children(recursive=True)
        return [child for child in children if "--type=renderer" in child.cmdline()]

    def thaw(self) -> None:
        """Let them go on."""
        os.killpg(self._process.pid, signal.SIGCONT)

    def close(self) -> None:
        """End it, whatever it does."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._folder.cleanup()


class Witness:
    """Reads the live rings every millisecond: when both arms had a torque of the stop, and why.

    What is seen is seen after it was: a time of the witness is never too early.
    """

    def __init__(self, rings: Rings) -> None:
        self._controls = [rings.reader(f"/{side}/control") for side in SIDES]
        self._events = rings.reader("/events")
        self._over = threading.Event()
        self.begin()
        self._thread = threading.Thread(target=self._look, daemon=True, name="witness")
        self._thread.start()

    def begin(self) -> None:
        """Forget what was seen."""
        self._stops: dict[int, tuple[int, int]] = {}  # of a side: host's and robot's time of its first stopping tick
        self.reason: tuple[int, str] | None = None  # robot's time at which the loop said it, ns
        self.speed_m_s = 0.0  # asked of the left arm

    def _look(self) -> None:
        for reader in (*self._controls, self._events):
            reader.drain()
        while not self._over.wait(_LOOK_S):
            for side, reader in enumerate(self._controls):
                records = reader.drain()
                if len(records):
                    self._take(side, records)
            for event in self._events.drain():
                text = event["text"].decode("ascii", "replace")
                if self.reason is None and text.startswith(tuple(End)):
                    self.reason = int(event["t_ns"]), text

    def _take(self, side: int, records: NDArray[Any]) -> None:
        if side == 0:
            led = records["mode"][-1] == Mode.TELEOPERATION
            self.speed_m_s = float(np.linalg.norm(records["twist_ref"][-1, :3])) if led else 0.0
        stopping = records["t_ns"][records["mode"] == Mode.STOPPING]
        if len(stopping) and side not in self._stops:
            self._stops[side] = time.monotonic_ns(), int(stopping[0])

    @property
    def stopped(self) -> bool:
        """Whether both arms were given a torque of the stop."""
        return len(self._stops) == len(SIDES)

    def seen_ns(self) -> tuple[int, int]:
        """Return when the first and the last arm were seen to stop, host's monotonic time. Once both have."""
        seen = sorted(seen_ns for seen_ns, _ in self._stops.values())
        return seen[0], seen[-1]

    def first_t_ns(self) -> dict[int, int]:
        """Return the robot's time of the first stopping tick of each arm that was seen to stop."""
        return {side: t_ns for side, (_, t_ns) in self._stops.items()}

    def last_t_ns(self) -> int:
        """Return the robot's time of the first stopping tick of the arm that was the last. Once both have."""
        return max(t_ns for _, t_ns in self._stops.values())

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()


def hold_keys(page: Page) -> None:
    """Hold the clutch by a key, and lead the left arm by another."""
    page.keyboard.down(CLUTCH)
    page.keyboard.down(JOG)


class OperatorScene:
    """The stack, and an operator's page in a browser that outlives it. drawn: with the 3D scene in the page.

    arms: options of `rtstack up`, none for the simulated cell.
    """

    def __init__(self, browser: Chromium, logs: Path, drawn: bool = True, arms: Sequence[str] = ()) -> None:
        self.browser = browser
        self._drawn = drawn
        self.stack = Stack(logs, arms)
        self._page: Page | None = None
        try:
            self.console = self.stack.members["console"]
            self.rings = Rings.attach(find_rings(self.stack.run_folder))
            self.witness = Witness(self.rings)
        except BaseException:
            self.stack.end()
            raise
        cookies = [{"name": n, "value": v, "url": self.stack.base} for n, v in self.stack.client.cookies.items()]
        browser.context.add_cookies(cookies)  # type: ignore[arg-type]

    @property
    def page(self) -> Page:
        """The operator's page, in front."""
        if self._page is None or self._page.is_closed():
            self._page = self.browser.context.new_page()
            self._page.set_default_timeout(1e3 * PATIENCE_S)
            if not self._drawn:
                leave_scene_undrawn(self._page)
            self._page.goto(f"{self.stack.base}/")
            self._page.click("#tab-hand")
        self._page.bring_to_front()
        return self._page

    def take_hold(self, hold: Callable[[Page], None] = hold_keys) -> None:
        """Take control, arm, start, hold the clutch, and lead the left arm, by keys or as `hold` does.

        Raises SceneFailed where the arms stopped, or did not follow.
        """
        page = self.page
        wait(lambda: not self.active, "the last job does not end")
        self.take_control()
        self.witness.begin()
        self.stack.post("jobs/teleoperation", object="rice_box", stop_on_release=True)
        page.locator("#clutch[data-state=ready]").wait_for()
        hold(page)
        wait(lambda: self.witness.speed_m_s > FOLLOWING_M_S or self.witness.stopped, "the arm does not follow the hand")
        if self.witness.stopped:
            raise SceneFailed(TOO_EARLY)

    def leave(self) -> None:
        """Take the hands off, and let the stop come to its end."""
        self.browser.thaw()
        if self._page is not None and not self._page.is_closed():
            for key in (JOG, CLUTCH):
                self._page.keyboard.up(key)

    def take_control(self) -> None:
        """Take control and arm, out of a fault too; a page that was held up may lose control again."""

        def armed() -> bool:
            status = self.stack.client.get("/api/status").raise_for_status().json()
            with contextlib.suppress(SoakFailed):  # what is not possible yet is asked for again
                if status["holder"] is None:
                    self.stack.post("take", operator=OPERATOR)
                if status["phase"] == "fault":
                    self.stack.post("recover")
                self.stack.post("arm")
                return True
            return False

        wait(armed, "the arms are not armed")

    @property
    def active(self) -> bool:
        """Whether a job runs, or begins to."""
        job = self.stack.client.get("/api/status").raise_for_status().json()["job"]
        return job is not None and job["state"] not in _ENDED

    def close(self) -> list[str]:
        """Close the page, end the stack; return who or what was left behind."""
        self.browser.thaw()
        if self._page is not None and not self._page.is_closed():
            self._page.close()
        self.witness.close()
        trouble = self.stack.end()
        self.rings.close()
        return trouble


def wait(reached, what: str) -> None:
    """Wait until `reached()`. Raises SceneFailed."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not reached():
        if time.monotonic() > deadline_s:
            raise SceneFailed(what)
        time.sleep(0.02)
