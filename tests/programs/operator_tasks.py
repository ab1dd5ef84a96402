"""Tasks of an operator at the console, in Chromium, as a person does them: how long each takes, and how many clicks.

Starts `rtstack up` with the simulated cell and a folder of logs of its own, and goes through a working day: from the
address to the first grab and its review, by hand, trials, comparison, logs, recordings, plans, campaigns, training,
a second operator, a network that is cut, a console that is started again. A click is one of the mouse or one key that
is not typed into a field; waiting counts into the time. A task that fails is named with its reason; the rest goes on.
`--red` also counts what is shown in red. Exit status 1 where a task failed.

Takes ten minutes on a quiet machine.
"""

import os
import re
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from playwright.sync_api import Browser, BrowserContext, Error, Page, expect, sync_playwright
from rich.console import Console
from rich.table import Table

from tests.programs import program
from tests.support.console.chromium import ARGUMENTS, CHROMIUM
from tests.support.console.stack import Stack

JOB_MS = 240_000
KEYS_S = 1.0


class Hand:
    """One operator's page, with the clicks counted."""

    def __init__(self, page: Page, base: str) -> None:
        self.page, self.base, self.clicks = page, base, 0

    def click(self, what: str) -> None:
        """Click on the element of a selector."""
        self.clicks += 1
        self.page.click(what)

    def press(self, key: str) -> None:
        """Press a key."""
        self.clicks += 1
        self.page.keyboard.press(key)

    def type(self, what: str, text: str) -> None:
        """Replace the text of a field: one click, and typing."""
        self.clicks += 1
        self.page.fill(what, text)

    def see(self, what: str, text: str | re.Pattern[str] = "", timeout: float = JOB_MS) -> None:
        """Wait until an element is there, with a text."""
        place = self.page.locator(what).first
        expect(place).to_be_visible(timeout=timeout)
        if text:
            expect(place).to_contain_text(text, timeout=timeout)

    def ended(self, what: str) -> None:
        """Wait until the job's line says that it is done."""
        self.see("#job-line", re.compile(what), JOB_MS)

    def ready(self) -> None:
        """Press what the card names as the next step until motion is allowed."""
        while not self.page.locator("#disarm").is_visible():
            step = self.page.locator("#take.next, #arm.next, #recover.next")
            if step.count() and step.first.is_enabled():
                self.clicks += 1
                step.first.click()
            self.page.wait_for_timeout(200)


Task = Callable[[Hand, "Day"], None]


class Day:
    """What the tasks share: the stack, the browser, and the tasks in order."""

    tasks: tuple[tuple[str, Task], ...] = ()

    def __init__(self, stack: Stack, browser: Browser) -> None:
        self.stack, self.browser = stack, browser
        self.context: BrowserContext = browser.new_context(base_url=stack.base, viewport={"width": 1280, "height": 720})

    def logs(self) -> list[dict]:
        """Return the rows of the logs, newest first."""
        return self.stack.client.get("/api/logs").raise_for_status().json()

    def other(self, scope: str) -> tuple[BrowserContext, Page]:
        """Return a page of another browser, signed in by an invitation."""
        token = self.stack.post("invitations", scope=scope)["address"].rpartition("token=")[2]
        context = self.browser.new_context(base_url=self.stack.base, viewport={"width": 1280, "height": 720})
        page = context.new_page()
        page.goto(f"/?token={token}")
        return context, page


def task(name: str) -> Callable[[Task], Task]:
    """Add a task to the day, by its name in the table."""

    def add(act: Task) -> Task:
        Day.tasks += ((name, act),)
        return act

    return add


@task("first page, with its scene")
def first_page(hand: Hand, day: Day) -> None:
    hand.page.goto("/")
    hand.see("#take")
    expect(hand.page.locator("#control-light")).not_to_have_attribute("data-state", "waiting", timeout=JOB_MS)


@task("take control, arm")
def take_control(hand: Hand, day: Day) -> None:
    hand.click("#take")
    hand.click("#arm")
    hand.see("#control-light .word", re.compile("armed", re.IGNORECASE))


@task("first demonstration")
def demonstration(hand: Hand, day: Day) -> None:
    hand.click("#tab-demonstration")
    hand.click("#demonstration [type=submit]")
    hand.ended("succeeded")


@task("first grab that follows it")
def first_grab(hand: Hand, day: Day) -> None:
    hand.click("#tab-trial")
    hand.click("#trial [type=submit]")
    hand.see("#trial-card", re.compile("success", re.IGNORECASE))


