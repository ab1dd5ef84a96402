"""STOP cannot be taken away: not by the focus, a dialog, the page, its width or the moment, in a real Chromium."""

import pytest
from playwright.sync_api import expect

import console.routes.control
from rtstack.live.protocol import JobState
from rtstack.loop.mailbox import NOT_TAKEN, Mailbox
from tests.support.console.chromium import leave_scene_undrawn
from tests.support.console.look import switch_theme
from tests.support.console.stage import PATIENCE_MS
from tests.support.console.stop_ways import WAYS, arriving, come_to, lead_focus
from tests.support.sampling import sampled

pytestmark = pytest.mark.browser


TYPED_AGAIN = 20
TYPED = "[...document.querySelectorAll('input, textarea')].map((field) => field.value).join('|')"


@pytest.mark.parametrize("way", sampled(WAYS, WAYS[::3].__contains__), ids=str)
def test_stop_arrives(stage, way):
    page = stage.page
    come_to(page, way, stage.served.base, stage.ids)
    band = page.locator("#control-light")
    stage.bring_about(way.moment)
    try:
        word = {"guided": "moving"}.get(way.moment, way.moment)
        expect(band).to_have_attribute("data-state", word, timeout=PATIENCE_MS)
        lead_focus(page, way)
        typed = page.evaluate(TYPED)
        with arriving(stage.served, page):
            if way.how == "button":
                page.click("#stop")
            else:
                page.keyboard.press(way.how)
        assert page.evaluate(TYPED) == typed  # no space
        expect(page.get_by_role("alertdialog")).to_have_count(0)  # a question is answered with no
    finally:
        stage.end()
    assert (stage.served.logs / "demonstration.mcap").exists()


def type_words(page, selector, words):
    """Type words with a space into a field; whether they were there at once.

    On a page that has had no news for 0.5 s the space is STOP: then they are typed again.
    """
    field = page.locator(selector)
    for k in range(TYPED_AGAIN):
        field.fill("")
        field.click()
        page.keyboard.type(words)
        if field.input_value() == words:
            return k == 0
        page.wait_for_timeout(500)
    raise AssertionError(f"a space is never typed: {field.input_value()}")


def test_a_space_is_typed_while_nothing_moves_and_enter_starts_nothing(stage):
    page, jobs = stage.page, stage.served.job_manager
    page.set_viewport_size({"width": 1280, "height": 720})
    page.goto("/")
    expect(page.locator("#control-light")).to_have_attribute("data-state", "disarmed")
    if type_words(page, "#filter", "rice box"):
        assert not stage.served.mailbox.stop_requested
    page.fill("#filter", "")
    page.click("#take")
    page.click("#arm")
    page.click("#tab-demonstration")
    record = page.locator("#demonstration button[type=submit]")
    expect(record).to_be_enabled()
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.click("#demonstration input[name=variation]")
    try:
        page.keyboard.press("Enter")
        page.wait_for_timeout(500)
        assert not [url for url in requests if "/api/jobs" in url]
        with page.expect_response("**/api/jobs/demonstration") as answered:
            page.keyboard.press("Control+Enter")
        assert answered.value.ok
        assert page.evaluate("document.activeElement.tagName") == "BODY"  # the field is left
        assert jobs.status().job.state == JobState.STARTING
        with arriving(stage.served, page):
            page.keyboard.press("Space")
    finally:
        stage.end()


def test_who_is_signed_out_can_still_stop_and_nothing_else(stage, browser):
    served = stage.served
    context = browser.new_context(base_url=served.base)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto("/logs")
    expect(page.locator("h1")).to_have_text("Not signed in")
    expect(page.locator("#stop")).to_have_count(0)  # was never let in
    page.goto(f"/?token={served.parts.sign_in.invite('view')}")
    expect(page.locator("#control-light")).not_to_have_attribute("data-state", "waiting")
    switch_theme(page)
    theme = page.get_attribute("html", "data-theme")
    (session,) = [one for one in served.parts.sign_in._sessions.values() if one.scope == "view"]
    stage.bring_about("moving")
    try:
        served.parts.sign_in.end(session)  # as after twelve hours
        expect(page.locator("h1")).to_have_text("Not signed in")  # by itself
        expect(page.locator(".bar")).to_contain_text("You are signed out, and can still press STOP.")
        with arriving(served, page):
            page.click("#stop")
    finally:
        stage.end()
    for width in (390, 1280):
        page.set_viewport_size({"width": width, "height": 720})
        page.goto("/trials")
        expect(page.locator("h1")).to_have_text("Not signed in")
        assert theme == page.get_attribute("html", "data-theme")  # the one that was chosen
        for press in (lambda: page.keyboard.press("Space"), lambda: page.click("#stop")):
            with arriving(served, page):
                press()
            served.mailbox.clear_stop()
    assert page.request.get("/api/status").status == 401
    word = page.get_attribute("meta[name=csrf-token]", "content") or ""
    headers = {"x-csrf-token": word, "origin": served.base}
    assert page.request.post("/api/take", headers=headers, data={}).status == 401
    assert page.request.post("/api/stop", headers={"origin": served.base}).status == 403
    context.close()


