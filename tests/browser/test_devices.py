"""A SpaceMouse and a phone lead a hand on the page Operate, in a real Chromium that is told of them: an emulated HID
device in the place of the real one, and the orientation that the browser itself is made to sense."""

import numpy as np
import pytest
from playwright.sync_api import expect

from rtstack.log.reader import read_log
from rtstack.samples import Mode
from tests.support.console.chromium import READY_MS
from tests.support.console.operate_page import open_settings

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(600)]
LOST = "the operator let go: the page lost the operator's hand"
HALF = 175  # counts: half of a full push
# what WebHID gives of a wired SpaceMouse: translation in report 1, rotation in 2, buttons in 3, little-endian
SPACE_MOUSE = """
const cap = new EventTarget();
Object.assign(cap, { productName: "SpaceMouse Compact", opened: false, collections: [{ usagePage: 1, usage: 8 }] });
cap.open = async () => { cap.opened = true; };
cap.report = (reportId, bytes) => {
  const event = new Event("inputreport");
  cap.dispatchEvent(Object.assign(event, { reportId, data: new DataView(new Uint8Array(bytes).buffer) }));
};
cap.push = (reportId, counts) => cap.report(reportId, [...new Uint8Array(new Int16Array(counts).buffer)]);
const hid = new EventTarget();
hid.getDevices = async () => [];
hid.requestDevice = async ({ filters }) => [cap].filter(() => filters.some(({ usage }) => usage === 8));
window.cap = cap;
window.unplug = () => hid.dispatchEvent(Object.assign(new Event("disconnect"), { device: cap }));
Object.defineProperty(navigator, "hid", { value: hid });
"""


@pytest.fixture(scope="module")
def emulated(console):
    """A console whose page finds an emulated SpaceMouse once it may have it."""
    console.page.add_init_script(SPACE_MOUSE)
    return console


@pytest.fixture
def page(emulated):
    """Practice with the left hand, of which letting go holds the arms."""
    page = emulated.page
    page.goto("/")
    page.click("#tab-hand")
    emulated.arm()
    page.check("input[name=release][value=hold]", force=True)
    open_settings(page)
    page.check("input[name=handles][value=move]", force=True)
    page.click("#record")
    expect(page.locator("#recording")).to_contain_text("REC")
    expect(page.locator("#clutch")).to_have_attribute("data-state", "ready", timeout=READY_MS)
    return page


def newest(logs):
    return read_log(max(logs.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns))


def state(page, name):
    expect(page.locator("#clutch")).to_have_attribute("data-state", name)


def finished(page, logs):
    """Finish; return how each pad was led from the first to the last command, (2, 3) m, and how it was turned."""
    page.click("#finish")
    expect(page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
    log = newest(logs)
    ways, turns = [], []
    for side in ("left", "right"):
        control = log.topic(f"/{side}/control")
        pose = control[control["mode"] == Mode.TELEOPERATION]["pose_ref"]
        ways.append(pose[-1, :3] - pose[0, :3])
        turns.append(2.0 * np.arccos(min(1.0, abs(pose[-1, 3:] @ pose[0, 3:]))))
    return np.array(ways), turns


def test_a_spacemouse_leads_while_its_left_button_is_held(page, logs_of_stack):
    page.click("#spacemouse")
    expect(page.locator("#devices-line")).to_contain_text("SpaceMouse Compact")
    page.evaluate(f"cap.push(1, [0, 0, {-HALF}])")  # pulled up, without the button: nothing moves
    page.wait_for_timeout(500)
    state(page, "ready")
    page.evaluate("cap.push(1, [0, 0, 0])")
    page.evaluate("cap.report(3, [1, 0])")
    state(page, "held")
    page.evaluate(f"cap.push(1, [0, 0, {-HALF}])")
    page.wait_for_timeout(600)
    page.evaluate("cap.push(1, [0, 0, 0])")
    page.evaluate(f"cap.push(2, [0, 0, {HALF}])")  # about the vertical
    page.wait_for_timeout(400)
    page.evaluate("cap.push(2, [0, 0, 0])")
    page.wait_for_timeout(800)
    page.evaluate("cap.report(3, [0, 0])")
    state(page, "ready")
    (left, right), (turned, still) = finished(page, logs_of_stack)
    assert left[2] > 0.02
    assert np.abs(left[:2]).max() < 2e-3
    assert turned > 0.05
    assert np.abs(right).max() < 2e-3
    assert still < 0.01


def test_a_spacemouse_that_is_unplugged_stops_the_arms(page, logs_of_stack):
    page.click("#spacemouse")
    page.evaluate("cap.report(3, [1, 0])")
    state(page, "held")
    page.evaluate("unplug()")
    expect(page.locator("#job-line")).to_contain_text("without success: the operator let go", timeout=READY_MS)
    events = newest(logs_of_stack).events
    assert [event.text for event in events if event.name == "watchdog"] == [LOST]


def test_a_phone_leads_by_how_it_is_tilted_from_where_it_was(page, logs_of_stack):
    sensed = page.context.new_cdp_session(page)

    def tilt(alpha, beta, gamma):
        orientation = {"alpha": alpha, "beta": beta, "gamma": gamma}
        sensed.send("DeviceOrientation.setDeviceOrientationOverride", orientation)

    tilt(350.0, 20.0, 0.0)  # as somebody holds it
    page.click("#phone")
    expect(page.locator("#devices-line")).to_contain_text("phone")
    box = page.locator("#clutch").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    state(page, "held")
    page.wait_for_timeout(300)
    tilt(350.0, 5.0, 0.0)  # away by 15 deg: half of the speed
    page.wait_for_timeout(600)
    tilt(5.0, 20.0, 0.0)  # twisted to the left, across north
    page.wait_for_timeout(600)
    tilt(350.0, 20.0, 0.0)
    page.wait_for_timeout(800)
    page.mouse.up()
    state(page, "ready")
    (left, right), (turned, _) = finished(page, logs_of_stack)
    assert left[0] > 0.02
    assert left[2] > 0.02
    assert abs(left[1]) < 2e-3
    assert turned < 0.01
    assert np.abs(right).max() < 2e-3
