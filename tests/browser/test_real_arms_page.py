"""Arms served as metal, in a real browser: the cap is shown, a run is held on any page, a shadow needs no key."""

import pytest
from playwright.sync_api import expect

from rtstack.testing import serve_arms
from tests.support.real_cell import commission, write_cell_file

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.long, pytest.mark.timeout(900)]
FINDS_DEMONSTRATION = True
# slow motion: pages are drawn by the processors that the loop needs
SLOW = ("--slower", "8")


@pytest.fixture(scope="module")
def cell_file(tmp_path_factory):
    """The file of a cell that is served, with its complete record."""
    path = tmp_path_factory.mktemp("cell") / "cell.toml"
    with serve_arms(lockstep=False, seed=3, options=SLOW) as served:
        write_cell_file(path, served.left, served.right, served.tracker)
        commission(path, until="object")
        yield path, served.left, served.right


@pytest.fixture(scope="module")
def stack_options(cell_file):
    path, left, right = cell_file
    return ("--left", left, "--right", right, "--cell-file", str(path))


def test_the_page_says_what_is_capped_and_what_is_next(console):
    expect(console.page.locator(".capped")).to_contain_text("The cell is being commissioned, capped to 0.6 m/s, 140 N")
    expect(console.page.locator(".capped")).to_contain_text("next: object (rtstack commission object --log LOG.mcap)")
    expect(console.page.locator(".badge.real")).to_be_visible()


def test_a_trial_is_refused_and_its_shadow_runs_without_a_key(console):
    page = console.page
    page.click("#tab-trial")
    console.arm()
    page.click("#trial button[type=submit]")
    expect(page.locator("#errors")).to_contain_text("not yet: a trial hits its object")
    console.errors.clear()  # the refusal is a 409
    page.check("#trial input[name=shadow]")
    page.click("#trial button[type=submit]")
    expect(page.locator("#job-line")).to_contain_text("shadow: no torque was sent")
    page.uncheck("#trial input[name=shadow]")


def test_a_run_is_held_on_another_page(console):
    page = console.page
    page.click("#tab-demonstration")
    console.arm()
    page.click("#demonstration button[type=submit]")
    expect(page.locator("#job-line")).to_contain_text("hold C")
    page.goto(page.url.split("?")[0].rstrip("/") + "/logs")
    hold = page.locator("#hold")
    expect(hold).to_be_visible()
    hold.hover()
    page.mouse.down()
    expect(page.locator("#control-light")).to_have_attribute("data-state", "moving")
    page.wait_for_timeout(2000)
    page.mouse.up()
    expect(page.locator("#event")).to_contain_text("the operator let go")
    expect(hold).to_be_hidden()
    assert console.errors == []
