"""The console without a mouse: every control is reached by Tab and shows its focus, and a small job is done by keys."""

import re

import pytest
from playwright.sync_api import Page, expect

pytestmark = [pytest.mark.browser, pytest.mark.alone]
PATIENCE_MS = 120_000
MOST_TABS = 200
FINDS_DEMONSTRATION = True

# where Tab has led: what it is, and whether one sees that (the sheet's ring, or of an element that stands for it)
HERE = """() => {
  const at = document.activeElement;
  const shown = at.matches('.segments input') ? at.nextElementSibling : at;
  const style = getComputedStyle(shown);
  const seen = at.tagName === 'IFRAME' || (style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2);
  const before = at.reachedBefore === true;
  at.reachedBefore = true; // of the element itself: places shift where a list comes in
  return {before, body: at === document.body, frame: at.tagName === 'IFRAME', seen, what: at.outerHTML.slice(0, 90)};
}"""
# what Tab has to reach: of a group of radio buttons and of tabs the chosen one
CONTROLS = """() => {
  const all = [...document.querySelectorAll('*')];
  const one = 'button, a[href], input, select, textarea, summary, iframe';
  const shown = (each) => each.getBoundingClientRect().width && each.checkVisibility({visibilityProperty: true});
  const kept = all.filter((each) => each.matches(one) && !each.disabled && shown(each) && each.tabIndex >= 0
    && !(each.type === 'radio' && !each.checked));
  return kept.map((each) => ({what: each.outerHTML.slice(0, 90), reached: each.reachedBefore === true}));
}"""


def tab_to(page: Page, selector: str) -> None:
    """Press Tab until this element has the focus."""
    expect(page.locator(selector).first).to_be_enabled(timeout=PATIENCE_MS)
    for _ in range(MOST_TABS):
        if page.evaluate("selector => document.activeElement.matches(selector)", selector):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"{selector} is not reached by Tab")


def press(page: Page, selector: str) -> None:
    tab_to(page, selector)
    page.keyboard.press("Enter")


def take(page: Page) -> None:
    """Take control, where this page has it not; one that was held up may have lost it."""
    holder = page.locator("#holder")
    if not holder.inner_text().startswith("you, "):
        press(page, "#take")
    expect(holder).to_have_text(re.compile("^you, "), timeout=PATIENCE_MS)


def settled(page: Page) -> None:
    """Wait until lists that are fetched have come in: the controls stay what they are."""
    before = None
    while before != (before := [each["what"] for each in page.evaluate(CONTROLS)]):
        page.wait_for_timeout(500)


@pytest.mark.parametrize(
    "address",
    ["/", *(pytest.param(each, marks=pytest.mark.long) for each in ("/trials", "/campaigns", "/logs", "/access"))],
)
def test_tab_reaches_every_control_in_the_order_of_the_page_and_shows_it(console, address):
    page = console.page
    page.goto(address)
    expect(page.locator("#light-left .word")).to_have_text("idle", timeout=PATIENCE_MS)
    settled(page)
    reached = []
    for _ in range(MOST_TABS):
        page.keyboard.press("Tab")
        here = page.evaluate(HERE)
        if here["body"] or (here["before"] and not here["frame"]):  # within the scene's frame it stays for a while
            break
        assert here["seen"], here["what"]
        if not here["before"]:
            reached.append(here["what"])
    controls = page.evaluate(CONTROLS)
    assert [each["what"] for each in controls if not each["reached"]] == []
    order = [each["what"] for each in controls]
    assert [what for what in reached if what in order] == order


def test_a_job_is_done_stopped_and_looked_at_with_the_keyboard_alone(console):
    page = console.page
    page.goto("/")
    tab_to(page, "#operator")
    page.keyboard.type("anna")
    take(page)
    expect(page.locator("#holder")).to_have_text("you, anna")
    press(page, "#arm")
    expect(page.locator("#control-light .word")).to_have_text("armed", timeout=PATIENCE_MS)
    tab_to(page, "[role=tab][aria-selected=true]")
    for _ in range(3):
        if page.locator("#tab-demonstration[aria-selected=true]").count():
            break
        page.keyboard.press("ArrowRight")
    expect(page.locator("#tab-demonstration")).to_be_focused()
    press(page, "#demonstration button[type=submit]")
    expect(page.locator("#job-line")).to_contain_text(") runs.", timeout=PATIENCE_MS)
    page.keyboard.press("Space")
    expect(page.locator("#job-line")).to_contain_text("was stopped", timeout=PATIENCE_MS)

    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    expect(page.locator("#help")).to_contain_text("STOP both arms")
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()
    press(page, "#event")
    expect(page.locator("#events li").first).to_be_visible(timeout=PATIENCE_MS)
    page.keyboard.press("Escape")
    expect(page.locator("#events")).to_be_hidden()

    press(page, ".rail a[href='/logs']")
    expect(page.locator("#logs tbody a").first).to_be_visible(timeout=PATIENCE_MS)
    press(page, "#logs tbody a[href^='/logs/']")
    expect(page.locator("#log-events li").first).to_be_visible(timeout=PATIENCE_MS)
    tab_to(page, "#signal-search")
    page.keyboard.type("left.dq.4")  # without a space: on a page that has had no news for 0.5 s that is STOP
    press(page, "#tree input[type=checkbox]")
    expect(page).to_have_url(re.compile(r"signals=[^&]*left\.dq\.4"), timeout=PATIENCE_MS)
    expect(page.locator("#legends")).to_contain_text("dq", timeout=PATIENCE_MS)
    tab_to(page, "#slider")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(page.locator("#now")).to_have_text("0.003 s", timeout=PATIENCE_MS)
    page.keyboard.press("]")
    expect(page.locator("#now")).not_to_have_text("0.003 s", timeout=PATIENCE_MS)
    assert console.errors == []


def test_a_queue_is_filled_and_ordered_with_the_keyboard_alone(console):
    page = console.page
    page.goto("/trials")
    expect(page.locator("#trial select[name=reference] option")).not_to_have_text(
        "no recording yet", timeout=PATIENCE_MS
    )
    tab_to(page, "#trial input[name=seeds]")
    page.keyboard.press("Control+A")
    page.keyboard.type("0:1")
    rows = page.locator("#queue tbody tr")
    while rows.count() < 2:
        take(page)
        press(page, "#trial button[type=submit]")
        page.wait_for_timeout(1000)
    first, second = (rows.nth(place).get_attribute("data-id") for place in (0, 1))
    tab_to(page, "#past-failures")
    page.keyboard.press("Enter")
    expect(page.locator("#past-failures")).to_be_checked()
    press(page, f"#queue tr[data-id='{second}'] button[aria-label=Earlier]")
    expect(rows.first).to_have_attribute("data-id", second or "", timeout=PATIENCE_MS)
    expect(page.locator(f"#queue tr[data-id='{second}'] button:focus")).to_have_count(1)  # and goes on with it
    press(page, f"#queue tr[data-id='{first}'] button[aria-label='Cancel this trial']")
    expect(page.locator(f"#queue tr[data-id='{first}'] td.state")).to_have_text("cancelled", timeout=PATIENCE_MS)
