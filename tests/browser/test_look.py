"""What the console looks like, on every page and in both themes: contrast and names of controls by axe-core, nothing
cut off or outside of the window, no script that fails, and the pictures of the documentation.

The program `deeper screenshots` writes the pictures to docs/screenshots, with a small campaign in them. Left out,
since axe-core reads elements: what canvases draw (strips, time line, mode bands) and the frames of the 3D scene and of
a campaign's report, which are documents of their own.
"""

import io
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from fastapi.responses import HTMLResponse
from fastapi.routing import APIRoute
from PIL import Image
from playwright.sync_api import Page, expect

from console.campaigns.folder import Asked, CampaignFolder
from console.routes import description, pages
from rtstack.experiments.registry import plan_file

pytestmark = [pytest.mark.browser, pytest.mark.alone]
FINDS_DEMONSTRATION = True
PATIENCE_MS = 60_000
WRITE = "RTSTACK_SCREENSHOTS" in os.environ
PICTURES = Path(__file__).parents[2] / "docs" / "screenshots"
MOST_BYTES = 200_000
# a phone, a tablet, what labs have; the last one is the pictures'
WINDOWS = ((390, 844), (820, 1180), (1280, 720), (2560, 1440), (1920, 1080), (1440, 900))
AXE_WIDTHS = (390, 1280, 1920)
# windows with a picture in the documentation, by the folder that it is in
PICTURED = {(390, 844): "390", (1920, 1080): "1920", (1440, 900): "."}
RULES = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"],
    "rules": {"target-size": {"enabled": True}},  # of WCAG 2.2, which axe-core leaves out unless it is asked for
    "resultTypes": ["violations"],
    "iframes": False,
}

# name of each page's picture, and what says that the page is there; {trial} and {demonstration} are ids of logs
PAGES = {
    "/": ("operate", "#light-left[data-mode=IDLE]"),
    "/trials": ("trials", "#logs tbody tr"),
    "/campaigns": ("campaigns", "#pictures img" if WRITE else "#plan:not(:empty)"),
    "/logs": ("logs", "#logs tbody tr"),
    "/logs/{trial}": ("log", "#log-events li"),
    "/recordings/{demonstration}": ("recording", "#whole-force[data-points]"),
    "/recovery": ("recovery", "tr#the-operator-has-gone"),
    "/headset": ("headset", "#headset-state"),
    "/access": ("access", "#audit tbody tr"),
    "/panels": ("panels", ".panels"),  # without one; its picture is made by test_panels_page.py
    "/api": ("api", "#operations-access-access_me"),
}
ALWAYS = ("/", "/logs/{trial}")  # the others with `make long`

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


@pytest.fixture(scope="module")
def logs_of_stack(logs_of_stack, runner):
    """The stack finds a trial of the demonstration, too, and for the pictures a campaign of two trials."""
    runner.run(log=logs_of_stack / "trial.mcap")
    if WRITE:
        _campaign(logs_of_stack / "campaigns")
    return logs_of_stack


def _campaign(folder: Path) -> None:
    text = plan_file("reference-spreading").path.read_text()
    head = text[: text.index("[[experiments]]")]
    before, _, after = head.partition("controllers = [")
    head = f'{before}controllers = ["no_interim", "proposed"]{after[after.index("]") + 1 :]}'
    folder.mkdir()
    plan = folder.parent.with_name("small.toml")
    experiment = 'name = "figure11"\nreferences = ["rice_box/0"]\ndisplacements_mm = [-30.0, 30.0]\nrepetitions = 2\n'
    plan.write_text(f"{head}[[experiments]]\n{experiment}")
    command = [sys.executable, "-m", "rtstack", "campaign", str(plan), "--out", str(folder / "20261121-101500")]
    campaign = CampaignFolder(folder / "20261121-101500")
    campaign.keep(Asked("reference-spreading", True, time.time()))
    with campaign.said.open("w") as said:
        subprocess.run([*command, "--workers", "1"], check=True, stdout=said, stderr=said)


