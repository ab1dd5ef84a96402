"""The page in a real Chromium against a real stack: what an operator sees and does."""

import io
import re
import time

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

from rtstack.live.protocol import RunRequest
from rtstack.log.reader import read_log
from rtstack.safety.arming import LEASE_S
from rtstack.trials.specification import DemonstrationSpecification
from tests.support.console.chromium import centre_of_hue
from tests.support.console.look import switch_theme

pytestmark = [pytest.mark.browser, pytest.mark.alone]
FINISHED_MS = 120_000
ATTEMPTS = 5


def test_both_arms_say_their_state_and_its_age(console):
    page = console.page
    for side in ("left", "right"):
        expect(page.locator(f"#light-{side} .word")).to_have_text("idle", timeout=30_000)
    expect(page.locator("#age .value")).to_have_text(re.compile(r"^\d+ ms$"))
    expect(page.locator("#loop")).to_have_text(re.compile(r"^[\d.]+ / [\d.]+ ms / \d+$"))
    expect(page.locator(".badge")).to_have_text("SIMULATED")
    box = page.locator("#stop").bounding_box()
    assert box is not None
    assert box["width"] >= 96
    assert box["height"] >= 44
    assert box["x"] + box["width"] > 1400
    assert box["y"] < 56


def test_the_scene_shows_both_pads_and_the_object(console):
    canvas = console.page.frame_locator("#scene").locator("canvas").first
    expect(canvas).to_be_visible(timeout=60_000)
    # the left pad is blue and on the left, the right one orange and on the right
    expected = {"left": (86, 180, 233), "right": (230, 159, 0)}
    for _ in range(30):
        image = Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")
        places = {side: centre_of_hue(image, colour, 80) for side, colour in expected.items()}
        if all(place is not None for place in places.values()):
            break
        console.page.wait_for_timeout(1000)
    assert places["left"] is not None
    assert places["right"] is not None
    assert places["left"] < image.width / 2 < places["right"]
    assert len(np.unique(np.asarray(image).reshape(-1, 3), axis=0)) > 200


def test_what_cannot_act_says_why_until_somebody_has_armed(console):
    page = console.page
    phase, holder, why = page.locator("#control-light .word"), page.locator("#holder"), "#demonstration [data-why]"
    expect(phase).to_have_text("disarmed")
    expect(holder).to_have_text("no operator has control")
    expect(page.locator("#demonstration button[type=submit]")).to_be_disabled()
    expect(page.locator(why)).to_contain_text("take control first")
    for name, reason in (("release", "You do not have control"), ("arm", "Take control first")):
        expect(page.locator(f"#{name}")).to_be_disabled()
        expect(page.locator(f"#{name}")).to_have_attribute("title", reason)
    expect(page.locator("#recover")).to_be_hidden()
    page.fill("#operator", "anna")
    page.click("#take")
    expect(holder).to_have_text("you, anna")
    expect(page.locator(why)).to_contain_text("arm them first")
    page.click("#arm")
    expect(phase).to_have_text("armed")
    expect(page.locator("#demonstration button[type=submit]")).to_be_enabled()
    page.click("#disarm")
    expect(phase).to_have_text("disarmed")
    page.click("#release")
    expect(holder).to_have_text("no operator has control")
    expect(page.locator("#event")).to_contain_text("anna released control")
    if page.locator("#logs tbody tr").count() == 0:
        console.arm()
        expect(page.locator("#trial button[type=submit]")).to_be_disabled()
        expect(page.locator("#trial [data-why]")).to_contain_text("record a demonstration first")
        expect(page.locator("#empty")).to_contain_text("Record a demonstration")


def test_a_page_that_is_open_keeps_control_and_a_closed_one_loses_it(console, program):
    console.arm()
    console.page.wait_for_timeout(1500 * LEASE_S)
    assert (program.robot.status().holder, program.robot.status().phase) == ("anna", "armed")
    console.page.goto("about:blank")
    deadline_s = time.monotonic() + 30.0
    while program.robot.status().holder is not None:
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
    assert program.robot.status().phase == "disarmed"
    console.page.goto(console.address.split("?")[0])
    expect(console.page.locator("#holder")).to_have_text("no operator has control")


def test_another_operator_is_named_and_can_be_taken_over_from_while_nothing_moves(console, program):
    page = console.page
    take = page.locator("#take")
    program.robot.take("ben", over_from="anna")
    expect(page.locator("#holder")).to_have_text("ben")
    expect(take).to_have_text("Ask for control")
    expect(page.locator("#demonstration [data-why]")).to_contain_text("ben has control")
    page.fill("#operator", "anna")
    take.click()
    expect(take).to_be_disabled()
    expect(take).to_have_text("Take over")  # ben does not answer
    expect(take).to_have_attribute("title", re.compile("Take over: ben loses control"))
    take.click()
    expect(page.locator("#holder")).to_have_text("you, anna")
    assert "anna took over from ben" in page.request.get("/api/events").text()


