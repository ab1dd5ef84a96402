"""An emulated headset in a real Chromium: two controllers lead both pads, and whatever lets go stops them."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from rtstack.log.reader import read_log
from rtstack.samples import SIDES, Mode
from rtstack.topics import HAND_TOPIC
from tests.support.console.chromium import READY_MS

IWER = "iwer@2.5.0"
REST = {"left": (-0.2, 1.0, -0.4), "right": (0.2, 1.0, -0.4)}  # of the controllers in the room, m
TREMOR_M, TREMOR_HZ = 0.3e-3, 9.0  # physiological tremor of an outstretched hand: 8 to 12 Hz, below a millimetre
RIGHT_LATER_S = 0.03  # two hands do not begin together
STEP_S = 0.005
# iwer says of each position that it is emulated, which of a real controller says that it is not seen any more: `unseen`
EMULATED = """window.xr = new IWER.XRDevice(IWER.metaQuest3);
xr.installRuntime({ forceInstall: true });
window.unseen = false;
Object.defineProperty(XRPose.prototype, "emulatedPosition", { get: () => window.unseen });"""
PLAY = """([step_ms, tracks]) => new Promise((done) => {
  const began = performance.now();
  const length = tracks.left.length;
  const timer = setInterval(() => {
    const at = (performance.now() - began) / step_ms;
    const k = Math.min(length - 2, Math.floor(at));
    const part = Math.min(1, at - k);
    for (const [side, track] of Object.entries(tracks)) {
      const [a, b] = [track[k], track[k + 1]];
      xr.controllers[side].position.set(...a.map((value, axis) => value + part * (b[axis] - value)));
    }
    if (at < length - 1) return;
    clearInterval(timer);
    done();
  }, step_ms);
})"""


def emulator(folder: Path) -> Path:
    """Fetch the emulator by npm into a folder; return its script."""
    subprocess.run(["npm", "pack", "--silent", "--prefer-offline", IWER], cwd=folder, check=True, capture_output=True)
    (packed,) = folder.glob("*.tgz")
    subprocess.run(["tar", "xzf", packed.name], cwd=folder, check=True)
    return folder / "package" / "build" / "iwer.min.js"


def emulate(page: Page, script: Path) -> None:
    """Have the pages that are opened from now on find a headset with two controllers."""
    page.add_init_script(path=str(script))
    page.add_init_script(EMULATED)


def minimum_jerk(moves: Any) -> dict[str, list[list[float]]]:
    """Return a person's way for each controller, (n, 3) m each STEP_S: minimum-jerk movements with tremor, made, not
    recorded. Flash and Hogan, The Coordination of Arm Movements, J. Neurosci. 1985.

    moves: duration of each, s, and where it ends from the start: inwards, up, back (m, of WebXR's axes).
    """
    random = np.random.default_rng(1)
    way, at = [np.zeros(3)], np.zeros(3)
    for seconds, goal in moves:
        share = np.arange(1, round(seconds / STEP_S) + 1)[:, None] * STEP_S / seconds
        way.extend(at + (10 * share**3 - 15 * share**4 + 6 * share**5) * (np.array(goal) - at))
        at = np.array(goal)
    both: NDArray[np.float64] = np.array(way)
    t_s = np.arange(len(both)) * STEP_S
    tracks = {}
    for side, outwards in zip(SIDES, (1.0, -1.0), strict=True):
        later = 0 if side == "left" else round(RIGHT_LATER_S / STEP_S)
        own = np.concatenate([np.repeat(both[:1], later, axis=0), both[: len(both) - later]]) * (outwards, 1.0, 1.0)
        phase = 2 * np.pi * random.random(3)
        tremor = TREMOR_M * np.sin(2 * np.pi * TREMOR_HZ * t_s[:, None] + phase)
        tracks[side] = (np.array(REST[side]) + own + tremor).tolist()
    return tracks


class Person:
    """Who wears it. The page is /headset, armed."""

    def __init__(self, page: Page) -> None:
        self.page = page
        for side in SIDES:
            self.place(side, REST[side])
            self.grip(side, False)

    def put_on(self) -> None:
        """Put the headset on: from then on the emulator lies over the page."""
        self.page.click("#enter")
        expect(self.page.locator("body")).to_have_attribute("data-headset", "on")

    def press(self, side: str, button: str) -> None:
        """Press a button and let it go, once it was seen."""
        for value in (1, 0):
            self.page.evaluate(f"xr.controllers.{side}.updateButtonValue('{button}', {value})")
            self.picture()
            self.picture()

    def picture(self) -> None:
        """Wait until the headset has shown one more picture."""
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def place(self, side: str, position: Any) -> None:
        """Hold a controller at a place of the room, m."""
        self.page.evaluate("([side, at]) => xr.controllers[side].position.set(...at)", [side, list(position)])

    def grip(self, side: str, held: bool) -> None:
        """Squeeze a controller's grip, or let it go."""
        self.page.evaluate(f"xr.controllers.{side}.updateButtonValue('squeeze', {int(held)})")

    def sees(self, state: str) -> None:
        """Wait until the page says this of what is led."""
        expect(self.page.locator("#headset-state")).to_have_text(state, timeout=READY_MS)

    def play(self, tracks: dict[str, list[list[float]]]) -> None:
        """Move both controllers along their tracks, in real time."""
        self.page.evaluate(PLAY, [1e3 * STEP_S, tracks])


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
    person.play(minimum_jerk(UP))
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