@pytest.mark.parametrize("socket", [True, False], ids=["by the socket", "not at all"])
def test_a_stop_whose_request_fails_is_said_before_anything_else(stage, socket):
    page = stage.page.context.new_page()
    if not socket:
        page.route_web_socket("**/live", lambda _: None)
    page.goto("/logs")
    errors, light = page.locator("#errors .error"), page.locator("#control-light")
    if socket:
        expect(light).not_to_have_attribute("data-state", "waiting", timeout=PATIENCE_MS)
    for path in ("**/api/logs?*", "**/api/stop"):
        page.route(path, lambda route: route.abort())
    try:
        page.fill("#query", "rice")
        expect(errors.last).to_contain_text("The list of logs is not up to date", timeout=PATIENCE_MS)
        page.click("#stop")
        words = "STOP went by the live connection alone" if socket else "STOP was not delivered, the robot goes on"
        expect(errors.first).to_contain_text(words, timeout=PATIENCE_MS)
        expect(errors.first).to_have_attribute("data-tone", "worst")
        assert stage.served.mailbox.stop_requested is socket
    finally:
        stage.served.mailbox.clear_stop()
        page.close()


def test_what_is_not_true_any_more_leaves_by_itself(stage):
    page = stage.page.context.new_page()
    errors = page.locator("#errors .error")
    silent = []

    def meet(socket):
        if len(silent) < 1:
            silent.append(socket)
        else:
            socket.connect_to_server()

    page.route_web_socket("**/live", meet)
    page.route("**/api/logs?*", lambda route: route.abort())
    page.goto("/logs")
    page.fill("#query", "rice")
    expect(errors).to_contain_text("The list of logs is not up to date", timeout=PATIENCE_MS)
    expect(errors.get_by_role("button")).to_have_text("Dismiss")
    page.unroute("**/api/logs?*")
    silent[0].close()
    expect(errors).to_have_count(0, timeout=PATIENCE_MS)
    page.close()


def test_a_stop_that_the_loop_does_not_take_is_said(stage, monkeypatch):
    monkeypatch.setattr(Mailbox, "stop_taken", lambda *_: False)
    monkeypatch.setattr(console.routes.control, "TAKEN_S", 0.0)
    page, error = stage.page, stage.page.locator("#errors .error").first
    page.goto("/")
    expect(page.locator("#control-light")).not_to_have_attribute("data-state", "waiting", timeout=PATIENCE_MS)
    page.click("#stop")
    try:
        expect(error).to_contain_text(NOT_TAKEN, timeout=PATIENCE_MS)
        expect(error).to_have_attribute("data-tone", "worst")
    finally:
        stage.served.mailbox.clear_stop()


def test_silent_arms_are_an_alarm_but_not_while_a_motion_is_prepared(stage):
    page, arms = stage.page, stage.arms
    leave_scene_undrawn(page)
    page.goto("/")
    veil, age, band = (page.locator(selector) for selector in ("#veil", "#age", "#control-light"))
    expect(age).to_have_attribute("data-age", "fresh")
    stage.bring_about("preparing")
    try:
        expect(band).to_have_attribute("data-state", "preparing")
        arms.silent = True  # as while a cell is opened anew
        expect(age.locator(".value")).to_have_text("soon")  # older than what is an alarm otherwise
        expect(age).to_have_attribute("data-age", "fresh")
        expect(veil).to_be_hidden()
        arms.silent = False
        stage.begin("moving")
        expect(band).to_have_attribute("data-state", "moving")
        arms.silent = True
        expect(veil).to_contain_text("No new state from the robot for")
        expect(age).to_have_attribute("data-age", "red")
    finally:
        arms.silent = False
        stage.end()
    expect(veil).to_be_hidden()