def test_an_operator_who_goes_in_a_motion_leaves_a_fault_that_the_page_shows_and_recovers(console, program):
    page = console.page
    phase, fault = page.locator("#control-light .word"), page.locator("#control-line")
    program.robot.take("ben", over_from="anna")
    program.robot.arm("ben")
    program.robot.start(RunRequest(DemonstrationSpecification(), "ben"))
    expect(phase).to_have_text("moving")
    expect(page.locator("#take")).to_be_disabled()
    expect(page.locator("#take")).to_have_attribute("title", re.compile("once nothing moves"))
    program.go()
    expect(phase).to_have_text("fault", timeout=FINISHED_MS)
    expect(fault).to_contain_text("Lost the operator's page for")
    expect(page.locator("#demonstration [data-why]")).to_contain_text("recover first")
    expect(page.locator("#arm")).to_be_disabled()
    expect(page.locator("#recover")).to_be_enabled(timeout=FINISHED_MS)
    expect(page.locator("#remedy")).to_contain_text("Press Recover, take control")
    _fits(page, "#recover", "#control-line", "#remedy a", "#take")
    page.click("#recover")
    expect(page.locator("#control-light")).to_have_attribute("data-phase", "disarmed")  # and holding, perhaps
    expect(fault).not_to_contain_text("gone")
    expect(page.locator("#remedy")).to_be_hidden()
    expect(page.locator("#recover")).to_be_hidden()


def _fits(page, *selectors):
    """Everything is inside of the smallest window."""
    page.set_viewport_size({"width": 1280, "height": 720})
    for selector in selectors:
        box = page.locator(selector).bounding_box()
        assert box is not None
        assert box["x"] + box["width"] <= 1280, selector
        assert box["y"] + box["height"] <= 720, selector
    page.set_viewport_size({"width": 1440, "height": 900})


def test_a_recording_becomes_the_reference_of_a_trial_whose_log_comes_down(recorded, tmp_path):
    page = recorded.page
    rows = page.locator("#logs tbody tr")
    before = rows.count()
    page.click("#tab-trial")
    page.select_option("#trial [name=law_inertia]", "M")
    recorded.start_trial("no_interim", "10")
    page.eval_on_selector("#trial [name=law_inertia]", "field => { field.value = ''; }")
    expect(page.locator("#progress-row")).to_be_visible()
    expect(page.locator("#demonstration button[type=submit]")).to_be_disabled()
    expect(page.locator("#demonstration [data-why]")).to_contain_text("is running")
    expect(page.locator("#progress-row")).to_be_hidden(timeout=FINISHED_MS)
    expect(rows).to_have_count(before + 1, timeout=60_000)
    row = rows.first
    for text in ("trial", "no interim", "rice box", "10"):
        expect(row).to_contain_text(text)
    expect(row.locator(".outcome")).to_have_text(re.compile("^(success|unexpected impact|failed: .+)$"))
    with page.expect_download() as download:
        row.locator("a[download]").click()
    path = tmp_path / "trial.mcap"
    download.value.save_as(path)
    log = read_log(path)
    assert log.complete
    assert log.metadata["result"]["controller"] == "no_interim"
    assert log.metadata["trial"]["law_inertia"] == "M"
    assert log.metadata["result"]["displacement_mm"] == "10.0"
    assert len(log.topic("/left/arm")) > 1000


