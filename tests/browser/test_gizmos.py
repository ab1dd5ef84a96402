"""An operator with mouse and keyboard: both gizmos dragged with the clutch held, and a recording that is accepted.

The recording comes from the drag, not from the script.
"""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from rtstack.log.reader import read_log
from rtstack.samples import SIDES, Mode

# a clutch is held for 0.3 s without a sign of life: the page needs a machine that gives it that
pytestmark = [pytest.mark.browser, pytest.mark.realtime]
expect.set_options(timeout=30_000)
READY_MS = 120_000
HOME = {"left": (0.0, 0.35, 0.26), "right": (0.0, -0.35, 0.26)}
ARROW_M = 0.17  # of a gizmo's arrow, from its middle: between shaft and tip
# the scene's first camera: console/scene.py
EYE, LOOK_AT, FIELD_OF_VIEW = np.array([-1.75, 0.0, 1.35]), np.array([-0.02, 0.0, 0.3]), 0.72
STEPS = 12


def pixel(point, width, height):
    """Where the scene's first camera shows a point of the world."""
    forward = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    ray = np.asarray(point) - EYE
    scale = height / 2 / np.tan(FIELD_OF_VIEW / 2) / (ray @ forward)
    return width / 2 + scale * (ray @ right), height / 2 - scale * (ray @ up)


class Operator:
    """Both hands of a person: C with the left one, the mouse with the right one."""

    def __init__(self, console):
        self.page = console.page
        self.console = console

    def begin(self, button):
        """Start, and wait until the arms listen."""
        self.page.click("#tab-hand")
        self.console.arm()
        self.page.click(button)
        expect(self.page.locator("#clutch")).to_have_attribute("data-state", "ready", timeout=READY_MS)

    def hold(self):
        """Hold C; a page that was busy for too long has to be held again."""
        self.page.keyboard.down("c")
        expect(self.page.locator("#clutch")).to_have_attribute("data-state", "held")

    def drag(self, side, axis, metres):
        """Drag the arrow of a gizmo that stands at home."""
        box = self.page.frame_locator("#scene").locator("canvas").first.bounding_box()
        assert box is not None
        along = np.eye(3)[axis]
        ends = [np.array(HOME[side]) + ARROW_M * along + way * along for way in (0.0, metres)]
        (x0, y0), (x1, y1) = (pixel(end, box["width"], box["height"]) for end in ends)
        mouse = self.page.mouse
        mouse.move(box["x"] + x0, box["y"] + y0)
        self.page.wait_for_timeout(200)
        mouse.down()
        for k in range(1, STEPS + 1):
            mouse.move(box["x"] + x0 + (x1 - x0) * k / STEPS, box["y"] + y0 + (y1 - y0) * k / STEPS)
            self.page.wait_for_timeout(50)
        mouse.up()


@pytest.fixture
def operator(console):
    """Give an operator in front of the page; nothing is held afterwards."""
    hands = Operator(console)
    yield hands
    hands.page.keyboard.up("c")
    hands.page.mouse.up()


def newest_log(page, tmp_path, kind):
    """Download the newest log of a kind, and read it."""
    row = page.locator("#logs tbody tr", has_text=kind).first
    expect(row).not_to_contain_text("being written")
    with page.expect_download() as download:
        row.locator("a[download]").click()
    path = tmp_path / "log.mcap"
    download.value.save_as(path)
    return read_log(path)


def test_both_gizmos_are_dragged_with_the_clutch_held_and_letting_go_stops_the_arms(operator, tmp_path):
    page = operator.page
    operator.begin("#record")
    expect(page.locator("#recording")).to_contain_text("REC")
    operator.hold()
    operator.drag("left", 2, 0.08)
    operator.drag("right", 2, 0.08)
    page.keyboard.up("c")
    expect(page.locator("#job-line")).to_contain_text(re.compile("succeeded|ended|failed"), timeout=READY_MS)
    expect(page.locator("#recording")).to_be_hidden()
    log = newest_log(page, tmp_path, "recording")
    assert log.metadata["trial"]["kind"] == "recording"
    for side in SIDES:
        control = log.topic(f"/{side}/control")
        assert set(control["mode"]) == {Mode.TELEOPERATION, Mode.STOPPING}
        command = control["pose_ref"][:, :3]
        measured = log.topic(f"/{side}/arm")["O_T_EE"][:, :3, 3]
        for rise in (np.ptp(command[:, 2]), np.ptp(measured[:, 2])):
            assert 0.03 < rise < 0.16
        assert np.ptp(command[:, :2], axis=0).max() < 0.01


def test_nothing_moves_without_the_clutch(operator, tmp_path):
    page = operator.page
    operator.begin("#practise")
    operator.drag("left", 2, 0.08)
    page.wait_for_timeout(500)
    page.click("#finish")
    expect(page.locator("#job-line")).to_contain_text("succeeded", timeout=READY_MS)
    control = newest_log(page, tmp_path, "teleoperation").topic("/left/control")
    moving = control[control["mode"] == Mode.TELEOPERATION]
    assert np.ptp(moving["pose_ref"][:, :3], axis=0).max() < 1e-9
