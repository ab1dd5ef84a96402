"""The page Trials in a real Chromium against a real stack: a queue is filled, ordered, run, paused and reordered."""

import csv
import re
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

pytestmark = [pytest.mark.browser, pytest.mark.alone]
FINDS_DEMONSTRATION = True
PATIENCE_MS = 120_000
COMMAND = Path(sys.executable).with_name("rtstack")


@pytest.fixture
def trials(console):
    """The page Trials, with control and armed arms."""
    page = console.page
    page.goto(console.address.split("?")[0] + "trials")
    console.arm()
    return console


@pytest.mark.long
def test_a_queue_is_filled_ordered_and_run_and_its_results_lead_to_their_logs(trials, tmp_path):
    page = trials.page
    rows = page.locator("#queue tbody tr")
    page.fill("#trial input[name=displacements_mm]", "0:ten")
    expect(page.locator("#trial .number-wrong")).to_have_text('"0:ten" is not a list: write -12.5, 5 or -60:10:60.')
    expect(page.locator("#trial input[name=displacements_mm]")).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#trial button[type=submit]")).to_be_disabled()
    page.fill("#trial input[name=displacements_mm]", "-20:20:0")
    page.fill("#trial input[name=seeds]", "5")
    page.locator("#trial details summary").click()
    page.select_option("#trial select[name=reaction]", "stop")
    expect(page.locator("#trial [data-why]")).to_have_text("2 trials, one after the other")
    page.click("#trial button[type=submit]")
    page.fill("#trial input[name=displacements_mm]", "0")
    page.locator("#trial [name=controllers][value=proposed]").uncheck()
    page.locator("#trial [name=controllers][value=contact_completion]").check()
    page.reload()  # and the form is as it was left
    expect(page.locator("#trial [name=controllers]:checked")).to_have_value("contact_completion")
    trials.arm()
    page.click("#trial button[type=submit]")
    expect(rows).to_have_count(3, timeout=PATIENCE_MS)
    expect(rows.nth(2)).to_contain_text("contact completion, stop")
    rows.nth(2).hover()
    rows.nth(2).get_by_label("Earlier").click()
    expect(rows.nth(1)).to_contain_text("contact completion, stop", timeout=PATIENCE_MS)
    rows.nth(2).hover()
    rows.nth(2).get_by_label("Cancel this trial").click()
    expect(rows.nth(2).locator("td.state")).to_have_text("cancelled", timeout=PATIENCE_MS)
    expect(page.locator("#queue-state")).to_have_text("paused")

    trials.arm()
    page.locator("#past-failures").check()
    page.click("#queue-start")
    expect(rows.nth(0).locator("td.state")).to_have_text("running", timeout=PATIENCE_MS)
    expect(page.locator("#mode-now")).to_have_text(re.compile("ante-impact|interim|post-impact"), timeout=PATIENCE_MS)
    expect(page.locator("#speed-now")).to_have_text(re.compile(r"[\d.]+ / [\d.]+ m/s"))
    expect(rows.filter(has_text=re.compile("running|being written"))).to_have_count(1)
    page.click("#queue-pause")
    expect(page.locator("#queue-reason")).to_contain_text("paused it")
    ended = re.compile("^(success|unexpected impact|failed: .+)$")  # below what waits, once: as its log says
    expect(rows.nth(2).locator("td.state")).to_have_text(ended, timeout=PATIENCE_MS)
    expect(rows).to_have_count(3)
    expect(page.locator("#queue-left")).to_have_text(re.compile("^1 of 2, .*left$"))  # what was cancelled is not done
    expect(rows.nth(0).locator("td.state")).to_have_text("waiting")
    expect(page.locator("#add")).not_to_have_attribute("open", "")  # what runs has the room

    page.click("#tab-means")
    line = page.locator("#means-table tbody tr")
    expect(line).to_have_count(1)
    expect(line).to_contain_text("proposed, rice box")
    expect(line).to_contain_text("1 of 1")
    page.click("#tab-entries")
    log = rows.nth(2).locator("a").first.get_attribute("href")
    rows.nth(2).locator("td").nth(2).click()
    expect(page).to_have_url(re.compile(f"{log}"))
    page.go_back()
    expect(rows.nth(2).locator("a").first).to_have_attribute("href", log or "", timeout=PATIENCE_MS)
    page.fill("#filter", "no_such_controller")
    expect(page.locator("#queue .empty")).to_have_text("No log matches the filter.", timeout=PATIENCE_MS)
    page.fill("#filter", "seed:5 reaction:stop waiting")
    expect(rows).to_have_count(1, timeout=PATIENCE_MS)  # what waits is found, too
    page.fill("#filter", "seed:5 reaction:stop")
    expect(rows).to_have_count(3, timeout=PATIENCE_MS)
    page.click(".list-head .menu summary")
    with page.expect_download() as download:
        page.click("#table-csv")
    download.value.save_as(tmp_path / "trials.csv")
    (row,) = csv.DictReader((tmp_path / "trials.csv").read_text().splitlines())
    assert (row["controller"], row["seed"]) == ("proposed", "5")
    page.fill("#filter", "")