def test_a_trial_ends_in_a_card_from_which_its_log_opens_and_it_is_run_again(recorded):
    """The card after a trial that failed and one that did not; rows, the form and the events beside it."""
    page = recorded.page
    card, form = page.locator("#trial-card"), page.locator("#trial")
    page.click("#tab-trial")
    recorded.arm()
    page.fill("#trial input[name=yaw_deg]", "170")  # a turn that the form takes and no start does
    page.click("#trial button[type=submit]")
    errors, line = page.locator("#errors .error"), page.locator("#job-line")
    expect(line).to_contain_text("allowed are", timeout=FINISHED_MS)
    expect(card).to_be_hidden()  # nothing has run, and nothing was logged
    expect(page.locator("#control-light .word")).to_have_text("armed")
    expect(errors).to_have_count(0)  # the line says it
    page.fill("#trial input[name=yaw_deg]", "0")
    recorded.start_trial("proposed", "-15")
    expect(card).to_be_hidden()
    expect(card).to_be_visible(timeout=FINISHED_MS)
    expect(page.locator("#card-ending")).to_have_text("success")
    expect(page.locator("#card-what")).to_have_text("proposed, rice box, -15 mm, seed 0")
    expect(card.locator(".numbers .value")).to_have_text([re.compile(r"^[\d.]+$")] * 3)
    expect(card.locator(".numbers .before").nth(1)).to_contain_text("before")
    drawn = "canvas => new Set(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data).size"
    assert page.locator("#card-plot").evaluate(drawn) > 50

    # the form keeps what was set, on a reload and after another page; the rows open their logs by click and by keys
    page.goto("/logs")
    rows = page.locator("#logs tbody tr")
    expect(rows.first.locator("td.when")).to_have_text(re.compile(r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d$"))
    page.goto("/")
    expect(form.locator("[name=displacement_mm]")).to_have_value("-15")
    expect(form.locator("[name=controller]")).to_have_value("proposed")
    expect(card).to_be_visible()
    opened = (page.locator("#card-open").get_attribute("href") or "").split("?")[0]
    rows.first.locator("td.outcome").click()
    expect(page).to_have_url(re.compile(opened))
    page.goto("/")
    rows.first.locator("a").first.focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile(opened))
    page.goto("/")

    recorded.arm()
    page.click("#card-again-shifted")
    expect(card).to_be_hidden()
    expect(card).to_be_visible(timeout=FINISHED_MS)
    expect(page.locator("#card-what")).to_have_text("proposed, rice box, -5 mm, seed 0")
    expect(rows.first).to_contain_text("-5")
    page.click("#event")
    expect(page.locator("#events")).to_contain_text("impact")
    times = page.locator("#events time")  # newest first, by one clock
    seen = [text for text in times.all_inner_texts() if text]
    assert len(seen) == page.locator("#events li").count()
    assert seen == sorted(seen, reverse=True)
    page.click("#event")
    page.click("#card-compare")
    expect(page).to_have_url(re.compile(r"/logs/[0-9a-f]+\?.*other="))
    page.goto("/")


@pytest.mark.parametrize("way", ["space bar in the scene", "cancel"])
def test_stop_stops_a_trial(recorded, way):
    """By the button and the space bar: test_dead_man, test_stop_anywhere."""
    page = recorded.page
    rows = page.locator("#logs tbody tr")
    before = rows.count()
    recorded.start_trial("proposed", "0")
    if way == "cancel":
        page.click("#cancel")
    else:
        page.locator("#scene").click()
        page.keyboard.press("Space")
    expect(page.locator("#job-line")).to_contain_text("was stopped", timeout=FINISHED_MS)
    expect(page.locator("#progress")).not_to_have_attribute("value", "1")
    expect(rows).to_have_count(before + 1, timeout=60_000)
    expect(rows.first.locator(".outcome")).to_contain_text("stop requested")
    expect(page.locator("#stop")).to_have_text("STOP")
    expect(page.locator("#light-left .word")).to_have_text("idle", timeout=30_000)
    expect(page.locator("#control-light .word")).to_have_text("disarmed")


def test_a_person_may_push_the_arms_while_the_button_is_held(recorded):
    page, button, line = recorded.page, recorded.page.locator("#guide"), recorded.page.locator("#job-line")
    led_or_lost = page.locator("#light-left[data-mode=TELEOPERATION], #control-light[data-phase=fault]")
    for ends, said in (
        (page.mouse.up, "Guiding .* succeeded"),
        (lambda: page.keyboard.press("Space"), "Guiding .* was stopped"),
    ):
        for _ in range(ATTEMPTS):  # a page that is held up for 0.3 s lets go of the arms by itself
            recorded.arm()
            box = button.bounding_box()
            page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.mouse.down()
            expect(line).to_contain_text(re.compile("Guiding"), timeout=FINISHED_MS)
            expect(led_or_lost.first).to_be_visible(timeout=FINISHED_MS)
            ends()
            expect(line).to_contain_text(re.compile("Guiding .* (succeeded|stopped|ended|failed)"), timeout=FINISHED_MS)
            page.mouse.up()
            if page.locator("#control-light[data-phase=fault]").count() == 0:
                break
            page.click("#recover")
        expect(line).to_contain_text(re.compile(said))
    recorded.arm()


def test_every_control_fits_into_the_smallest_window(recorded):
    page = recorded.page
    if page.locator("#card-away").is_visible():
        page.click("#card-away")  # of a trial before; with it the column is scrolled
    for form in ("demonstration", "trial"):
        page.click(f"#tab-{form}")
        button = f"#{form} button[type=submit]"
        _fits(page, "#stop", "#take", "#disarm", "#event", button)
        page.set_viewport_size({"width": 1280, "height": 720})
        column, box = (page.locator(selector).bounding_box() for selector in (".column", button))
        assert box["y"] + box["height"] <= column["y"] + column["height"], form
        page.set_viewport_size({"width": 1440, "height": 900})


def test_the_theme_changes_and_stays(console):
    page = console.page
    root = page.locator("html")
    expect(root).to_have_attribute("data-theme", "dark")
    switch_theme(page)
    expect(root).to_have_attribute("data-theme", "light")
    page.reload()
    expect(root).to_have_attribute("data-theme", "light")
    switch_theme(page)


def test_nothing_was_fetched_from_elsewhere_and_no_script_failed(console, printed_address):
    ours = printed_address.split("/?")[0]
    foreign = [url for url in console.requests if not url.startswith((ours, "blob:", "data:"))]
    assert foreign == []
    assert console.errors == []
