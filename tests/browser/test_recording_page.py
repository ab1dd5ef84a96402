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
