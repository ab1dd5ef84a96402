"""An emulated headset in a real Chromium: two controllers lead both pads, and whatever lets go stops them."""

import numpy as np
import pytest
from playwright.sync_api import expect

from rtstack.log.reader import read_log
from rtstack.samples import SIDES, Mode
from rtstack.topics import HAND_TOPIC
from tests.support.console.headset import READY_MS, REST, Person, emulate, emulator, minimum_jerk

RAISED_M = 0.06
UP = ((1.5, (0.0, RAISED_M, 0.0)), (1.0, (0.0, RAISED_M, 0.0)))
pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def emulated(console, tmp_path_factory):
    """A console whose pages find a headset."""
    emulate(console.page, emulator(tmp_path_factory.mktemp("iwer")))
    return console


@pytest.fixture
def person(emulated):
    """Somebody with the headset on, found from the page Operate; armed."""
    page = emulated.page
    page.goto("/")
    page.click("#tab-hand")
    page.click("text=Headset: two hands")
    expect(page.locator("#enter")).to_be_enabled()
    emulated.arm()
    person = Person(page)
    person.put_on()
    yield person
    person.page.reload()


def newest(logs):
    return read_log(max(logs.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns))


def test_two_controllers_lead_both_pads_and_letting_go_holds_them(person, logs_of_stack):
    person.press("right", "a-button")
    person.sees("hold a grip to lead")
    for side in SIDES:
        person.grip(side, True)
    person.sees("leading")
    person.play(minimum_jerk(moves=UP))
    for side in SIDES:
        person.grip(side, False)
    person.sees("hold a grip to lead")
    person.place("left", REST["left"])  # without the grip: nothing follows
    person.press("right", "a-button")
    expect(person.page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
    log = newest(logs_of_stack)
    for side in SIDES:
        control = log.topic(f"/{side}/control")
        moving = control[control["mode"] == Mode.TELEOPERATION]
        assert np.ptp(moving["pose_ref"][:, 2]) == pytest.approx(RAISED_M, abs=5e-3)
        assert np.ptp(moving["pose_ref"][:, :2], axis=0).max() < 2e-3
    hand = log.topic(HAND_TOPIC)
    assert (np.diff(hand["sequence"]) > 0).all()
    assert (hand["made_us"] >= hand["came_us"]).all()
    assert (hand["picture_us"] > hand["seen_us"]).all()


@pytest.mark.parametrize("how", ["upper button", "controller off", "controller unseen", "headset off", "page left"])
def test_whatever_ends_it_stops_the_arms(person, how, logs_of_stack):
    page = person.page
    person.press("right", "a-button")
    person.sees("hold a grip to lead")
    person.grip("left", True)
    person.sees("leading")
    expect(page.locator("#latency")).to_contain_text("Hand to torque")  # the arms have got a command
    if how == "upper button":
        person.press("right", "b-button")
    elif how == "controller off":
        page.evaluate("xr.controllers.left.connected = false")
    elif how == "controller unseen":
        page.evaluate("window.unseen = true")
    elif how == "headset off":
        page.evaluate("xr.updateVisibilityState('hidden')")
    else:
        page.goto("/logs")
        page.goto("/headset")
    stopped = how == "upper button"
    expect(page.locator("#job-line")).to_contain_text(
        "stopped" if stopped else "ended without success: the operator let go", timeout=READY_MS
    )
    said = [event.text for event in newest(logs_of_stack).events if event.name == "watchdog"]
    assert said == ([] if stopped else ["the operator let go: the page lost the operator's hand"])


def test_one_hand_leads_both_pads_as_in_a_mirror(person, logs_of_stack):
    person.press("left", "x-button")
    person.press("right", "a-button")
    person.sees("hold a grip to lead")
    person.grip("left", True)
    person.sees("leading")
    person.play(minimum_jerk(moves=((1.5, (0.05, 0.0, 0.0)), (1.0, (0.05, 0.0, 0.0)))))
    person.grip("left", False)
    person.press("left", "x-button")
    person.press("right", "a-button")
    expect(person.page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
    log = newest(logs_of_stack)
    for side, inwards in zip(SIDES, (-1.0, 1.0), strict=True):
        y = log.topic(f"/{side}/control")["pose_ref"][:, 1]
        assert y[-1] - y[0] == pytest.approx(inwards * 0.05, abs=5e-3)
