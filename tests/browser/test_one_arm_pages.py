"""A cell with one arm in a real browser: no page has a word or a control of the other one, and it is led by hand."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.support.console.chromium import NODES, in_scene
from tests.support.console.operate_page import choose_tab
from tests.support.one_arm import one_arm_file

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.timeout(900)]
COMMAND = Path(sys.executable).with_name("rtstack")
WIDTH, HEIGHT = 1280, 800
OTHER = re.compile(r"\bright arm\b|\bboth (arms|pads)\b|\bother arm\b|\btwo arms\b|right\.", re.IGNORECASE)
SHOWN = """() => [document.body.innerText, ...[...document.querySelectorAll('[title], [aria-label], option')]
  .filter((each) => each.checkVisibility()).flatMap((each) => [each.title, each.ariaLabel, each.text])]
  .filter(Boolean).join('\\n')"""


@pytest.fixture(scope="module")
def cell_file(tmp_path_factory):
    return one_arm_file(tmp_path_factory.mktemp("cell"), "left")


@pytest.fixture(scope="module")
def logs_of_stack(tmp_path_factory, cell_file):
    """The folder of logs, with one of this arm."""
    logs = tmp_path_factory.mktemp("stack") / "logs"
    logs.mkdir()
    subprocess.run([str(COMMAND), "excite", str(logs / "excite.mcap"), "--cell-file", str(cell_file)], check=True)
    return logs


@pytest.fixture(scope="module")
def stack_options(cell_file):
    return ("--cell-file", str(cell_file))


@pytest.fixture
def page(console):
    console.page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    return console.page


def nothing_of_the_other(page):
    """The page shows this arm, and no word and no control of the other one."""
    text = page.evaluate(SHOWN)
    assert not (found := OTHER.findall(text)), (found, text)
    assert page.locator("#light-left").is_visible()
    assert page.locator("#light-right").count() == 0


def nodes(page):
    """The paths in the scene, once the arm is there."""
    return in_scene(page, NODES, lambda found: any(path.startswith("/left/") for path in found))


def test_operate_shows_this_arm_alone(page):
    page.goto("/")
    expect(page.locator("#light-left .word")).to_have_text("idle")
    expect(page.locator("#force-value")).to_have_text(re.compile(r"^\d+ N$"))
    nothing_of_the_other(page)
    found = nodes(page)
    assert {"/grip/left", "/force/left"} <= set(found)
    assert not [path for path in found if "right" in path]
    choose_tab(page, "calibration")
    nothing_of_the_other(page)
    page.click("#tab-hand")


def test_the_help_names_no_key_for_two_arms(page):
    page.goto("/")
    page.keyboard.press("?")
    expect(page.locator("#help")).to_contain_text("STOP the arm,")
    nothing_of_the_other(page)
    page.keyboard.press("Escape")


@pytest.mark.long
def test_it_is_led_by_hand_and_stopped(console, page):
    page.goto("/")
    console.arm()
    page.click("#practise")
    clutch = page.locator("#clutch")
    expect(clutch).to_have_attribute("data-state", "ready", timeout=120_000)
    nothing_of_the_other(page)
    page.keyboard.down("c")
    page.keyboard.down("e")
    expect(clutch).to_have_attribute("data-state", "held")
    page.keyboard.up("e")
    page.keyboard.up("c")
    page.click("#stop")
    expect(page.locator("#job-line")).to_contain_text(re.compile("stopped|ended|fault"))
    nothing_of_the_other(page)


def test_the_log_is_listed_and_reviewed_with_this_arm_alone(page):
    page.goto("/logs")
    expect(page.locator("table tbody tr").first).to_be_visible()
    nothing_of_the_other(page)
    page.get_by_role("link", name=re.compile("^20")).last.click()
    expect(page.locator("#legends")).to_contain_text("pad force", timeout=120_000)
    expect(page.locator("#tree > details.group").first).to_contain_text("left")
    nothing_of_the_other(page)
    assert page.locator("#tree summary", has_text="right").count() == 0
    assert not [path for path in nodes(page) if "right" in path]


def test_the_headset_page_has_one_hand(page):
    page.goto("/headset")
    expect(page.locator("#headset")).to_contain_text("I look")
    nothing_of_the_other(page)


def test_no_script_failed(console):
    assert console.errors == []
