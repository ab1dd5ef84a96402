"""A real stack, and a real Chromium that signs in by the address that it printed. Without Chromium: an error."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

CHROMIUM = "/usr/bin/chromium"  # Debian's
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--disable-background-networking",
]
JOB_TIMEOUT_MS = 120_000  # software rendering beside it makes a paced run several times slower

COMMAND = Path(sys.executable).with_name("rtstack")


@pytest.fixture(scope="module")
def printed_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Run a stack; give the address that it printed."""
    logs = tmp_path_factory.mktemp("stack") / "logs"
    process = subprocess.Popen(
        [str(COMMAND), "up", "--port", "0", "--logs", str(logs)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
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
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(address)

    def record(self) -> None:
        """Record the scripted demonstration."""
        rows = self.page.locator("#logs tbody tr").count()
        self.page.click("#demonstration button[type=submit]")
        expect(self.page.locator("#job-line")).to_contain_text("succeeded", timeout=JOB_TIMEOUT_MS)
        expect(self.page.locator("#logs tbody tr")).to_have_count(rows + 1, timeout=10_000)

    def start_trial(self, controller: str, displacement_mm: str) -> None:
        """Start a trial and wait until it runs."""
        self.page.select_option("#trial select[name=controller]", controller)
        self.page.fill("#trial input[name=displacement_mm]", displacement_mm)
        self.page.click("#trial button[type=submit]")
        expect(self.page.locator("#job-line")).to_contain_text("runs", timeout=JOB_TIMEOUT_MS)


@pytest.fixture(scope="module")
def console(browser: Browser, printed_address: str) -> Iterator[Console]:
    """Sign in by the printed address."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="dark", accept_downloads=True)
    yield Console(context.new_page(), printed_address)
    context.close()


@pytest.fixture(scope="module")
def recorded(console: Console) -> Console:
    """Give the page with a recording in its list."""
    console.record()
    return console