def test_every_control_of_the_page_fits_into_the_smallest_window_and_no_script_failed(trials):
    page = trials.page
    page.set_viewport_size({"width": 1280, "height": 720})
    for selector in (
        "#stop",
        "#disarm",
        "#trial button[type=submit]",
        "#queue-start",
        "#filter",
        ".list-head .menu summary",
        "#mode-strip",
    ):
        box = page.locator(selector).bounding_box()
        assert box is not None, selector
        assert box["x"] + box["width"] <= 1280, selector
        assert box["y"] + box["height"] <= 720, selector
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(trials.address.split("?")[0] + "campaigns")
    expect(page.locator("#start select[name=name] option")).not_to_have_count(0, timeout=PATIENCE_MS)
    expect(page.locator("#plan")).to_have_text(re.compile(r": \d+ trials"))
    assert trials.errors == []


def test_the_form_proposes_the_object_of_its_reference(console, logs_of_stack):
    made = [str(COMMAND), "teach", str(logs_of_stack / "with-a-parcel.mcap"), "--object", "parcel"]
    subprocess.run(made, check=True, capture_output=True, timeout=PATIENCE_MS * 1e-3)
    page = console.page
    page.goto(console.address.split("?")[0] + "trials")
    reference, thing = page.locator("#trial select[name=reference]"), page.locator("#trial [name=objects]:checked")
    parcel = reference.locator("option", has_text="parcel").first
    expect(parcel).to_have_js_property("selected", True, timeout=PATIENCE_MS)  # the newest one, which nobody has chosen
    expect(thing).to_have_value("parcel")
    reference.select_option(value=reference.locator("option", has_text="rice box").first.get_attribute("value"))
    expect(thing).to_have_value("rice_box")


def test_logs_are_starred_tagged_deleted_and_brought_back_on_their_page(console):
    page = console.page
    page.goto(console.address.split("?")[0] + "logs")
    rows = page.locator("#logs tbody tr")
    expect(rows).not_to_have_count(0, timeout=PATIENCE_MS)
    before, first = rows.count(), rows.first
    first.locator("button.star").click()
    expect(first.locator("button.star")).to_have_attribute("aria-pressed", "true", timeout=PATIENCE_MS)
    first.locator("input[type=checkbox]").check()
    page.click("#describe")
    page.fill("#tags", "figure-5 slow")
    page.fill("#note", "it leaned to the left")
    page.click("#remarks button[type=submit]")
    expect(first.locator("td.marks")).to_have_text(
        re.compile("figure-5 slow it leaned to the left"), timeout=PATIENCE_MS
    )
    expect(first.locator("td.number").last).to_have_text(re.compile(r"^[\d.]+ MB$"))
    page.fill("#query", "figure-5")
    expect(rows).to_have_count(1, timeout=PATIENCE_MS)
    page.click("#delete")
    expect(rows).to_have_count(0, timeout=PATIENCE_MS)
    expect(page.locator("#trash-line")).to_contain_text("1 log, ")
    page.click("#undo")
    expect(rows).to_have_count(1, timeout=PATIENCE_MS)
    expect(page.locator("#trash")).to_be_hidden()
    console.errors.clear()
    page.fill("#query", "force>much")
    expect(page.locator("#filter-why")).to_contain_text("a range is a name, a sign and a number", timeout=PATIENCE_MS)
    console.errors.clear()  # what is refused is no failure of the page's scripts
    page.click(".bar-of-list .menu summary")
    with page.expect_download() as download:
        page.click("#table-csv")
    head = Path(download.value.path()).read_text().splitlines()[0].split(",")
    assert len(head) == len(set(head))
    assert {"starred", "verdict", "episode_verdict"} <= set(head)
    page.fill("#query", "size>0.1")
    expect(rows).to_have_count(before, timeout=PATIENCE_MS)
    expect(page.locator("#filter-why")).to_be_empty()
    page.fill("#query", "")


def test_a_plan_of_ones_own_is_made_on_the_page_and_the_campaign_that_is_started_is_the_one_that_is_shown(console):
    page = console.page
    none = {"plans": [], "campaigns": [], "folder": ""}
    page.route("**/api/campaigns", lambda route: route.fulfill(json=none))  # the plans take their time
    page.goto(console.address.split("?")[0] + "campaigns")
    expect(page.locator("#start [data-why]")).to_have_text("the plans are being read", timeout=PATIENCE_MS)
    expect(page.locator("#start button[type=submit]")).to_be_disabled()
    page.unroute("**/api/campaigns")
    page.click("#own summary")
    form, state = page.locator("#plan-form"), page.locator("#state")
    form.locator("[name=name]").fill("small")
    form.locator("[name=displacements_mm]").fill("-10:ten")
    form.locator("button").click()
    expect(form.locator(".number-wrong")).to_have_text('"-10:ten" is not a list: write -12.5, 5 or -60:10:60.')
    form.locator("[name=displacements_mm]").fill("-10:20:10")
    form.locator("button").click()
    expect(page.locator("#plan")).to_have_text("small: 6 trials", timeout=PATIENCE_MS)
    page.locator("#start [name=nice]").check()
    for number in (1, 2):
        expect(page.locator("#start button[type=submit]")).to_be_enabled(timeout=PATIENCE_MS)
        page.click("#start button[type=submit]")
        expect(page.locator(".card")).to_have_count(number, timeout=PATIENCE_MS)
        expect(state).to_have_text("running", timeout=PATIENCE_MS)  # of the new one: the one before was cancelled
        page.click("#cancel-campaign")
        expect(state).to_have_text(re.compile("interrupted|failed"), timeout=PATIENCE_MS)
    assert console.errors == []
