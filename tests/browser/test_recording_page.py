"""The page of a recording shows its curves, their values at the pointer, and a part of them, in a real Chromium."""

import re

import pytest
from playwright.sync_api import Locator, expect

pytestmark = [pytest.mark.browser, pytest.mark.alone]
FINDS_DEMONSTRATION = True
PATIENCE_MS = 60_000
EDGE_PX = 66  # the axis is left of it


def time_at(area: Locator, x: float) -> float:
    """Move the pointer to `x` px in the curves; return the time that is told there, s."""
    area.hover(position={"x": x, "y": 40})
    told = area.locator("xpath=..").locator("output")
    expect(told).to_have_text(re.compile(r"^\d+\.\d{3} s: left( -?\d+\.\d{3})+, right( -?\d+\.\d{3})+$"))
    return float(told.inner_text().split()[0])


def test_the_curves_have_values_at_the_pointer_and_zoom(console):
    page = console.page
    page.goto("/logs")
    page.select_option("#kind", "demonstration")
    link = page.locator("#logs tbody a[href^='/logs/']").first
    page.goto((link.get_attribute("href") or "").replace("/logs/", "/recordings/"))
    for name in ("velocity", "force", "whole-velocity", "whole-force"):
        expect(page.locator(f"#{name}")).to_have_attribute("data-points", re.compile("[1-9]"), timeout=PATIENCE_MS)
    area = page.locator("#velocity")
    box = area.bounding_box()
    assert box is not None
    right = box["width"] - 14
    whole = time_at(area, EDGE_PX), time_at(area, right)
    assert 0.7 < whole[1] - whole[0] < 0.9  # 0.4 s around the impact
    middle = [time_at(area, EDGE_PX + share * (right - EDGE_PX)) for share in (0.4, 0.6)]

    page.mouse.move(box["x"] + EDGE_PX + 0.4 * (right - EDGE_PX), box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + EDGE_PX + 0.6 * (right - EDGE_PX), box["y"] + 40)
    page.mouse.up()
    assert [time_at(area, EDGE_PX), time_at(area, right)] == pytest.approx(middle, abs=0.01)
    area.dblclick(position={"x": 200, "y": 40})
    assert (time_at(area, EDGE_PX), time_at(area, right)) == whole


def pixels(page, colour: str) -> int:
    """How many pixels of the first plot have the hue of a token, in the middle of its height."""
    return page.evaluate(
        """async (token) => {
            const wanted = getComputedStyle(document.documentElement).getPropertyValue(`--${token}`).trim();
            const canvas = document.querySelector('#velocity canvas');
            const parse = (text) => [1, 3, 5].map((place) => parseInt(text.slice(place, place + 2), 16));
            const [r, g, b] = parse(wanted);
            const { data } = canvas.getContext('2d').getImageData(0, Math.round(canvas.height / 4), canvas.width, 1);
            let found = 0;
            for (let at = 0; at < data.length; at += 4)
                if (Math.abs(data[at] - r) + Math.abs(data[at + 1] - g) + Math.abs(data[at + 2] - b) < 40 && data[at + 3] > 30) found += 1;
            return found;
        }""",  # noqa: E501
        colour,
    )


def test_a_part_is_used_and_accepted_by_one_key_and_the_page_says_so_at_once(console):
    page = console.page
    assert pixels(page, "mode-interim") > 20  # the exclusion interval
    expect(page.locator("#episodes li")).to_have_count(1)
    expect(page.locator("#episodes img")).to_have_attribute("src", re.compile("^blob:"), timeout=PATIENCE_MS)
    page.click("#part summary")
    page.fill("#from", "5.0")  # behind the impact
    page.keyboard.press("Tab")
    expect(page.locator("#verdict")).to_have_text(
        re.compile("No reference can be made: no impact is in the part that is used: widen the part"),
        timeout=PATIENCE_MS,
    )
    expect(page.locator("#episodes small")).to_contain_text("no reference from this part")
    page.fill("#from", "0.4")
    page.keyboard.press("Tab")
    expect(page.locator("#verdict")).to_contain_text("not kept yet", timeout=PATIENCE_MS)
    expect(page.locator("#facts")).to_contain_text("0.400 s to")
    page.fill("#name", "a short way")
    page.locator("h2").first.click()
    page.keyboard.press("a")
    expect(page.locator("#verdict")).to_have_text("Accepted: trials may follow it.")
    expect(page.locator("#episodes small")).to_contain_text("accepted")
    there = page.url
    page.goto("/")
    row = page.locator("#logs tbody tr", has_text="a short way")
    row.get_by_role("link", name="accepted").click()
    expect(page).to_have_url(there)
    expect(page.locator("#from")).to_have_value("0.4")
    expect(page.locator("#verdict")).to_have_text("Accepted: trials may follow it.", timeout=PATIENCE_MS)


def test_the_largest_speed_is_offered_before_it_is_played(console):
    page = console.page
    page.click("#on-arms summary")
    page.locator(".arms").hover()
    line = page.locator("#arms-line")
    expect(line).to_have_text(re.compile(r"^At most \d(\.\d+)?x"), timeout=PATIENCE_MS)
    fastest = float(re.findall(r"most ([\d.]+)x", line.inner_text())[0])
    speeds = [float(text[:-1]) for text in page.locator("#arms-speed option").all_inner_texts()]
    assert max(speeds) == fastest
    assert len(speeds) == len(set(speeds)) > 2
