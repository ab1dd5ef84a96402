"""A camera's picture on the page Operate, with its age; while it is stale nothing that is asked is applied."""

import re
import signal
from contextlib import contextmanager

import psutil
import pytest
from playwright.sync_api import expect

from rtstack.cells import default_cell_file
from tests.support.console.chromium import READY_MS, leave_scene_undrawn

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(600)]
CAMERA = """
[cameras.front]
kind = "simulated"
position = [1.4, 0.0, 0.5]
orientation_wxyz = [0.5, -0.5, -0.5, 0.5]
width = 192
height = 144
rate_hz = 20.0
"""


@pytest.fixture(scope="module")
def stack_options(tmp_path_factory):
    """A cell with a camera."""
    cell = tmp_path_factory.mktemp("cell") / "seen.toml"
    cell.write_text(default_cell_file().read_text() + CAMERA)
    return "--cell", str(cell)


@contextmanager
def standing_still(cell):
    """Stop the process of the cell's camera, and let it go on."""
    words = (process for process in psutil.process_iter(["cmdline"]) if cell in " ".join(process.info["cmdline"] or ()))
    (camera,) = (process for process in words if "rtstack.cameras.process" in process.info["cmdline"])
    camera.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        camera.send_signal(signal.SIGCONT)


def test_nothing_is_applied_that_was_asked_on_a_stale_picture(console, stack_options):
    page = console.page
    leave_scene_undrawn(page)
    page.goto("/")
    expect(page.locator("#camera")).to_be_hidden()
    page.select_option("#camera-name", "front")
    expect(page.locator("#camera")).to_contain_text("no picture yet")
    page.click("#tab-hand")
    console.arm()
    page.check("input[name=release][value=hold]", force=True)
    page.click("#practise")
    expect(page.locator("#clutch")).to_have_attribute("data-state", "ready", timeout=READY_MS)
    expect(page.locator("#camera figcaption")).to_have_text(re.compile(r"^front \d+ ms$"))
    assert page.evaluate("document.querySelector('#camera canvas').width") == 192
    page.keyboard.down("c")
    line = page.locator("#hand-line")
    expect(line).to_contain_text("The arms follow")
    with standing_still(stack_options[1]):
        expect(page.locator("#camera")).to_have_attribute("data-stale", "true")
        expect(page.locator("#camera figcaption")).to_contain_text("nothing is applied")
        expect(line).to_contain_text("it was made on a picture")
        expect(page.locator("#clutch")).to_have_attribute("data-state", "held")  # it is a sign of life all the same
    expect(page.locator("#camera")).to_have_attribute("data-stale", "false")
    expect(line).to_contain_text("The arms follow")
    page.keyboard.up("c")
    page.click("#finish")
    expect(page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
