"""How a page is looked at: the windows, contrast and names by axe-core, what is cut off or outside, and its picture."""

import io
import os
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import Page

from tests.support.console.stage import PATIENCE_MS

WRITE = "RTSTACK_SCREENSHOTS" in os.environ
PICTURES = Path(__file__).parents[3] / "docs" / "screenshots"
MOST_BYTES = 200_000
# a phone, a tablet, what labs have; the last one is the pictures'
WINDOWS = ((390, 844), (820, 1180), (1280, 720), (2560, 1440), (1920, 1080), (1440, 900))
# windows with a picture in the documentation, by the folder that it is in
PICTURED = {(390, 844): "390", (1920, 1080): "1920", (1280, 720): "."}
THEMES = {"dark": PICTURES, "light": PICTURES / "light"}
RULES = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"],
    "rules": {"target-size": {"enabled": True}},  # of WCAG 2.2, which axe-core leaves out unless it is asked for
    "resultTypes": ["violations"],
    "iframes": False,
}

# Every control and every piece of text that is seen: inside of the window, or of something that scrolls; not cut off,
# but with an ellipsis and the whole of it as the title.
MISPLACED = """() => {
  const wrong = [];
  const root = document.documentElement;
  const column = innerWidth < 900; // one column, which scrolls down; its tables have no head
  if (root.scrollWidth > innerWidth || (!column && root.scrollHeight > innerHeight)) wrong.push('the page scrolls');
  const stop = document.querySelector('#stop').getBoundingClientRect();
  if (stop.height < 44 || stop.width < 96 || stop.bottom > innerHeight || stop.right > innerWidth)
    wrong.push('STOP is not in the window');
  if (document.elementFromPoint(stop.x + stop.width / 2, stop.y + stop.height / 2)?.id !== 'stop')
    wrong.push('STOP is covered');
  const scrolls = (style) => [style.overflowX, style.overflowY].some((way) => ['auto', 'scroll'].includes(way));
  const kinds = 'button, a, label, legend, h1, h2, h3, p, span, output, dt, dd, th, td, figcaption, summary, input'
    + ', select';
  for (const element of document.querySelectorAll(kinds)) {
    const box = element.getBoundingClientRect();
    const style = getComputedStyle(element);
    if (column && element.closest('thead')) continue;
    if (!box.width || style.visibility === 'hidden' || element.closest('.hidden, svg, .swagger-ui')) continue;
    const what = `${element.tagName.toLowerCase()}#${element.id} "${element.textContent.trim().slice(0, 40)}"`;
    let around = element.parentElement;
    while (around && !scrolls(getComputedStyle(around))) around = around.parentElement;
    const below = !column && (box.top < 0 || box.bottom > innerHeight + 1);
    if (!around && (box.left < 0 || box.right > innerWidth + 1 || below))
      wrong.push(`${what} is outside of the window`);
    if (around && around.scrollWidth > around.clientWidth + 1)
      wrong.push(`${what}: ${around.className} scrolls sideways, ${around.scrollWidth} > ${around.clientWidth}`);
    const panel = element.closest('.panel');
    const room = panel && panel.getBoundingClientRect().right - parseFloat(getComputedStyle(panel).paddingRight);
    if (panel && !around?.matches('.panel *') && box.right > room + 1.5) wrong.push(`${what} sticks out of its panel`);
    const text = style.display !== 'inline' && ['visible', 'hidden', 'clip'].includes(style.overflowX);
    const told = style.textOverflow === 'ellipsis' && (element.title || element.closest('[title]'))
      && !element.matches('button:not(.event), .button'); // what it does is read in full
    if (text && !told && element.scrollWidth > element.clientWidth + 1) wrong.push(`${what} is cut off`);
  }
  const seen = [...document.querySelectorAll('.bar .readings > *, #stop')].map((each) => each.getBoundingClientRect());
  const crossing = (a, b) => a.left < b.right - 0.5 && b.left < a.right - 0.5
    && a.top < b.bottom - 0.5 && b.top < a.bottom - 0.5;
  if (seen.some((a, i) => seen.slice(i + 1).some((b) => a.width && b.width && crossing(a, b))))
    wrong.push('the bar overlaps');
  for (const figure of document.querySelectorAll('.bar .figure')) {
    const edge = figure.getBoundingClientRect().right + 0.5;
    for (const part of figure.children) {
      const range = document.createRange();
      range.selectNodeContents(part);
      if (getComputedStyle(part).textOverflow !== 'ellipsis' && range.getBoundingClientRect().right > edge)
        wrong.push(`${figure.id} overflows`);
    }
  }
  for (const image of document.images) {
    if (image.src && image.complete && !image.naturalWidth) wrong.push(`the picture ${image.src} is broken`);
  }
  return [...new Set(wrong)];
}"""


def misplaced(page: Page) -> list[str]:
    """What is not where it should be, once curves have followed the window."""
    found: list[str] = []
    for _ in range(20):
        found = page.evaluate(MISPLACED)
        if not found:
            break
        page.wait_for_timeout(250)
    return found


# the scene stands still, and was drawn in the screen's resolution: console/static/js/scene_pace.js
SHARP = """() => {
  const canvas = document.querySelector('canvas[data-engine]');  // labels have one of their own
  const sharp = canvas.width >= canvas.clientWidth - 1;
  window.sharpSince = sharp ? window.sharpSince ?? performance.now() : undefined;
  return sharp && performance.now() - window.sharpSince > 1000;
}"""

# colours of Swagger's links take their time to change with the theme
SETTLED = """() => Promise.all(document.getAnimations()
    .filter((one) => one.effect?.getComputedTiming().endTime !== Infinity)
    .map((one) => one.finished.catch(() => null))).then(() => null)"""


def switch_theme(page: Page) -> None:
    """Switch between dark and light, in the menu of further pages."""
    page.click("#further")
    page.click("#theme")


def violations(page: Page) -> list[tuple[str, Any, str]]:
    """What axe-core has against a page that has come to rest: rule, element, what is wrong."""
    page.evaluate(SETTLED)
    found = Axe().run(page, options=RULES).response["violations"]
    return [(rule["id"], node["target"], node["failureSummary"]) for rule in found for node in rule["nodes"]]


def keep_picture(page: Page, name: str, folder: Path) -> None:
    """Write the page's picture to a folder; one of the documentation waits until the scene is drawn sharply."""
    if folder.is_relative_to(PICTURES) and page.locator("#scene").count():
        (frame,) = [frame for frame in page.frames if "/viser/" in frame.url]
        # by the clock: by the page's frames it would ask for one after the other; no test waits for this
        frame.wait_for_function(SHARP, timeout=PATIENCE_MS, polling=200)
    taken = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    path = folder / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    _with_256_colours(taken).save(path, optimize=True)
    assert path.stat().st_size <= MOST_BYTES, path


def _with_256_colours(picture: Image.Image) -> Image.Image:
    """The most frequent colours, of the page's surfaces, as they are; rare ones, of lights and legends, nearly."""
    colours = sorted(picture.getcolors(picture.width * picture.height) or [], reverse=True)
    exact = [value for _, colour in colours[:160] for value in colour]  # pyright: ignore[reportGeneralTypeIssues]
    rare = picture.quantize(256 - len(exact) // 3, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*exact, *rare][: 256 * 3])
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)
