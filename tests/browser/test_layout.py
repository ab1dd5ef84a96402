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

LONG_FAULT = (
    "safety stop: left arm: the end effector is too fast: 1.613 m/s at joint 4, allowed 1.5 m/s; the arm was stopped "
    "within 0.12 s and stands at (0.51, 0.20, 0.33) m of the world"
)
WHOLE = """(element) => {
  const [own, band] = [element, element.closest('.cell-state')].map((each) => each.getBoundingClientRect());
  return element.scrollWidth <= element.clientWidth + 1 && own.right <= band.right && own.bottom <= band.bottom + 1;
}"""


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
        expect(page.locator("#remedy")).to_contain_text("Move slower;")
        still("fault")
    finally:
        stage.end()
    expect(band).to_have_attribute("data-state", "disarmed")
    still("recovered")


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (390, 844), (640, 360)])
def test_stop_and_a_long_fault_fit_and_the_page_keeps_its_half(stage, width, height):
    page, stop = stage.page, stage.page.locator("#stop")
    page.set_viewport_size({"width": width, "height": height})  # the last one: 1280 x 720 at a zoom of 200 %
    page.goto("/")
    band = page.locator("#control-light")
    expect(band).to_have_attribute("data-state", "disarmed")
    try:
        stage.bring_about("moving")
        expect(band).to_have_attribute("data-state", "moving")
        page.click("#stop")
        expect(stop).to_have_text("STOPPING")
        assert stop.evaluate("stop => stop.scrollWidth <= stop.clientWidth && stop.scrollHeight <= stop.clientHeight")
        stage.end()
        stage.served.job_manager.authority.fault(LONG_FAULT)
        expect(page.locator("#control-line")).to_have_text(f"S{LONG_FAULT[1:]}.")
        for part in ("#control-line", "#remedy"):
            assert page.locator(part).evaluate(WHOLE), part
        box, bar, nav = (page.locator(each).bounding_box() for each in ("#stop", "#bar", ".rail"))
        assert box is not None
        assert bar is not None
        assert nav is not None
        assert (box["width"] >= 96, box["height"] >= 44) == (True, True)
        assert box["y"] + box["height"] <= height
        below = box["height"] if width == 390 else 0.0
        across = nav["height"] if width < 900 else 0.0
        assert height - bar["height"] - across - below >= height / 2
    finally:
        stage.end()


def test_further_pages_are_in_a_menu_and_the_keys_open_at_their_top(stage):
    page, further, menu = stage.page, stage.page.locator("#further"), stage.page.locator("#further-pages")
    page.set_viewport_size({"width": 1280, "height": 720})
    page.goto("/access")
    expect(page.locator(".rail > a")).to_have_text(["Operate", "Trials", "Campaigns", "Logs"])
    expect(further).to_have_attribute("data-here", "")
    further.focus()
    page.keyboard.press("Enter")
    expect(further).to_have_attribute("aria-expanded", "true")
    expect(menu.locator("[aria-current]")).to_have_text("Access")
    page.keyboard.press("Escape")
    expect(further).to_have_attribute("aria-expanded", "false")
    expect(further).to_be_focused()
    page.goto("/")
    for how in (lambda: (page.click("#further"), page.click("#keys")), lambda: page.keyboard.press("?")):
        how()
        help, bar = page.locator("#help"), page.locator("#bar").bounding_box()
        expect(help).to_be_visible()
        expect(menu).to_be_hidden()
        box = help.bounding_box()
        assert help.evaluate("help => help.scrollTop") == 0
        assert box is not None
        assert bar is not None
        assert box["y"] >= bar["y"] + bar["height"]
        page.keyboard.press("Escape")
        expect(help).to_be_hidden()
