"""STOP cannot be taken away: not by the focus, a dialog, the page, its width or the moment, in a real Chromium.

How soon a STOP reaches the arms: tests/programs/dead_man.py.
"""

from contextlib import contextmanager
from dataclasses import dataclass

import pytest
from playwright.sync_api import expect

from rtstack.live.protocol import JobState
from tests.support.console.stage import PATIENCE_MS, on_stage

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def stage(browser, demonstration, tmp_path_factory):
    with on_stage(browser, demonstration, tmp_path_factory.mktemp("stop") / "logs") as stage:
        yield stage


@dataclass(frozen=True)
class Way:
    """page: its path; focus: what is clicked before, or opened by a key; dialog: what is open; how: key or button."""

    page: str
    focus: str
    dialog: str
    width: int
    moment: str
    how: str

    def __str__(self):
        return "-".join(str(part) for part in vars(self).values()).replace("/", "_").replace(" ", "_")


WAYS = [
    Way(*row)
    for row in (
        ("/", "body", "", 1280, "moving", "Space"),
        ("/", "#trial input[name=displacement_mm]", "", 1280, "moving", "Space"),
        ("/", "#trial input[name=displacement_mm]", "", 1280, "armed", "Space"),
        ("/", "#filter", "", 1280, "moving", "Space"),
        ("/", "#filter", "", 1920, "preparing", "Space"),
        ("/", "#filter", "", 390, "holding", "Space"),
        ("/", "#operator", "", 820, "guided", "Space"),
        ("/", "#demonstration select", "", 1280, "moving", "Space"),  # its list is open
        ("/", "#demonstration select", "", 1280, "moving", "button"),
        ("/", "#stiffness", "", 1280, "moving", "Space"),
        ("/", "#event", "", 1280, "moving", "Space"),
        ("/", "#scene", "", 1280, "moving", "Space"),
        ("/", "#scene", "", 390, "moving", "button"),
        ("/", "body", "help", 1280, "moving", "Space"),
        ("/", "body", "help", 1280, "moving", "button"),
        ("/", "body", "help", 390, "moving", "button"),
        ("/", "body", "", 390, "fault", "button"),
        ("/trials", "#trial input[name=seeds]", "", 1280, "moving", "Space"),
        ("/trials", "#past-failures", "", 820, "moving", "Space"),
        ("/trials", "#theme", "", 1280, "preparing", "Space"),
        ("/campaigns", "#start input[name=workers]", "", 1920, "moving", "Space"),
        ("/campaigns", "#report-frame", "", 1280, "moving", "Space"),
        ("/logs", "#query", "", 1280, "moving", "Space"),
        ("/logs", "#kind", "", 390, "moving", "button"),
        ("/logs/{log}", "#signal-search", "", 1280, "moving", "Space"),
        ("/logs/{log}", "#slider", "", 820, "moving", "Space"),
        ("/logs/{log}", "body", "", 390, "moving", "button"),
        ("/recordings/{log}", "#note", "", 1280, "moving", "Space"),
        ("/recordings/{log}", "#impact", "", 1280, "holding", "Space"),
        ("/recordings/{log}", "#discard", "question", 1280, "moving", "Space"),
        ("/recordings/{log}", "#discard", "question", 1280, "moving", "button"),
        ("/recordings/{log}", "#discard", "question", 390, "moving", "button"),
        ("/access", "#token input[name=name]", "", 1280, "moving", "Space"),
        ("/access", "body", "", 820, "armed", "button"),
        ("/api", ".swagger-ui a", "", 1280, "moving", "Space"),
        ("/recovery", ".rail a", "", 390, "moving", "Space"),
        ("/no/such/page", "body", "", 1280, "moving", "Space"),
        ("/logs/0000000000000000", "body", "", 390, "moving", "button"),
    )
]


TYPED = "[...document.querySelectorAll('input, textarea')].map((field) => field.value).join('|')"


