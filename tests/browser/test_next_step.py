"""What the page Operate asks for next: one card with one button, tabs in one line, and what folds."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.console.operate_page import choose_tab, open_settings

pytestmark = [pytest.mark.browser, pytest.mark.alone, pytest.mark.timeout(600)]
MOST_TABS = 6
PLANNED_MS = 240_000
BUTTONS = ("take", "arm", "recover", "disarm")
# what a person sees in the window, and could press or fill in
IN_VIEW = """() => [...document.querySelectorAll('main .column :is(button, a[href], input, select, summary)')]
  .filter((each) => each.checkVisibility({visibilityProperty: true}) && each.getBoundingClientRect().top < innerHeight)
  .map((each) => each.id || each.textContent)"""


@pytest.fixture
def page(stage):
    page = stage.page
    page.set_viewport_size({"width": 1280, "height": 720})
    page.goto("/")
    expect(page.locator("#light-left .word")).to_have_text("idle")
    yield page
    stage.end()
    page.evaluate("localStorage.clear()")


def one_button(page, name, step):
    """The card has this button alone, and says so."""
    expect(page.locator("#step")).to_have_text(re.compile(step))
    for each in BUTTONS:
        expect(page.locator(f"#{each}")).to_be_visible(visible=each == name)


def test_the_next_step_is_a_sentence_and_one_button(stage, page):
    one_button(page, "take", "^Take control to move the arms")
    expect(page.locator("#operator")).to_be_visible()
    expect(page.locator("#release")).to_be_hidden()
    page.click("#take")
    one_button(page, "arm", "^Arm to allow motion")
    expect(page.locator("#operator")).to_be_hidden()
    expect(page.locator("#release")).to_be_visible()
    page.click("#arm")
    one_button(page, "disarm", "^Press Record below")
    page.click("#tab-plan")
    one_button(page, "disarm", "^Press Preview below")
    stage.bring_about("preparing")
    one_button(page, "disarm", "^Wait: nothing moves yet")
    expect(page.locator("#spinner")).to_be_visible()
    expect(page.locator("#cancel")).to_be_visible()
    stage.begin("moving")
    one_button(page, "disarm", "^Wait until it ends")
    expect(page.locator("#spinner")).to_be_hidden()
    stage.end()


def test_a_fault_has_its_cause_at_once_and_recover_beside_it(stage, page):
    stage.bring_about("fault")
    one_button(page, "recover", "^Press Recover once the cause is gone")
    expect(page.locator("#job-line")).to_contain_text("the end effector is too fast")


def test_the_second_press_of_a_double_one_does_not_arm(stage, page):
    box = page.locator("#take").bounding_box()
    page.click("#take")
    expect(page.locator("#arm")).to_have_attribute("data-away", "false")
    page.mouse.click(box["x"] + 20, box["y"] + 10)
    page.wait_for_timeout(500)
    assert stage.served.job_manager.authority.view().phase == "disarmed"


def test_what_both_arms_hold_is_put_down_before_the_next_run(stage, page):
    page.click("#take")
    page.click("#arm")
    run, why = page.locator("#demonstration [type=submit]"), page.locator("#demonstration [data-why]")
    page.click("#tab-demonstration")
    expect(run).to_be_enabled()
    stage.arms.squeeze_n = 30.0
    try:
        one_button(page, "disarm", "^Both arms hold an object. Press Put it down before the next run.$")
        expect(run).to_be_disabled()
        expect(why).to_have_text("the arms hold an object: press Put it down first")
        expect(page.locator("[data-motion=put_down]")).to_be_enabled()
        page.click("#tab-hand")
        expect(page.locator("#record")).to_be_enabled()
    finally:
        stage.arms.squeeze_n = 0.0
    page.click("#tab-demonstration")
    expect(run).to_be_enabled()


def test_a_key_s_press_leads_the_focus_to_the_button_that_comes(stage, page):
    page.click("#tab-demonstration")
    page.locator("#operator").focus()
    page.keyboard.press("Tab")
    expect(page.locator("#take")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#arm")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#disarm")).to_be_focused()
    page.keyboard.press("Enter")  # at once: the second one of a double press undoes nothing
    page.wait_for_timeout(500)
    assert stage.served.job_manager.authority.view().phase == "armed"
    page.locator(".skip").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#demonstration [type=submit]")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#cancel")).to_be_focused()
    expect(page.locator("#step")).to_have_text("Wait: nothing moves yet.")
    expect(page.locator("#job-line")).to_contain_text("is being prepared")


def test_control_is_a_few_keys_from_the_top_of_the_page(page):
    page.reload()
    expect(page.locator("#take")).to_be_enabled()
    for _ in range(MOST_TABS):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.className") == "skip":
            page.keyboard.press("Enter")
        if page.evaluate("document.activeElement.id") == "take":
            break
    expect(page.locator("#take")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#arm")).to_be_enabled()
    for _ in range(2):
        if page.evaluate("document.activeElement.id") != "arm":
            page.keyboard.press("Tab")
    expect(page.locator("#arm")).to_be_focused()
    page.wait_for_timeout(500)
    page.keyboard.press("Enter")
    expect(page.locator("#control-light")).to_have_attribute("data-state", "armed")


def test_the_tabs_stand_in_one_line_and_nothing_is_cut_at_the_fold(page):
    for tab in ("hand", "demonstration", "trial", "plan"):
        page.click(f"#tab-{tab}")
        column = page.locator(".column").evaluate("each => [each.scrollHeight, each.clientHeight]")
        assert column[0] <= column[1], tab
        assert len(page.evaluate(IN_VIEW)) <= 22, tab
    tops = {page.locator(f"#tab-{name}").bounding_box()["y"] for name in ("hand", "demonstration", "trial", "plan")}
    assert len(tops) == 1
    assert page.locator("#scene").bounding_box()["width"] >= 0.6 * 1280
    choose_tab(page, "calibration")
    expect(page.locator("#calibration")).to_be_visible()
    expect(page.locator("#more summary")).to_have_text("Calibrate")
    page.goto("/logs")
    page.goto("/#tab-training")
    expect(page.locator("#training")).to_be_visible()
    page.click("#tab-hand")
    expect(page.locator("#more summary")).to_have_text("More")


def test_a_menu_closes_by_escape_and_by_a_press_elsewhere(page):
    for close in (lambda: page.keyboard.press("Escape"), lambda: page.locator(".logs h2").click()):
        page.click("#view summary")
        expect(page.locator("#enlarge")).to_be_visible()
        close()
        expect(page.locator("#enlarge")).to_be_hidden()


def test_settings_and_devices_stay_as_they_were_left(page):
    page.click("#tab-hand")
    expect(page.locator("#keys-side")).to_be_hidden()
    open_settings(page)
    page.reload()
    expect(page.locator("#keys-side")).to_be_visible()
    page.click("#settings summary")
    page.reload()
    expect(page.locator("#tab-hand")).to_be_visible()
    expect(page.locator("#keys-side")).to_be_hidden()


@pytest.mark.parametrize(
    ("newtons", "level", "words"),
    [
        (44.0, "", "44 of 140 N"),
        (100.0, "near", "100 of 140 N, near the limit"),
        (130.0, "high", "nearly at the limit"),
    ],
)
def test_the_force_stands_beside_the_one_that_stops_the_arms(stage, page, newtons, level, words):
    page.click("#tab-hand")
    stage.arms.force_n = newtons
    try:
        for side in ("left", "right"):
            place = page.locator(f"#force-{side}")
            expect(place).to_contain_text(words)
            expect(place).to_have_attribute("data-level", level)
            expect(place.locator("[role=meter]")).to_have_attribute("aria-valuenow", f"{newtons:g}")
    finally:
        stage.arms.force_n = 0.0


def test_a_grab_is_planned_seen_and_chosen_as_a_reference(stage, page):
    page.click("#tab-plan")
    use, line = page.locator("#plan-use"), page.locator("#plan-line")
    expect(use).to_be_disabled()
    page.fill("#plan [name=squeeze]", "1")
    page.click("#plan [type=submit]")
    expect(page.locator("#plan-spinner")).to_be_visible()
    page.click("#plan-cancel")
    expect(line).to_contain_text("was cancelled")
    page.click("#plan [type=submit]")
    expect(line).to_contain_text("does not hold rice box", timeout=PLANNED_MS)  # by its name
    expect(use).to_be_disabled()
    page.fill("#plan [name=squeeze]", "40")
    page.click("#plan [type=submit]")
    expect(line).to_contain_text("is possible", timeout=PLANNED_MS)
    expect(page.locator("#ghost")).to_contain_text("Preview")
    use.click()
    expect(page.locator("#trial")).to_be_visible()
    expect(page.locator("#trial [name=reference] option:checked")).to_have_text(re.compile("^plan: rice box"))
    expect(page.locator("#logs tbody tr", has_text="planned")).to_have_count(1)
    (stage.served.logs / page.request.get("/api/logs?kind=plan").json()[0]["name"]).unlink()


def test_what_comes_before_the_exercise_is_known_is_not_said_beside_its_fault(stage, page):
    exercise = {"stage": "waiting", "fault": "", "job": 1, "did": None, "after_s": None, "right": None}
    view = {"faults": {}, "exercise": exercise | {"verdict": "", "todo": "", "row": ""}}
    page.route("**/api/training", lambda route: route.fulfill(json=view))
    page.goto("/logs")
    page.goto("/#tab-training")
    verdict = page.locator("#exercise-verdict")
    expect(verdict).to_have_text("It has not come yet.")
    stage.bring_about("fault")
    expect(verdict).to_have_text("Something is wrong. What do you do?")
    page.unroute("**/api/training")