@task("first review: its first curve")
def first_review(hand: Hand, day: Day) -> None:
    hand.click("#card-open")
    hand.see("#legends", re.compile("force"))


@task("read the whole log")
def whole_log(hand: Hand, day: Day) -> None:
    expect(hand.page.locator("#reading")).to_be_hidden(timeout=JOB_MS)


@task("back by the browser, forward, reload")
def history(hand: Hand, day: Day) -> None:
    address = hand.page.url
    hand.page.go_back()
    hand.see("#take")
    hand.page.go_forward()
    hand.page.reload()
    hand.clicks += 3
    hand.see("#legends", re.compile("force"))
    assert hand.page.url.split("?")[0] == address.split("?")[0]


@task("preview of a trial")
def preview(hand: Hand, day: Day) -> None:
    hand.page.goto("/#tab-trial")
    expect(hand.page.locator("#preview")).to_be_enabled(timeout=JOB_MS)
    hand.click("#preview")
    hand.see("#preview-line", re.compile("would"))


@task("trial at -30 mm")
def trial(hand: Hand, day: Day) -> None:
    hand.type("#trial [name=displacement_mm]", "-30")
    hand.click("#trial [type=submit]")
    hand.see("#card-what", "-30 mm")


@task("a number that is typed with a comma")
def comma(hand: Hand, day: Day) -> None:
    field = hand.page.locator("#trial [name=displacement_mm]")
    field.fill("")
    field.press_sequentially("-12,5")
    hand.clicks += 1
    hand.click("#trial [type=submit]")
    hand.see("#card-what", re.compile("-12[.,]5 mm"))


@task("compare with the last trial")
def compare_last(hand: Hand, day: Day) -> None:
    hand.click("#card-compare")
    hand.see("#overlays", re.compile("mm"))
    expect(hand.page.locator("#reading")).to_be_hidden(timeout=JOB_MS)


@task("x-y plot")
def across(hand: Hand, day: Day) -> None:
    choice = hand.page.locator("#across")
    value = choice.locator("option").nth(1).get_attribute("value")
    hand.clicks += 2
    choice.select_option(value)
    expect(hand.page).to_have_url(re.compile("[?&]x="))
    choice.select_option("")


@task("note at the cursor")
def note(hand: Hand, day: Day) -> None:
    hand.click("#note")
    hand.page.fill("#note-text", "late here")
    hand.press("Enter")
    hand.see("#log-events", "late here")


@task("export: PDF, SVG, PNG, CSV")
def exports(hand: Hand, day: Day) -> None:
    for form in ("pdf", "svg", "png", "csv"):
        if not hand.page.locator(f"#{form}").is_visible():
            hand.click("#export > summary")
        with hand.page.expect_download(timeout=JOB_MS):
            hand.click(f"#{form}")


@task("sweep: 3 shifts, 3 controllers, started")
def sweep(hand: Hand, day: Day) -> None:
    hand.page.goto("/trials")
    hand.type("#trial [name=displacements_mm]", "-20:20:20")
    for name in ("no_interim", "no_reference_spreading"):
        hand.click(f"#trial [name=controllers][value={name}]")
    hand.click("#trial [type=submit]")
    hand.see("#queue", re.compile("waiting"))
    hand.click("#queue-start")
    hand.see("#queue", re.compile("running"))


@task("sweep: all nine trials")
def swept(hand: Hand, day: Day) -> None:
    expect(hand.page.locator("#queue-state")).to_have_attribute("data-running", "false", timeout=4 * JOB_MS)


@task("means of the sweep")
def means(hand: Hand, day: Day) -> None:
    hand.click("#tab-means")
    hand.see("#means-table", re.compile("proposed"))


@task("find a log")
def find(hand: Hand, day: Day) -> None:
    hand.click(".rail a[href='/logs']")
    hand.type("#query", "trial shift>10")
    hand.see("#count", re.compile(r"[1-9]\d* log"))


@task("compare three logs")
def compare_three(hand: Hand, day: Day) -> None:
    for row in range(3):
        hand.clicks += 1
        hand.page.locator("#logs tbody input[type=checkbox]").nth(row).click()
    hand.click("#compare")
    expect(hand.page.locator("#overlays > *")).to_have_count(2, timeout=JOB_MS)
    expect(hand.page.locator("#reading")).to_be_hidden(timeout=JOB_MS)


