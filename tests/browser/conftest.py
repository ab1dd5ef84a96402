"""A real stack, and a real Chromium that signs in by the address that it printed. Without Chromium: an error."""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

from rtstack.live.client import RUN_PREFIX, SOCKET_NAME, RobotClient
from tests.support.console.chromium import ARGUMENTS, CHROMIUM

ARM_PATIENCE_S = 120.0
JOB_TIMEOUT_MS = 120_000  # software rendering beside it makes a paced run several times slower

expect.set_options(timeout=60_000)  # software rendering beside it makes every answer late

MAY_BE_LATE = ("/api/take", "/api/arm")  # the lease of a page that is held up ends between its view and the click

COMMAND = Path(sys.executable).with_name("rtstack")


@pytest.fixture(scope="module")
def temporary() -> Iterator[Path]:
    """Where the stack of this module has its socket: among its temporary files."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:  # short: a socket's path has 107 letters at most
        yield Path(name)


@pytest.fixture(scope="module")
def logs_of_stack(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the stack of this module keeps its logs; one with FINDS_DEMONSTRATION begins with a demonstration there."""
    logs = tmp_path_factory.mktemp("stack") / "logs"
    if getattr(request.module, "FINDS_DEMONSTRATION", False):
        logs.mkdir()
        shutil.copy(request.getfixturevalue("demonstration").path, logs / "demonstration.mcap")
    return logs


@pytest.fixture(scope="module")
def stack_options() -> tuple[str, ...]:
    """More options of `rtstack up`; a module with another cell has its own."""
    return ()


@pytest.fixture(scope="module")
def printed_address(logs_of_stack: Path, temporary: Path, stack_options: tuple[str, ...]) -> Iterator[str]:
    """Run a stack; give the address that it printed."""
    process = subprocess.Popen(
        [str(COMMAND), "up", "--port", "0", "--logs", str(logs_of_stack), *stack_options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary), "XDG_CONFIG_HOME": str(temporary / "config")},
    )
    assert process.stdout is not None
    yield process.stdout.readline().removeprefix("rtstack is up: ").strip()
    process.terminate()
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Start Chromium. A missing browser is an error, never a skip."""
    assert Path(CHROMIUM).exists(), f"{CHROMIUM} is missing: install Debian's package chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


class Console:
    """A signed-in page, and what went wrong in it."""

    def __init__(self, page: Page, address: str) -> None:
        self.page = page
        self.address = address
        self.errors: list[str] = []
        self.requests: list[str] = []
        page.set_default_timeout(JOB_TIMEOUT_MS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._printed)
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(address)

    def _printed(self, message: ConsoleMessage) -> None:
        url = message.location["url"]  # says which request was refused
        if message.type != "error" or ("409" in message.text and url.endswith(MAY_BE_LATE)):
            return
        self.errors.append(f"{message.text} {url}".strip())

    def arm(self) -> None:
        """Take control and arm, where that has not been done."""
        phase = self.page.locator("#control-light")
        expect(phase).not_to_have_attribute("data-phase", "unknown")
        end_s = time.monotonic() + ARM_PATIENCE_S
        while phase.get_attribute("data-phase") != "armed":  # a page that was held up may lose control again
            if time.monotonic() > end_s:
                line, refused = (self.page.locator(id).inner_text() for id in ("#control-line", "#errors"))
                pytest.fail(f"not armed within {ARM_PATIENCE_S:g} s; the page says: {line} {refused}")
            for button in ("#take", "#arm"):
                if self.page.locator(button).is_enabled():
                    self.page.locator(button).click(force=True)
            self.page.wait_for_timeout(200)
        self.put_down()

    def put_down(self) -> None:
        """Put down what both pads hold after a run that was stopped, on the page that has a button for it."""
        button, held = self.page.locator("[data-motion=put_down]"), self.page.locator("#held")
        if held.is_visible() and button.count():
            button.click()
            expect(self.page.locator("#job-line")).to_contain_text("succeeded", timeout=JOB_TIMEOUT_MS)
            expect(held).to_be_hidden()

    def record(self) -> None:
        """Record the scripted demonstration."""
        self.page.click("#tab-demonstration")
        self.arm()
        rows = self.page.locator("#logs tbody tr").count()
        self.page.click("#demonstration button[type=submit]")
        expect(self.page.locator("#job-line")).to_contain_text("succeeded", timeout=JOB_TIMEOUT_MS)
        expect(self.page.locator("#logs tbody tr")).to_have_count(rows + 1, timeout=60_000)

    def start_trial(self, controller: str, displacement_mm: str) -> None:
        """Start a trial and wait until it runs."""
        self.page.click("#tab-trial")
        self.arm()
        self.page.select_option("#trial select[name=controller]", controller)
        self.page.fill("#trial input[name=displacement_mm]", displacement_mm)
        self.page.click("#trial button[type=submit]")
        expect(self.page.locator("#job-line")).to_contain_text(") runs.", timeout=JOB_TIMEOUT_MS)


@pytest.fixture(scope="module")
def console(browser: Browser, printed_address: str) -> Iterator[Console]:
    """Sign in by the printed address."""
    context = browser.new_context(
        viewport={"width": 1440, "height": 900},
        color_scheme="dark",
        accept_downloads=True,
        base_url=printed_address.split("?")[0],
    )
    yield Console(context.new_page(), printed_address)
    context.close()


class Program:
    """A program that speaks with the robot process itself, as ben, and gives signs of life until it goes."""

    def __init__(self, socket: Path) -> None:
        self.robot = RobotClient(socket)
        self._gone = threading.Event()
        self._thread = threading.Thread(target=self._beat)
        self._thread.start()

    def _beat(self) -> None:
        while not self._gone.wait(0.1):
            self.robot.beat("ben")

    def go(self) -> None:
        """Give no sign of life any more."""
        self._gone.set()
        self._thread.join()


@pytest.fixture
def program(console: Console, temporary: Path) -> Iterator[Program]:
    """Give a program; it has gone after the test."""
    (socket,) = temporary.glob(f"{RUN_PREFIX}*/{SOCKET_NAME}")
    program = Program(socket)
    yield program
    program.go()
    program.robot.close()


@pytest.fixture(scope="module")
def stage(browser: Browser, demonstration: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A console on a stage, without arms."""
    from tests.support.console.stage import on_stage

    with on_stage(browser, demonstration, tmp_path_factory.mktemp("stage") / "logs") as stage:
        yield stage


@pytest.fixture(scope="module")
def recorded(console: Console) -> Console:
    """Give the page with a recording in its list."""
    console.record()
    return console
