"""Pictures, curves and scene at one cursor, in a real Chromium."""

import pytest
from playwright.sync_api import expect

from tests.support.console.review_log import MS, stamped_pictures, time_in, write_log
from tests.support.console.served_console import serve_console

pytestmark = [pytest.mark.browser, pytest.mark.long]
TRIAL = {"kind": "trial", "object": "rice_box", "seed": "1", "specification": "{}"}


def test_pictures_follow_the_cursor_and_a_key_goes_from_one_to_the_next(browser, tmp_path):
    write_log(tmp_path / "seen.mcap", TRIAL, pictures=stamped_pictures({"front": 33, "side": 100}))
    with serve_console(tmp_path) as served:
        context = browser.new_context(base_url=served.base)
        page = context.new_page()
        page.set_default_timeout(60_000)
        page.goto(f"/?token={served.parts.sign_in.token}")
        seen = context.request.get("/api/logs").json()[0]["id"]
        page.goto(f"/logs/{seen}?t=1.0")
        expect(page.locator("#cameras img")).to_have_count(2, timeout=60_000)
        first, second = page.locator("#cameras img").all()
        expect(first).to_have_attribute("data-t", "0.99")
        page.locator("#plots").press(".")
        expect(first).to_have_attribute("data-t", "1.023")
        expect(second).to_have_attribute("data-t", "1")
        expect(page.locator("#now")).to_have_text("1.023 s")
        assert time_in(context.request.get(first.get_attribute("src")).body()) == 1023 * MS
        context.close()
