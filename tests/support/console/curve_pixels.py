"""What a person sees of a curve in the review: its pixels, not the numbers that it was drawn from."""

import io
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Page

_DRAWN = """async name => {
    const chart = (await import('/static/js/review/page.js')).plots.chart; // what the page itself has drawn
    return chart.curves.filter(curve => curve.name === name)
        .map(({x, y, colour, pane}) => ({x: [...x], y: [...y], colour, ...chart.panes[pane]}));
}"""
_PX = "async t => (await import('/static/js/review/page.js')).plots.chart.x(t)"
_SHOW = "how => ['bands', 'legends'].forEach((id) => { document.getElementById(id).style.visibility = how; })"
_REACH_PX = 3
_ASIDE_PX = 12  # from where the background is taken
_DIFFERS = 60  # sum over red, green and blue


def drawn(page: Page, name: str) -> list[dict[str, Any]]:
    """Return a signal's curves as they were drawn, the compared log's second: x s, y, colour; top, bottom px, range."""
    return page.evaluate(_DRAWN, name)


def highest_seen(page: Page, name: str, t_s: float) -> float:
    """Return the largest value at which a curve's own colour is on the screen at a time; -inf where it is not.

    The page's cursor must be elsewhere. Bands, the lines of events and the legends are hidden meanwhile: they reach to
    a pane's top too.
    """
    place = drawn(page, name)[0]
    page.evaluate(_SHOW, "hidden")
    image = np.asarray(Image.open(io.BytesIO(page.locator("#figure-area").screenshot())).convert("RGB")).astype(int)
    page.evaluate(_SHOW, "")
    colour = np.array([int(place["colour"][k : k + 2], 16) for k in (1, 3, 5)])
    top, bottom, px = place["top"], place["bottom"], round(page.evaluate(_PX, t_s))
    pane = image[top:bottom]
    near = pane[:, max(0, px - _REACH_PX) : px + _REACH_PX + 1]
    behind = pane[:, [max(0, px - _ASIDE_PX), min(pane.shape[1] - 1, px + _ASIDE_PX)]].mean(axis=1, keepdims=True)
    away = near - behind  # how far a pixel is from its ground towards the curve's colour
    towards = colour - behind
    share = (away * towards).sum(axis=2) / np.maximum((towards**2).sum(axis=2), 1.0)
    seen = (np.abs(away).sum(axis=2) > _DIFFERS) & (share > 0.45)
    rows = np.flatnonzero(seen.any(axis=1))
    if not len(rows):
        return -np.inf
    low, high = place["range"]
    return float(high - rows[0] / (bottom - top) * (high - low))
