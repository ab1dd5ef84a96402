"""Both hands of a person in front of the page: C with the left one, the mouse with the right one.

Where a gizmo is on the screen follows from the scene's first camera and from what was dragged before.
"""

import contextlib
import re
import time

import numpy as np
from playwright.sync_api import Error, expect

READY_MS = 240_000  # code may have to be compiled for this machine first
HOME = {"left": (0.0, 0.35, 0.26), "right": (0.0, -0.35, 0.26)}
ARROW_M = 0.17  # of a gizmo's arrow, from its middle: between shaft and tip
# the scene's first camera: console/scene/scene.py
EYE, LOOK_AT, FIELD_OF_VIEW = np.array([-1.75, 0.0, 1.35]), np.array([-0.02, 0.0, 0.3]), 0.72
STEPS = 12
ATTEMPTS = 20
PICTURES = 4
PATIENCE = 300  # looks, 0.1 s apart
AT_REST_M_S = 0.015  # the speed's noise is below it
ENDED = re.compile("succeeded|ended|failed|stopped")


def pixel(point, width, height):
    """Where the scene's first camera shows a point of the world."""
    forward = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    ray = np.asarray(point) - EYE
    scale = height / 2 / np.tan(FIELD_OF_VIEW / 2) / (ray @ forward)
    return width / 2 + scale * (ray @ right), height / 2 - scale * (ray @ up)


def type_words(page, selector, words):
    """Type words with a space into a field; whether they were there at once.

    On a page that has had no news for 0.5 s the space is STOP: then they are typed again.
    """
    field = page.locator(selector)
    for k in range(ATTEMPTS):
        field.fill("")
        field.click()
        page.keyboard.type(words)
        if field.input_value() == words:
            return k == 0
        page.wait_for_timeout(500)
    raise AssertionError(f"a space is never typed: {field.input_value()}")


class ClutchLost(Exception):
    """The page was held up for so long that the arms stopped, as they have to."""


class Operator:
    """A person at the page Operate; as a context manager, nothing is held afterwards."""

    def __init__(self, console):
        self.page = console.page
        self.console = console
        self.grips = {}  # where the gizmos are, m in the world

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.drop()

    def begin(self, button):
        """Start, and wait until the arms listen."""
        self.page.click("#tab-hand")
        self.wait_for_scene()
        self.console.arm()
        self.page.click(button)
        expect(self.page.locator("#clutch")).to_have_attribute("data-state", "ready", timeout=READY_MS)
        self.wait_for_scene()  # with the gizmos
        self.grips = {side: np.array(place) for side, place in HOME.items()}

    def wait_for_scene(self):
        """Wait until the scene has been drawn anew some times: what is new in it is prepared at its first picture."""
        pictures = "window.__viserTestpoints?.rendererInfo.render.frame ?? 0"
        first, end_s = 0, time.monotonic() + READY_MS * 1e-3
        while not (first and self._in_scene(pictures) > first + PICTURES):
            assert time.monotonic() < end_s, "the scene is not drawn"
            first = first or self._in_scene(pictures)
            self.page.wait_for_timeout(100)

    def reset_view(self):
        """Look from the first place again, and wait until the scene has been loaded for that."""
        self._in_scene("window.before = 1")
        self.page.click("#home")
        while self._in_scene("window.before ?? 0"):
            self.page.wait_for_timeout(100)
        self.wait_for_scene()

    def _in_scene(self, script):
        """Evaluate something in the scene's frame; 0 while that is being loaded."""
        for frame in self.page.frames:
            if "/viser/" in frame.url:
                with contextlib.suppress(Error):  # it was just left for another one
                    return frame.evaluate(script)
        return 0

    def hold(self):
        """Hold C; a page that was busy for too long has to be held again."""
        self.page.keyboard.down("c")
        expect(self.page.locator("#clutch")).to_have_attribute("data-state", "held")

    def drag(self, side, axis, metres, coupling="separate", held=True, pause_ms=0):
        """Drag the arrow of a gizmo along an axis of the world.

        coupling: what the other arm does, as it was chosen; held: with the clutch, so that the arms follow; pause_ms:
        how long the mouse stays at the end without that.
        """
        box = self.page.frame_locator("#scene").locator("canvas").first.bounding_box()
        assert box is not None
        along = np.eye(3)[axis]
        ends = [self.grips[side] + ARROW_M * along + way * along for way in (0.0, metres)]
        (x0, y0), (x1, y1) = (pixel(end, box["width"], box["height"]) for end in ends)
        mouse = self.page.mouse
        mouse.move(box["x"] + x0, box["y"] + y0)
        self.page.wait_for_timeout(200)
        mouse.down()
        for k in range(1, STEPS + 1):
            mouse.move(box["x"] + x0 + (x1 - x0) * k / STEPS, box["y"] + y0 + (y1 - y0) * k / STEPS)
            self.page.wait_for_timeout(50)
        if held:
            self._until_followed(box["x"] + x1, box["y"] + y1)
        self.page.wait_for_timeout(pause_ms)
        mouse.up()
        if not held:
            return
        other = "right" if side == "left" else "left"
        self.grips[side] = self.grips[side] + metres * along
        if coupling != "separate":
            mirrored = coupling == "mirrored" and axis == 1
            self.grips[other] = self.grips[other] + (-metres if mirrored else metres) * along

    def _until_followed(self, x, y):
        """Stay there with an unsteady hand while the arms are too far behind to be led further."""
        line = self.page.locator("#hand-line")
        for k in range(PATIENCE):
            self.check_held()
            self.page.mouse.move(x + k % 2, y)
            self.page.wait_for_timeout(100)
            if k > 2 and line.get_attribute("data-tone") == "":
                self.page.mouse.move(x, y)
                return
        raise AssertionError(f"the arms do not follow: {line.inner_text()}")

    def check_held(self):
        """Raise ClutchLost where the page does not hold the clutch any more."""
        if self.page.locator("#clutch").get_attribute("data-state") != "held":
            raise ClutchLost(self.page.locator("#job-line").inner_text())

    def wait_at_rest(self):
        """Watch the arms until they have come to rest."""
        still, speeds = 0, []
        for _ in range(PATIENCE):
            self.check_held()
            self.page.wait_for_timeout(100)
            speeds = re.findall(r"[\d.]+", self.page.locator("#speed-now").inner_text())[:2]
            still = still + 1 if speeds and all(float(speed) < AT_REST_M_S for speed in speeds) else 0
            if still == 5:
                return
        raise AssertionError(f"the arms do not come to rest: {speeds}")

    def drop(self):
        """Let go of key and mouse, whatever is held."""
        self.page.keyboard.up("c")
        self.page.mouse.up()

    def recover(self):
        """Let everything go, wait until the arms have stopped, and clear the fault."""
        self.drop()
        expect(self.page.locator("#job-line")).to_contain_text(ENDED, timeout=READY_MS)
        self.reset_view()  # where there was no gizmo any more the drag has turned it
        if self.page.locator("#recover").is_visible():
            self.page.click("#recover")
            expect(self.page.locator("#recover")).to_be_hidden(timeout=READY_MS)

    def release(self):
        """Let go of the clutch, and wait until the arms have stopped and the log is finished."""
        self.page.keyboard.up("c")
        expect(self.page.locator("#job-line")).to_contain_text(ENDED, timeout=READY_MS)