@pytest.mark.parametrize("way", WAYS, ids=str)
def test_stop_arrives(stage, way):
    page = stage.page
    page.set_viewport_size({"width": way.width, "height": 844 if way.width < 1280 else 720})
    address = stage.served.base + way.page.format(**stage.ids)
    if page.url != address:
        page.goto(address)
    page.keyboard.press("Escape")  # the list of a select that the last way has left open
    band = page.locator("#control-light")
    expect(band).not_to_have_attribute("data-state", "waiting")
    if way.page == "/":
        tab = way.focus.split()[0].removeprefix("#")
        page.click(f"#tab-{tab if tab in ('demonstration', 'trial') else 'hand'}")
    if way.focus == "#report-frame":
        shown = "frame => { document.querySelector('main').prepend(frame); frame.hidden = false; }"
        page.locator("#report-frame").evaluate(shown)
        page.locator("#report-frame").evaluate("frame => { frame.srcdoc = '<p id=drawn>A report</p>'; }")
    stage.bring_about(way.moment)
    try:
        word = {"guided": "moving"}.get(way.moment, way.moment)
        expect(band).to_have_attribute("data-state", word, timeout=PATIENCE_MS)
        if way.focus in ("#scene", "#report-frame"):
            page.frame_locator(way.focus).locator("#drawn").evaluate(
                "drawn => { drawn.tabIndex = 0; drawn.ownerDocument.defaultView.focus(); drawn.focus(); }"
            )
        elif way.focus in (".swagger-ui a", ".rail a", "#theme", "#event"):
            page.locator(way.focus).first.focus()
        elif way.focus != "body":
            page.locator(way.focus).first.click()
        if way.dialog == "help":
            page.keyboard.press("?")
            expect(page.locator("#help")).to_be_visible()
        elif way.dialog == "question":
            expect(page.get_by_role("alertdialog")).to_be_visible()
        typed = page.evaluate(TYPED)
        with arriving(stage.served, page), page.expect_request("**/api/stop"):
            if way.how == "button":
                page.click("#stop")
            else:
                page.keyboard.press(way.how)
        assert page.evaluate(TYPED) == typed  # no space
        expect(page.get_by_role("alertdialog")).to_have_count(0)  # a question is answered with no
    finally:
        stage.end()
    assert (stage.served.logs / "demonstration.mcap").exists()


@contextmanager
def arriving(served, page):
    """Wait for the STOP that is pressed meanwhile, until all of it is over."""
    assert not served.mailbox.stop_requested
    before = served.stops_told()
    yield
    for _ in range(600):
        if served.mailbox.stop_requested and served.stops_told() > before:
            return
        page.wait_for_timeout(100)
    raise AssertionError("STOP has not arrived")


def test_a_space_is_typed_while_nothing_moves_and_enter_starts_nothing(stage):
    page, jobs = stage.page, stage.served.job_manager
    page.set_viewport_size({"width": 1280, "height": 720})
    page.goto("/")
    expect(page.locator("#control-light")).to_have_attribute("data-state", "disarmed")
    page.click("#filter")
    page.keyboard.type("rice box")
    expect(page.locator("#filter")).to_have_value("rice box")
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
    (session,) = [one for one in served.parts.sign_in._sessions.values() if one.scope == "view"]
    stage.bring_about("moving")
    try:
        served.parts.sign_in.end(session)  # as after twelve hours
        expect(page.locator("#errors")).to_contain_text("not signed in any more: STOP still works")
        with arriving(served, page):
            page.click("#stop")
    finally:
        stage.end()
    for width in (390, 1280):
        page.set_viewport_size({"width": width, "height": 720})
        page.goto("/trials")
        expect(page.locator("h1")).to_have_text("Not signed in")
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


def test_a_wrong_address_is_a_page_and_only_of_the_interface_json(stage):
    page = stage.page
    for address, said in (("/no/such/page", "Nothing is at /no/such/page"), ("/logs/0000000000000000", "no such log")):
        answer = page.goto(address)
        assert answer is not None
        assert answer.status == 404
        expect(page.locator("h1")).to_have_text("There is no such page")
        expect(page.locator("main")).to_contain_text(said)
        expect(page.locator(".rail a")).to_have_count(6)
        expect(page.locator("#control-light")).to_have_attribute("data-state", "disarmed")
    answer = page.request.get("/api/no-such-thing")
    assert (answer.status, list(answer.json())) == (404, ["error"])