@task("tag two logs")
def tag(hand: Hand, day: Day) -> None:
    hand.page.goto("/logs")
    hand.see("#logs tbody tr")
    for row in range(2):
        hand.clicks += 1
        hand.page.locator("#logs tbody input[type=checkbox]").nth(row).click()
    hand.click("#describe")
    hand.page.fill("#tags", "good")
    hand.click("#remarks [type=submit]")
    hand.see("#logs tbody", "good")


@task("delete two logs")
def delete(hand: Hand, day: Day) -> None:
    hand.page.goto("/logs?query=unexpected")
    hand.page.goto("/logs")
    hand.see("#logs tbody tr")
    for row in range(2):
        hand.clicks += 1
        hand.page.locator("#logs tbody input[type=checkbox]").nth(row).click()
    hand.click("#delete")
    hand.see("#trash")


@task("undo it")
def undo(hand: Hand, day: Day) -> None:
    hand.click("#undo")
    expect(hand.page.locator("#trash")).to_be_hidden(timeout=JOB_MS)


@task("by hand with keys: recording is ready")
def by_hand(hand: Hand, day: Day) -> None:
    hand.page.goto("/#tab-hand")
    expect(hand.page.locator("#record")).to_be_enabled(timeout=JOB_MS)
    hand.page.locator("input[name=release][value=hold]").evaluate("(e) => e.parentElement.click()")
    hand.click("#record")
    hand.see("#finish")


@task("by hand with keys: squeeze and lift")
def keys(hand: Hand, day: Day) -> None:
    hand.press("2")  # mirrored
    hand.page.keyboard.down("c")
    for key, seconds in (("d", 2.5), ("e", KEYS_S)):
        hand.clicks += 1
        hand.page.keyboard.down(key)
        hand.page.wait_for_timeout(1000 * seconds)
        hand.page.keyboard.up(key)
    hand.page.keyboard.up("c")


@task("finish the recording")
def finish(hand: Hand, day: Day) -> None:
    hand.click("#finish")
    hand.see("#episode-outcome")


@task("discard it by one key")
def outcome(hand: Hand, day: Day) -> None:
    hand.press("x")
    expect(hand.page.locator("[data-outcome=discard]")).to_have_attribute("aria-pressed", "true", timeout=JOB_MS)


@task("put it down, go to start")
def moves(hand: Hand, day: Day) -> None:
    for motion in ("put_down", "start"):
        button = hand.page.locator(f"[data-motion={motion}]")
        if motion == "put_down" and button.is_disabled():
            continue  # nothing is held
        expect(button).to_be_enabled(timeout=JOB_MS)
        before = hand.page.locator("#job-line").inner_text()
        hand.click(f"[data-motion={motion}]")
        expect(hand.page.locator("#job-line")).not_to_have_text(before, timeout=JOB_MS)
        hand.ended("Motion.*succeeded")


@task("references of a recording")
def references(hand: Hand, day: Day) -> None:
    log = day.stack.log_id(next(row["name"] for row in day.logs() if row["kind"] == "demonstration"))
    hand.page.goto(f"/recordings/{log}")
    hand.clicks += 1
    expect(hand.page.locator("#extracted")).to_be_hidden(timeout=JOB_MS)
    hand.see("#verdict", re.compile("accept|reference|impact", re.IGNORECASE))


@task("play it on the arms, STOP by the space bar")
def playback(hand: Hand, day: Day) -> None:
    hand.click("summary:has-text('Play')")
    expect(hand.page.locator("#arms-play")).to_be_enabled(timeout=JOB_MS)
    hand.click("#arms-play")
    if hand.page.locator("dialog[open] button.act").count():
        hand.click("dialog[open] button.act")
    expect(hand.page.locator("#control-light")).to_have_attribute("data-state", re.compile("moving"), timeout=JOB_MS)
    hand.press("Space")
    expect(hand.page.locator("#control-light")).not_to_have_attribute("data-state", "moving", timeout=JOB_MS)


@task("plan a grab, use it as a reference")
def plan(hand: Hand, day: Day) -> None:
    hand.page.goto("/#tab-plan")
    hand.click("#plan [type=submit]")
    expect(hand.page.locator("#plan-use")).to_be_enabled(timeout=JOB_MS)
    hand.click("#plan-use")
    hand.see("#trial")


@task("training: a fault comes, recover")
def training(hand: Hand, day: Day) -> None:
    hand.page.goto("/#tab-training")
    hand.ready()
    hand.click("#training [type=submit]")
    expect(hand.page.locator("#recover")).to_be_enabled(timeout=JOB_MS)
    hand.click("#recover")
    hand.see("#exercise-verdict", re.compile("."))