@pytest.fixture(scope="module")
def addresses(console):
    """The address of each page, with logs that there are."""
    rows = console.page.request.get("/api/logs").json()
    ids = {row["name"].removesuffix(".mcap"): row["id"] for row in rows}
    return {pattern: pattern.format(**ids) + ("?t=1.45" if "{trial}" in pattern else "") for pattern in PAGES}


def misplaced(page: Page) -> list[str]:
    """What is not where it should be, once curves have followed the window."""
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


def violations(page: Page) -> list[tuple[str, Any, str]]:
    """What axe-core has against a page that has come to rest: rule, element, what is wrong."""
    page.evaluate(SETTLED)
    found = Axe().run(page, options=RULES).response["violations"]
    return [(rule["id"], node["target"], node["failureSummary"]) for rule in found for node in rule["nodes"]]


def test_every_page_of_the_console_is_looked_at_and_has_its_picture():
    routes = [route for module in (pages, description) for route in module.router.routes]
    served = {route.path for route in routes if isinstance(route, APIRoute) and route.response_class is HTMLResponse}
    parameters = {"{trial}": "{log_id}", "{demonstration}": "{log_id}"}
    ours = set()
    for pattern, (name, _) in PAGES.items():
        for known, parameter in parameters.items():
            pattern = pattern.replace(known, parameter)
        ours.add(pattern)
        if not WRITE:
            for size, folder in PICTURED.items():
                path = PICTURES / folder / f"{name}.png"
                assert path.stat().st_size <= MOST_BYTES, path
                with Image.open(path) as picture:
                    assert picture.size == size, path
    assert served == ours


@pytest.mark.parametrize(
    "pattern", [pytest.param(each, marks=[] if each in ALWAYS else pytest.mark.long) for each in PAGES]
)
def test_a_page_in_both_themes_and_every_window(console, addresses, pattern, tmp_path):
    page, (name, ready) = console.page, PAGES[pattern]
    page.goto(addresses[pattern])
    page.locator(ready).first.wait_for(timeout=PATIENCE_MS)
    if page.locator("#scene").count():
        expect(page.frame_locator("#scene").locator("canvas").first).to_be_visible(timeout=PATIENCE_MS)
    wrong = {}
    for theme in ("light", "dark"):
        if page.get_attribute("html", "data-theme") != theme:
            page.click("#theme")
        for width, height in WINDOWS:
            page.set_viewport_size({"width": width, "height": height})
            if found := misplaced(page):
                wrong[theme, width] = found
            if width in AXE_WIDTHS and (found := violations(page)):
                wrong[theme, "axe", width] = found
            folder = PICTURED.get((width, height))
            if folder is not None and (WRITE or folder == ".") and name != "panels":
                _picture(page, name, (PICTURES if WRITE and theme == "dark" else tmp_path / theme) / folder)
    assert not wrong, "\n".join(f"{where}: {what}" for where, what in wrong.items())
    assert console.errors == []


def _picture(page: Page, name: str, folder: Path) -> None:
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
    exact = [value for _, colour in colours[:160] for value in colour]
    rare = picture.quantize(256 - len(exact) // 3, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*exact, *rare][: 256 * 3])
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


def test_the_checks_find_what_they_look_for(console, addresses):
    page = console.page
    page.goto(addresses["/access"])
    page.locator(PAGES["/access"][1]).first.wait_for(timeout=PATIENCE_MS)
    assert page.evaluate(MISPLACED) == []
    page.evaluate("document.querySelector('#me').style.color = '#555'")
    page.evaluate(
        "document.querySelector('#token input').closest('label').replaceWith(document.createElement('input'))"
    )
    assert {rule for rule, _, _ in violations(page)} == {"color-contrast", "label"}
    page.evaluate("document.querySelector('.readings').style.gap = '200px'")
    page.evaluate("Object.assign(document.querySelector('#sign-out').style, {width: '20px', overflow: 'hidden'})")
    page.evaluate("document.querySelector('#stop').style.marginRight = '-100px'")
    said = " ".join(page.evaluate(MISPLACED))
    assert "STOP is not in the window" in said
    assert "the bar overlaps" in said
    assert 'button#sign-out "Sign out" is cut off' in said
