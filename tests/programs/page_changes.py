"""Control of the robot while pages change, reload and sleep: whether its operator keeps it, and a queue goes on.

Starts `rtstack up` with the simulated cell and a real Chromium whose operator takes control, records a demonstration
and starts a queue. Then, again and again: another page by its link, a reload, and a tab that the browser freezes for
longer than a lease lasts. `--busy` processes compute meanwhile. Counted is how often control was lost (the audit
trail), and how often the queue stopped and why. Exit status 1 where control was lost.

Takes an hour with 200 of each and six burners on two cores.
"""

import json
import multiprocessing
import os
import random
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, expect, sync_playwright

from rtstack.safety.arming import LEASE_S
from tests.programs import program
from tests.support.console.chromium import ARGUMENTS, CHROMIUM
from tests.support.console.stack import SoakFailed, Stack

PAGES = ("Trials", "Logs", "Campaigns", "Operate")
SLEEP_S = 1.5 * LEASE_S
PATIENCE_MS = 120_000


def burn() -> None:
    """Compute for ever, at the priority of an ordinary program."""
    while True:
        sum(range(100_000))


@contextmanager
def burners(count: int) -> Iterator[None]:
    """Have processes compute while the block runs."""
    started = [multiprocessing.Process(target=burn, daemon=True) for _ in range(count)]
    for process in started:
        process.start()
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.join()


class Operator:
    """An operator's page at a stack, and a queue that this operator has started."""

    def __init__(self, stack: Stack, page: Page) -> None:
        self.stack, self.page = stack, page
        self.stopped: Counter[str] = Counter()  # reasons of a queue that was found paused
        self._cdp = page.context.new_cdp_session(page)
        page.goto("/")
        self._shown()
        self._go_on()
        name = stack.run("jobs/demonstration", object="rice_box")
        self._reference = stack.log_id(name)

    def _shown(self) -> None:
        light = self.page.locator("#control-light")
        expect(light).not_to_have_attribute("data-state", "waiting", timeout=PATIENCE_MS)

    def _go_on(self) -> None:
        """Take control, recover and arm where that is needed."""
        status = self.stack.client.get("/api/status").raise_for_status().json()
        if status["holder"] is None:
            self.stack.post("take")
        if status["phase"] == "fault":
            self.stack.post("recover")
            while self.stack.client.get("/api/status").json()["phase"] == "recovering":
                time.sleep(0.1)
        if not (status["job"] and status["job"]["state"] in ("starting", "running", "stopping")):
            self.stack.post("arm")

    def keep_queue(self) -> None:
        """Start the queue where it is paused, with more trials where it has none."""
        view = self.stack.client.get("/api/queue").raise_for_status().json()
        if view["operator"] is not None and view["entries"]:
            return
        if view["entries"] and view["reason"]:
            self.stopped[view["reason"]] += 1
        self._go_on()
        if not any(one["state"] == "waiting" for one in view["entries"]):
            self.stack.post("queue/clear", finished_only=True)
            self.stack.post("queue", trial={"reference": self._reference, "object": "rice_box"}, repetitions=200)
        self.stack.post("queue/start", past_failures=True)

    def change(self, turn: int) -> None:
        """Go to the next page by its link."""
        self.page.get_by_role("link", name=PAGES[turn % len(PAGES)], exact=True).first.click()
        self._shown()

    def reload(self, _: int) -> None:
        """Reload the page."""
        self.page.reload(wait_until="commit")
        self._shown()

    def sleep(self, _: int) -> None:
        """Let the browser freeze the tab, for longer than a lease."""
        self._cdp.send("Page.setWebLifecycleState", {"state": "frozen"})
        time.sleep(SLEEP_S)
        self._cdp.send("Page.setWebLifecycleState", {"state": "active"})

    def losses(self) -> int:
        """Return how often an operator lost control for want of signs of life."""
        lines = (self.stack.logs / "audit.jsonl").read_text().splitlines()
        return sum(json.loads(line)["action"] == "lost" for line in lines)


def repeat(operator: Operator, act: Callable[[int], None], count: int) -> int:
    """Do one of them `count` times; print and return how often control was lost."""
    name, before, took_s, loads = act.__name__, operator.losses(), [], []
    for turn in range(count):
        try:
            operator.keep_queue()
        except SoakFailed as error:  # a machine that is this busy: it is asked again in the next turn
            operator.stopped[str(error)] += 1
        began_s = time.monotonic()
        act(turn)
        took_s.append(time.monotonic() - began_s)
        loads.append(os.getloadavg()[0])
        time.sleep(random.uniform(0.0, 1.0))
        if turn % 20 == 19:
            print(f"  {name}: {turn + 1} of {count}, lost {operator.losses() - before}", flush=True)
    lost = operator.losses() - before
    print(
        f"{name}: {count}, control lost {lost} times; each {statistics.median(took_s):.1f} s at the median, "
        f"{max(took_s):.1f} s at most; load {statistics.median(loads):.1f}", flush=True,
    )  # fmt: skip
    return lost


def main(count: int = 200, busy: int = 6, seed: int = 1) -> int:
    """Run all three."""
    random.seed(seed)
    lost = 0
    with ExitStack() as stack, TemporaryDirectory() as folder:
        robot = Stack(Path(folder) / "logs")
        stack.callback(robot.end)
        browser = stack.enter_context(sync_playwright()).chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        stack.callback(browser.close)
        context = browser.new_context(base_url=robot.base, viewport={"width": 1280, "height": 720})
        context.add_cookies([
            {"name": cookie.name, "value": cookie.value or "", "url": robot.base} for cookie in robot.client.cookies.jar
        ])  # fmt: skip
        context.set_default_timeout(PATIENCE_MS)
        operator = Operator(robot, context.new_page())
        with burners(busy):
            for act in (operator.change, operator.reload, operator.sleep):
                lost += repeat(operator, act, count)
        done = robot.client.get("/api/logs").raise_for_status().json()
        trials = sum(row["kind"] == "trial" for row in done)
        print(f"{trials} trials; the queue stopped: {dict(operator.stopped) or 'never'}")
    return int(lost > 0)


if __name__ == "__main__":
    program(main)
