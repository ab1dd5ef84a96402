"""The panel about Desk on the page Operate, of a cell whose file names Desk of both boxes."""

import contextlib
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from hal.desk import Trust
from hal.desk.power import start
from tests.support.desk import desk_address, desk_cell_file, desk_of
from tests.support.fci.server import Served

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long]


@pytest.fixture(scope="module")
def trust(temporary: Path) -> Trust:
    """The certificates that the stack's user knows (XDG_CONFIG_HOME of `printed_address`)."""
    return Trust(temporary / "config" / "rtstack" / "desk")


@pytest.fixture(scope="module")
def stack_options(boxes: Served, trust: Trust, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    desks = [desk_address(address) for address in (boxes.left, boxes.right)]
    for desk in desks:
        trust.remember(desk)
    return ("--cell-file", str(desk_cell_file(tmp_path_factory.mktemp("cell") / "cell.toml", desks)))


def test_the_page_says_what_both_boxes_say(console, boxes, trust):
    left, right = console.page.locator("#desk-left"), console.page.locator("#desk-right")
    expect(left).to_contain_text("left brakes locked, FCI inactive, Execution, self-test in 24.0 h, system 5.9.2")
    expect(left).to_have_attribute("data-tone", "bad")
    with contextlib.closing(desk_of(boxes.left, trust)) as desk:
        list(start(desk, trust, desk_address(boxes.left)))
    expect(left).to_contain_text("brakes unlocked, FCI active")
    expect(left).to_have_attribute("data-tone", "good")
    expect(right).to_contain_text("brakes locked")
    found = Axe().run(console.page, context="#desk", options={"runOnly": ["wcag2a", "wcag2aa"], "iframes": False})
    assert found.response["violations"] == []
    column = console.page.locator(".operate .column")
    assert column.evaluate("each => each.scrollWidth <= each.clientWidth")
    assert console.errors == []
