"""What became of an episode, by one key straight after it, in a real Chromium."""

import json

import pytest
from playwright.sync_api import expect

from rtstack.live.protocol import JobState

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.timeout(600)]
ROW, LINE = "#episode-outcome", "#outcome-line"
READ_MS = 240_000  # until the references of a recording are extracted


def episode(stage):
    """End a demonstration that the page has seen run, and say so."""
    stage.bring_about("moving")
    expect(stage.page.locator("#job-line")).to_contain_text(") runs.")
    assert stage.page.locator(ROW).is_hidden()
    stage.arms.dq = 0.0
    stage.served.job_manager.finished(JobState.DONE, None, True, "demonstration.mcap")
    expect(stage.page.locator(ROW)).to_be_visible()


def said(stage):
    """The verdict and the acceptance that stand beside the log."""
    files = (stage.served.logs / f"demonstration.mcap.{kind}.json" for kind in ("remarks", "accepted"))
    return tuple(json.loads(path.read_text())["verdict"] if path.exists() else None for path in files)


@pytest.fixture
def page(stage):
    page = stage.page
    page.goto("/")
    while stage.served.job_manager.authority.view().holder is None:  # a page that was held up loses it again
        page.click("#take", force=True)
        page.wait_for_timeout(300)
    yield page
    stage.end()


def test_one_key_says_it_the_list_shows_it_and_again_only_makes_ready(stage, page):
    episode(stage)
    page.locator("#filter").focus()
    page.keyboard.type("n")  # in a field it is a letter
    expect(page.locator(LINE)).to_be_empty()
    page.fill("#filter", "")
    page.locator(".logs h2").click()
    page.keyboard.press("n")
    expect(page.locator(LINE)).to_have_text("Kept as a failure.")
    expect(page.locator("#logs td.outcome .tag")).to_have_text("failed")
    assert said(stage) == ("failed", "rejected")
    page.keyboard.press("P")
    expect(page.locator(LINE)).to_have_text("Accepted: trials may follow demonstration.mcap.", timeout=READ_MS)
    expect(page.locator("[data-outcome=kept]")).to_have_attribute("aria-pressed", "true")
    assert said(stage) == ("kept", "accepted")
    expect(page.locator("#episode-count")).to_have_text("1 kept of 1 today")
    page.click("#follow")
    expect(page.locator("#trial")).to_be_visible()
    expect(page.locator("#trial [name=reference]")).to_have_value(stage.ids["log"])
    # a pedal's key, chosen once
    page.click(f"{ROW} summary")
    page.fill("#key-again", "1")
    page.click(f"{ROW} summary")
    before = stage.served.trail()
    page.keyboard.press("1")
    expect(page.locator(LINE)).to_have_text("Discarded: data sets leave it out.", timeout=READ_MS)
    assert said(stage) == ("discard", "rejected")
    expect(page.locator("#demonstration button[type=submit]")).to_be_visible()  # its tab
    assert [action for action, _ in stage.served.trail()[len(before) :] if action == "begin"] == []
    page.reload()
    expect(page.locator("#key-again")).to_have_value("1")
    assert page.locator(ROW).is_hidden()  # another visit has not seen it run


@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_the_row_fits(stage, page, width):
    page.set_viewport_size({"width": width, "height": 844})
    episode(stage)
    for opened in (False, True):
        if opened:
            page.click(f"{ROW} summary")
        assert page.locator("body").evaluate("each => each.scrollWidth <= innerWidth")
        assert page.locator(ROW).evaluate("each => each.scrollWidth <= each.clientWidth")
        for name in ("kept", "failed", "discard", "again"):
            box = page.locator(f"[data-outcome={name}]").bounding_box()
            assert box is not None
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width
