"""A recording is played in 3D beside another log as a ghost, and on the arms, in a real Chromium with a real stack."""

import io
import re
from contextlib import suppress

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, TimeoutError, expect

from rtstack.safety.arming import LEASE_S

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long]
FINDS_DEMONSTRATION = True
PATIENCE_MS = 120_000
TRIES = 200
POST = """async (paths) => { for (const path of paths) {
    const token = document.querySelector('meta[name="csrf-token"]').content;
    const answer = await fetch(path, {method: 'POST', body: '{}', headers: {'content-type': 'application/json', 'x-csrf-token': token}});
    if (!answer.ok) return (await answer.json()).error; } return ''; }"""  # noqa: E501


def think_and_say_yes(page: Page) -> bool:
    """Read the question for longer than the lease lasts, confirm; whether the page had control all the time."""
    question = page.get_by_role("alertdialog")
    expect(question).to_contain_text("Nothing may be in their way")
    expect(question.get_by_text("Cancel")).to_be_focused()
    page.wait_for_timeout(1000 * 2 * LEASE_S)
    phase = page.locator("#control-light").get_attribute("data-phase")
    box = page.locator("#stop").bounding_box()
    assert box is not None
    reached = "({x, y, width, height}) => document.elementFromPoint(x + width / 2, y + height / 2)?.id"
    assert page.evaluate(reached, box) == "stop"
    question.get_by_text("Play", exact=True).click()
    expect(question).to_have_count(0)
    return phase == "armed"


def open_log(page: Page, kind: str) -> None:
    page.goto("/logs")
    page.select_option("#kind", kind)
    expect(page.locator("#logs tbody tr")).to_have_count(1, timeout=PATIENCE_MS)
    page.goto(page.locator("#logs tbody a[href^='/logs/']").first.get_attribute("href") or "")
    expect(page.locator("#figure-area")).to_have_attribute("data-points", re.compile("[1-9]"), timeout=PATIENCE_MS)
    expect(page.locator("#reading")).to_be_hidden(timeout=PATIENCE_MS)


def test_a_log_goes_to_the_arms_and_ends_softly_and_is_compared_with_what_was_played(console):
    page = console.page
    open_log(page, "demonstration")
    play = page.locator("#arms-play")
    page.select_option("#arms-speed", "0.25")
    refused = ""
    for _ in range(TRIES):  # without control or arming the button says so; a page that was held up may lose them again
        if play.is_enabled():
            with suppress(TimeoutError):
                play.click(timeout=1000)
                if think_and_say_yes(page):
                    break
        expect(play).to_have_attribute("title", re.compile(r"\w"), timeout=PATIENCE_MS)
        refused = page.evaluate(POST, ["/api/take", "/api/arm"])
        page.wait_for_timeout(300)
    else:
        pytest.fail(f"the button could not be pressed: {refused or play.get_attribute('title')}")
    line = page.locator("#arms-line")
    expect(line).to_contain_text("runs", timeout=PATIENCE_MS)
    expect(page.locator("#arms-end")).to_be_enabled(timeout=PATIENCE_MS)
    expect(page.locator("#arms-progress")).not_to_have_js_property("value", 0, timeout=PATIENCE_MS)
    page.click("#arms-end")
    expect(line).to_contain_text("ended early: stop requested by the operator", timeout=PATIENCE_MS)
    expect(play).to_be_enabled(timeout=PATIENCE_MS)  # no fault: the next one may begin at once

    open_log(page, "playback")
    expect(line).to_contain_text("At most", timeout=PATIENCE_MS)  # and not the line of the other log's playback
    ghost = page.locator("#ghost")
    expect(ghost).to_be_hidden()
    canvas = page.frame_locator("#scene").locator("canvas").first
    expect(canvas).to_be_visible(timeout=PATIENCE_MS)
    before = yellow(canvas)
    page.locator("#other").select_option(label=page.locator("#other option", has_text="demonstration").inner_text())
    expect(ghost).to_contain_text(re.compile("demonstration.* at"), timeout=PATIENCE_MS)
    for _ in range(60):
        if yellow(canvas) > before + 300:
            break
        page.wait_for_timeout(500)
    else:
        raise AssertionError("the ghost is not in the scene")
    page.select_option("#speed", "0.1")
    page.click("h1")
    page.keyboard.press("p")
    expect(page.locator("#now")).not_to_have_text("0.000 s", timeout=PATIENCE_MS)
    page.keyboard.press("p")
    expect(page.locator("#play")).to_have_text("Play", timeout=PATIENCE_MS)
    paused_s = both_at(page)
    assert paused_s < page.locator("#slider").evaluate("slider => Number(slider.max)") / 2
    page.select_option("#speed", "4")
    page.click("#play")
    expect(page.locator("#play")).to_have_text("Play", timeout=PATIENCE_MS)  # at the end
    assert both_at(page) > paused_s
    box = page.locator("#slider").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert paused_s < both_at(page) < page.locator("#slider").evaluate("slider => Number(slider.max)")
    page.click("#overlays button")
    expect(ghost).to_be_hidden(timeout=PATIENCE_MS)
    assert console.errors == []


def both_at(page: Page) -> float:
    """Where the cursor stands, s, once the ghost is there too: aligned at the start, to a sample."""
    now_s = float(page.locator("#now").inner_text().split()[0])
    times = "|".join(re.escape(f"{now_s - late_s:.3f}") for late_s in (0.0, 0.001))
    expect(page.locator("#ghost .at")).to_have_text(re.compile(f"at ({times}) s"), timeout=PATIENCE_MS)
    return now_s


def yellow(canvas) -> int:
    """How many pixels have the ghost's colour, #F0E442 through which the rest is seen."""
    pixels = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    red, green, blue = pixels[..., 0], pixels[..., 1], pixels[..., 2]
    return int(((abs(red - green) < 30) & (red - blue > 45) & (green > 60)).sum())
