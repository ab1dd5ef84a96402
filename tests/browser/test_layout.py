"""Nothing jumps under the pointer while control is taken, arms move, are stopped, or a fault comes."""

import pytest
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

# every shift that Chromium reports (https://wicg.github.io/layout-instability/), also those soon after an input
WATCH = """() => {
  window.shifts = [];
  new PerformanceObserver((list) => {
    for (const shift of list.getEntries()) {
      const moved = shift.sources.filter(({previousRect: p, currentRect: c}) => p.x !== c.x || p.y !== c.y);
      if (!moved.length) continue; // in its place, to the pixel: it became wider
      const what = moved.map(({node, previousRect, currentRect}) => `${node?.nodeName}#${node?.id ?? ''} `
        + `"${(node?.textContent ?? '').trim().slice(0, 30)}" ${previousRect.x},${previousRect.y} -> ${currentRect.x},${currentRect.y}`);
      window.shifts.push([shift.value, ...what]);
    }
  }).observe({type: 'layout-shift'});
}"""  # noqa: E501
KEPT = (
    "#stop",
    "#take",
    "#disarm",
    "#job",
    "#tabs",
    "#control-line",
    "main form:not([hidden]) [type=submit]",
    "#event",
)
PLACES = """(selectors) => selectors.map((selector) => {
  const element = document.querySelector(selector);
  if (!element) return null;
  const { x, y, width, height } = element.getBoundingClientRect();
  const top = element.closest('.bar') ? y : y + scrollY; // the page of a phone scrolls to what is pressed
  return selector === '#control-line' ? [x, top] : [x, top, width, height];
})"""


@pytest.mark.parametrize(
    ("address", "tab", "width", "height"),
    [
        pytest.param("/", "#tab-hand", 1280, 720, marks=pytest.mark.long),
        pytest.param("/", "#tab-demonstration", 1280, 720, marks=pytest.mark.long),
        ("/", "#tab-trial", 1280, 720),
        pytest.param("/", "#tab-trial", 1920, 1080, marks=pytest.mark.long),
        pytest.param("/", "#tab-trial", 390, 844, marks=pytest.mark.long),
        pytest.param("/trials", "", 1280, 720, marks=pytest.mark.long),
        pytest.param("/trials", "", 820, 1180, marks=pytest.mark.long),
        pytest.param("/logs", "", 1280, 720, marks=pytest.mark.long),
    ],
)
def test_nothing_jumps_on_take_arm_start_stop_and_fault(stage, address, tab, width, height):
    page = stage.page
    page.set_viewport_size({"width": width, "height": height})
    page.goto(address)
    band = page.locator("#control-light")
    expect(band).to_have_attribute("data-state", "disarmed")
    expect(page.locator("#light-left .word")).to_have_text("idle")
    if address != "/logs":
        expect(page.locator("select[name=reference] option").first).not_to_have_text("no recording yet")
    if tab:
        page.click(tab)
    page.wait_for_timeout(500)
    page.evaluate(WATCH)
    before = page.evaluate(PLACES, KEPT)

    def still(step):
        page.wait_for_timeout(300)
        assert page.evaluate("window.shifts") == [], step
        assert page.evaluate(PLACES, KEPT) == before, step

    try:
        if address != "/logs":
            page.click("#take")
            expect(page.locator("#arm")).to_be_enabled()
            still("take")
            page.click("#arm")
            expect(band).to_have_attribute("data-state", "armed")
            still("arm")
        stage.bring_about("preparing")
        expect(band).to_have_attribute("data-state", "preparing")
        still("start")
        stage.begin("moving")
        expect(band).to_have_attribute("data-state", "moving")
        still("moves")
        page.click("#stop")
        expect(page.locator("#stop")).to_have_text("STOPPING")
        still("stop")
        stage.end()
        expect(band).to_have_attribute("data-state", "disarmed")
        still("stopped")
        stage.bring_about("fault")
        expect(band).to_have_attribute("data-state", "fault")
        expect(page.locator("#remedy")).to_contain_text("What to do: slower")
        still("fault")
    finally:
        stage.end()
    expect(band).to_have_attribute("data-state", "disarmed")
    still("recovered")
