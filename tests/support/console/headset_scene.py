"""An operator with an emulated headset on, at `rtstack up`, on a network of their own that can be cut."""

import contextlib
from pathlib import Path

from playwright.sync_api import Error as BrowserError
from playwright.sync_api import Page, expect

from rtstack.samples import SIDES
from tests.support.console.headset import READY_MS, Person, emulate
from tests.support.console.operator_scene import (
    FOLLOWING_M_S,
    TOO_EARLY,
    Chromium,
    OperatorScene,
    SceneFailed,
    wait,
)
from tests.support.network.namespaces import Namespace

# the left controller goes up and down by 3 cm, at up to 0.19 m/s
SWAY = """() => {
  const { x, y, z } = xr.controllers.left.position;
  setInterval(() => xr.controllers.left.position.set(x, y + 0.03 * Math.sin(performance.now() / 160), z), 5);
}"""


class HeadsetScene(OperatorScene):
    """Both grips are held, and the left hand moves. script: of the emulator; network: where the caller is."""

    def __init__(self, browser: Chromium, logs: Path, script: Path, network: Namespace) -> None:
        super().__init__(browser, logs, drawn=False)
        self._script, self._network = script, network

    @property
    def page(self) -> Page:
        """The headset's page, in front."""
        if self._page is None or self._page.is_closed():
            page = self._page = self.browser.context.new_page()
            page.set_default_timeout(READY_MS)
            emulate(page, self._script)
            page.goto(f"{self.stack.base}/headset")
        return self._page

    def take_hold(self, jog: bool = True) -> None:
        """Take control, arm, put the headset on, practise, hold both grips. Raises SceneFailed."""
        page = self.page
        wait(lambda: not self.active, "the last job does not end")
        self.take_control()
        self.witness.begin()
        expect(page.locator("#practise")).to_be_enabled(timeout=READY_MS)
        person = Person(page)
        person.put_on()
        page.evaluate("document.getElementById('practise').click()")  # the emulator lies over it
        person.sees("hold a grip to lead")
        for side in SIDES:
            person.grip(side, True)
        person.sees("leading")
        page.evaluate(SWAY)
        wait(lambda: self.witness.speed_m_s > FOLLOWING_M_S or self.witness.stopped, "the arm does not follow")
        if self.witness.stopped:
            raise SceneFailed(TOO_EARLY)

    def cut(self) -> None:
        """Cut the network between page and console: nothing arrives, and nobody is told."""
        self._network.plug(False, "lo")

    def leave(self) -> None:
        """Mend the network, and close the page, where there is one."""
        self._network.plug(True, "lo")
        with contextlib.suppress(BrowserError):
            if self._page is not None:
                self._page.close()
        self._page = None
