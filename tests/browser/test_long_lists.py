"""The page Logs with hundreds of logs: only rows in sight are there, and what is done concerns what is in the list."""

import os

import pytest
from playwright.sync_api import expect

from tests.support.console.review_log import write_log
from tests.support.console.served_console import serve_console

pytestmark = pytest.mark.browser
MANY = 300


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    """A signed-in page beside many logs of one trial, a file that is no log, and a demonstration of an exercise."""
    folder = tmp_path_factory.mktemp("many") / "logs"
    folder.mkdir()
    first = folder / "log-000.mcap"
    write_log(first, {"kind": "trial", "controller": "proposed", "object": "rice_box"}, {"success": "true"})
    for number in range(1, MANY):
        os.link(first, folder / f"log-{number:03}.mcap")
    (folder / "other.mcap").write_text("of another program")
    with serve_console(folder) as served:
        context = browser.new_context(viewport={"width": 1280, "height": 720}, base_url=served.base)
        page = context.new_page()
        page.goto(f"/?token={served.parts.sign_in.token}")
        page.goto("/logs")
        expect(page.locator("#count")).to_contain_text(f"{MANY + 1} logs")
        yield page
        context.close()


def rows(page):
    return page.locator("#logs tbody tr")


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (390, 844)])
def test_a_long_list_has_the_rows_in_sight_and_a_page_as_high_as_its_window(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    page.goto("/logs")
    expect(rows(page).first).to_be_visible()
    assert rows(page).count() < 130
    assert page.evaluate("document.documentElement.scrollHeight") < 2 * height
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    place = page.locator(".table:has(#logs)")
    tall = place.evaluate("place => place.scrollHeight")
    assert tall > MANY * 30
    place.evaluate("place => { place.scrollTop = place.scrollHeight; }")
    last = page.locator(f"#logs tr[aria-rowindex='{MANY + 2}']")
    last.scroll_into_view_if_needed()
    expect(last).to_be_in_viewport()
    assert rows(page).count() < 130
    assert place.evaluate("place => place.scrollHeight") == pytest.approx(tall, rel=0.02)
    assert max(rows(page).evaluate_all("rows => rows.map((row) => row.offsetHeight)")) <= 60  # two lines


def test_size_and_file_are_in_sight_in_the_smallest_window_and_arrow_keys_go_on_beyond_what_is_there(page):
    page.set_viewport_size({"width": 1280, "height": 720})
    page.goto("/logs")
    for column in ("size_bytes", "file"):
        expect(rows(page).first.locator(f"[data-column={column}]")).to_be_in_viewport(ratio=1.0)
    page.locator("#logs tbody a[href^='/logs/']").first.focus()
    for _ in range(120):
        page.keyboard.press("ArrowDown")
    focused = page.locator("#logs tr:has(a:focus)")
    expect(focused).to_be_in_viewport()
    assert int(focused.get_attribute("aria-rowindex") or 0) > 110


def test_a_tick_that_is_filtered_away_counts_no_longer(page):
    page.goto("/logs")
    expect(page.locator("#picked")).to_be_hidden()
    page.locator("#tick-all").check()
    expect(page.locator("#picked-count")).to_have_text(f"{MANY + 1} ticked")
    expect(page.locator("#compare")).to_be_disabled()
    page.fill("#query", "log-04")
    expect(page.locator("#describe")).to_be_disabled()  # until its rows are there
    expect(rows(page)).to_have_count(10)
    expect(page.locator("#picked-count")).to_have_text("10 ticked")
    page.fill("#query", "")
    expect(page.locator("#count")).to_contain_text(f"{MANY + 1} logs")
    expect(page.locator("#picked-count")).to_have_text("10 ticked")
    page.click("#untick")
    expect(page.locator("#picked")).to_be_hidden()


def test_a_file_of_another_program_is_named_so_and_a_log_that_is_not_there_is_said(page):
    page.fill("#query", "other.mcap")
    expect(rows(page)).to_have_count(1)
    expect(rows(page).locator("[data-column=kind]")).to_have_text("unknown file")
    page.fill("#query", "")
    page.goto(f"/logs/{'0' * 32}")
    expect(page.locator("body")).to_contain_text("This log does not exist.")
