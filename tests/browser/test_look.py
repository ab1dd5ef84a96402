"""What the console looks like, on every page and in both themes: contrast and names of controls by axe-core, nothing
cut off or outside of the window, no script that fails, and the pictures of the documentation.

The program `deeper screenshots` writes the pictures to docs/screenshots, with a small campaign in them. Left out,
since axe-core reads elements: what canvases draw (strips, time line, mode bands) and the frames of the 3D scene and of
a campaign's report, which are documents of their own.
"""

import json
import subprocess
import sys
import time
from dataclasses import asdict
from itertools import product
from pathlib import Path

import pytest
from fastapi.responses import HTMLResponse
from fastapi.routing import APIRoute
from PIL import Image
from playwright.sync_api import expect

from console.campaigns.folder import Asked, CampaignFolder
from console.routes import description, pages
from rtstack.experiments.registry import plan_file
from tests.support.console.look import (
    MISPLACED,
    MOST_BYTES,
    PICTURED,
    THEMES,
    WINDOWS,
    WRITE,
    keep_picture,
    misplaced,
    switch_theme,
    violations,
)
from tests.support.console.stage import PATIENCE_MS

pytestmark = [pytest.mark.browser, pytest.mark.alone]
FINDS_DEMONSTRATION = True
AXE_WIDTHS = (390, 1280, 1920)

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
    campaign.note.write_text(json.dumps(asdict(Asked("reference-spreading", True, time.time()))))
    with campaign.said.open("w") as said:
        subprocess.run([*command, "--workers", "1"], check=True, stdout=said, stderr=said)


@pytest.fixture(scope="module")
def addresses(console):
    """The address of each page, with logs that there are."""
    rows = console.page.request.get("/api/logs").json()
    ids = {row["name"].removesuffix(".mcap"): row["id"] for row in rows}
    return {pattern: pattern.format(**ids) + ("?t=1.45" if "{trial}" in pattern else "") for pattern in PAGES}


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
            for (size, folder), pictures in product(PICTURED.items(), THEMES.values()):
                path = pictures / folder / f"{name}.png"
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
            switch_theme(page)
        for width, height in WINDOWS:
            page.set_viewport_size({"width": width, "height": height})
            if found := misplaced(page):
                wrong[theme, width] = found
            if width in AXE_WIDTHS and (found := violations(page)):
                wrong[theme, "axe", width] = found
            folder = PICTURED.get((width, height))
            if folder is not None and (WRITE or folder == ".") and name != "panels":
                keep_picture(page, name, (THEMES[theme] if WRITE else tmp_path / theme) / folder)
    assert not wrong, "\n".join(f"{where}: {what}" for where, what in wrong.items())
    assert console.errors == []


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
