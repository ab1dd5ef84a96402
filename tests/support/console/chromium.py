"""The browser of the tests, the options that it gets, and what is drawn in the frame of its scene."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Error, Page

CHROMIUM = "/usr/bin/chromium"  # Debian's
READY_MS = 240_000  # code may have to be compiled for this machine first
NODES = "Object.keys(window.__viserSceneTree?.getState() ?? {})"
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--disable-background-networking",
]


def leave_scene_undrawn(page: Page) -> None:
    """Serve the scene's frame without its drawing, which a machine without a graphics card would have to do itself."""
    page.route("**/viser/**", lambda route: route.fulfill(content_type="text/html", body="<p id=drawn>scene</p>"))


def in_scene(page: Page, script: str, wanted: Callable[[Any], Any] = bool) -> Any:
    """Evaluate a script in the scene's frame until its value is as wanted; return it."""
    value = None
    for _ in range(READY_MS // 100):
        with suppress(Error, ValueError):  # the frame is being loaded, or about to be
            (frame,) = [frame for frame in page.frames if "/viser/" in frame.url]
            value = frame.evaluate(script)
            if wanted(value):
                return value
        page.wait_for_timeout(100)
    raise AssertionError(f"{script}: {str(value)[:400]}; drawn: {page.frames[-1].evaluate(NODES)}")


def centre_of_hue(picture: Image.Image, colour: tuple[int, int, int], least: int) -> float | None:
    """Return the mean column of the saturated pixels of a colour's hue, None where there are not `least` of them."""
    hue = Image.new("RGB", (1, 1), colour).convert("HSV").getpixel((0, 0))[0]  # pyright: ignore[reportIndexIssue, reportOptionalSubscript]
    pixels = np.asarray(picture.convert("HSV")).astype(int)
    fits = (abs(pixels[..., 0] - hue) < 10) & (pixels[..., 1] > 130) & (pixels[..., 2] > 60)
    return float(np.nonzero(fits)[1].mean()) if fits.sum() > least else None
