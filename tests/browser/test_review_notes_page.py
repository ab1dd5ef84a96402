"""A note at a time of a log: written, changed, removed, brought back, and there after a reload."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.console.chromium import leave_scene_undrawn
from tests.support.console.review_log import write_log
from tests.support.console.served_console import serve_console

pytestmark = pytest.mark.browser
MOST = 500  # events in the list
ACCENT = """() => {
    const canvas = document.getElementById('overview'), context = canvas.getContext('2d');
    const { width, height } = canvas, { data } = context.getImageData(0, 3, width, 1);
    const wanted = getComputedStyle(document.documentElement).getPropertyValue('--accent').trim();
    const channels = [1, 3, 5].map((place) => parseInt(wanted.slice(place, place + 2), 16));
    const found = [...Array(width).keys()].filter((px) => channels.every((each, k) => Math.abs(data[4 * px + k] - each) < 3));
    return found.length ? (found[0] + found.at(-1)) / 2 / width : null;
}"""  # noqa: E501


def test_a_note_is_kept_beside_the_log(browser, tmp_path):
    write_log(tmp_path / "noted.mcap", {"kind": "trial", "object": "rice_box", "seed": "1"})
    with serve_console(tmp_path) as served:
        page = browser.new_context(base_url=served.base, color_scheme="dark").new_page()
        page.set_default_timeout(60_000)
        leave_scene_undrawn(page)
        page.goto(f"/?token={served.parts.sign_in.token}")
        (row,) = page.request.get("/api/logs").json()
        page.goto(f"/logs/{row['id']}?t=0.5&signals=left.tau_J.4")
        rows, line = page.locator("#log-events li"), page.locator("#note-line")
        expect(rows).to_have_count(1)
        page.locator("#plots").press("n")
        expect(page.locator("#note-at")).to_have_text("0.500 s")
        page.keyboard.type("p, n: keys are letters here", delay=1)
        page.keyboard.press("Enter")
        expect(rows.first).to_contain_text("p, n: keys are letters here")
        expect(page.locator("#note")).to_be_focused()
        assert page.evaluate(ACCENT) == pytest.approx(0.5 / 1.999, abs=0.02)  # on the time line
        page.reload()
        expect(rows).to_have_count(2)
        rows.first.locator(".edit").click()
        page.fill("#note-text", "the pad slips")
        page.click("#note-form button[type=submit]")
        expect(rows.first).to_contain_text("the pad slips")
        expect(rows).to_have_count(2)
        rows.first.locator(".away").click()
        expect(rows).to_have_count(1)
        expect(line).to_have_text("Removed: the pad slips")
        assert not list(tmp_path.glob("*.notes.json"))
        page.click("#note-undo")
        expect(rows).to_have_count(2)
        expect(page.locator("#note-undo")).to_be_hidden()
        page.click("#note")
        page.keyboard.press("Escape")
        expect(page.locator("#note-form")).to_be_hidden()
        assert "the pad slips" in (tmp_path / "noted.mcap.notes.json").read_text()

        def crowded(route):
            document = route.fetch().json()
            document["events"] = [
                {"t_s": k / 2e3, "level": "INFO", "name": "tick", "text": str(k)} for k in range(MOST + 100)
            ]
            route.fulfill(json=document)

        page.route(re.compile(f"/api/logs/{row['id']}$"), crowded)
        page.reload()
        expect(rows).to_have_count(MOST + 1)
        expect(page.locator("#log-events .level[data-level=NOTE]")).to_have_count(1)
        page.context.close()
