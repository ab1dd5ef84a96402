"""A headset that is emulated in a real Chromium by npm's `iwer`, and a person's hands in it.

The package is fetched by npm, from its cache where it is there, and is not part of this repository.
"""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from rtstack.samples import SIDES

IWER = "iwer@2.5.0"
READY_MS = 240_000
REST = {"left": (-0.2, 1.0, -0.4), "right": (0.2, 1.0, -0.4)}  # of the controllers in the room, m
TREMOR_M, TREMOR_HZ = 0.3e-3, 9.0  # physiological tremor of an outstretched hand: 8 to 12 Hz, below a millimetre
RIGHT_LATER_S = 0.03  # two hands do not begin together
STEP_S = 0.005
# of both hands: how long a movement takes, and where it ends from the start: inwards, up, back (m, of WebXR's axes)
RAISED_M, CLOSED_M, LIFTED_M = 0.05, 0.31, 0.15
GRAB = (
    (1.0, (0.0, RAISED_M, 0.0)), (0.8, (0.0, RAISED_M, 0.0)), (1.6, (CLOSED_M, RAISED_M, 0.0)),
    (1.0, (CLOSED_M, RAISED_M, 0.0)), (1.5, (CLOSED_M, RAISED_M + LIFTED_M, 0.0)),
    (1.5, (CLOSED_M, RAISED_M + LIFTED_M, 0.0)),
)  # fmt: skip
# iwer says of each position that it is emulated, which of a real controller says that it is not seen any more: `unseen`
EMULATED = """window.xr = new IWER.XRDevice(IWER.metaQuest3);
xr.installRuntime({ forceInstall: true });
window.unseen = false;
Object.defineProperty(XRPose.prototype, "emulatedPosition", { get: () => window.unseen });"""
# counts how often the pads were not led any more while a grip was held
COUNT = """() => {
  window.lost = 0;
  let led = false;
  new MutationObserver(() => {
    const now = document.getElementById("headset-state").textContent === "leading";
    const gripped = ["left", "right"].some((side) => xr.controllers[side].getButtonValue("squeeze") > 0);
    if (led && !now && gripped) window.lost += 1;
    led = now;
  }).observe(document.getElementById("headset-state"), { childList: true, characterData: true, subtree: true });
}"""
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


def minimum_jerk(seed: int = 1, moves: Any = GRAB) -> dict[str, list[list[float]]]:
    """Return a person's way for each controller, (n, 3) m each STEP_S: minimum-jerk movements with tremor, made, not
    recorded. Flash and Hogan, The Coordination of Arm Movements, J. Neurosci. 1985.
    """
    random = np.random.default_rng(seed)
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