@task("campaign: start a small sample")
def campaign(hand: Hand, day: Day) -> None:
    hand.page.goto("/campaigns")
    hand.see("main")
    hand.page.locator("main form [type=submit]").first.click()
    hand.clicks += 1
    hand.see("#campaigns, .campaign", re.compile("."))


@task("invite a viewer")
def viewer(hand: Hand, day: Day) -> None:
    hand.page.goto("/access")
    hand.click("#invite [type=submit]")
    hand.see("#invited", re.compile("token="))


@task("another operator asks, control is handed over")
def hand_over(hand: Hand, day: Day) -> None:
    hand.page.goto("/")
    hand.see("#take, #release")
    context, page = day.other("operate")
    page.locator("#take").click(timeout=JOB_MS)
    hand.click("#errors button:has-text('Hand over')")
    expect(page.locator("#holder")).to_contain_text("you", timeout=JOB_MS)
    page.locator("#release").click()
    context.close()
    hand.click("#take")


@task("network cut for 5 s: said, and gone again")
def network(hand: Hand, day: Day) -> None:
    day.context.set_offline(True)
    hand.see("#control-line", re.compile("does not answer"))
    hand.page.wait_for_timeout(5000)
    day.context.set_offline(False)
    expect(hand.page.locator("#control-line")).not_to_contain_text("does not answer", timeout=JOB_MS)


@task("keyboard alone: Tab to Take control, Enter, Arm")
def keyboard(hand: Hand, day: Day) -> None:
    if hand.page.locator("#release").is_visible():
        hand.page.locator("#release").click()
    hand.page.goto("/")
    expect(hand.page.locator("#take")).to_be_enabled(timeout=JOB_MS)
    for wanted in ("take", "arm"):
        for _ in range(20):
            if hand.page.evaluate("document.activeElement.id") == wanted:
                break
            hand.press("Tab")
        hand.press("Enter")
        hand.page.wait_for_timeout(1000)
    hand.see("#control-light .word", re.compile("armed", re.IGNORECASE))


@task("sign out; STOP stays")
def sign_out(hand: Hand, day: Day) -> None:
    hand.page.goto("/access")
    hand.click("#sign-out")
    hand.see("h1", "Not signed in")
    hand.see("#stop")


RED = """() => [...document.querySelectorAll("#errors .error, [data-age=red], #veil:not([hidden])")]
  .filter((each) => each.checkVisibility()).map((each) => each.textContent.trim()).filter(Boolean)"""


def main(only: str = "", red: bool = False) -> int:
    """Go through the day. only: words of the tasks to do besides the first six, else all."""
    console, table, failed = Console(), Table("task", "s", "clicks", "verdict"), 0
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        began_s = time.monotonic()
        robot = Stack(folder / "logs")
        stack.callback(robot.end)
        table.add_row("command to address", f"{time.monotonic() - began_s:.1f}", "1", "")
        browser = stack.enter_context(sync_playwright()).chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        stack.callback(browser.close)
        day = Day(robot, browser)
        day.context.add_cookies([
            {"name": cookie.name, "value": cookie.value or "", "url": robot.base} for cookie in robot.client.cookies.jar
        ])  # fmt: skip
        hand = Hand(day.context.new_page(), robot.base)
        hand.page.set_default_timeout(60_000)
        for number, (name, act) in enumerate(Day.tasks):
            if number >= 6 and only not in name:
                continue
            hand.clicks, began_s = 0, time.monotonic()
            try:
                act(hand, day)
                verdict = "done"
            except (Error, AssertionError, LookupError) as error:
                failed += 1
                verdict = f"FAILED: {str(error).strip().splitlines()[0][:90]}"
                hand.page.screenshot(path=f"{tempfile.gettempdir()}/task-{number:02d}.png")
            if red and (shown := hand.page.evaluate(RED)):
                verdict += f"; red: {shown}"
            took_s = time.monotonic() - began_s
            table.add_row(name, f"{took_s:.1f}", str(hand.clicks), verdict)
            console.print(f"{name}: {took_s:.1f} s, {hand.clicks} clicks, {verdict}", highlight=False)
    console.print(table)
    console.print(f"load {os.getloadavg()[0]:.1f}; failed: {failed}")
    return int(failed > 0)


if __name__ == "__main__":
    program(main)
