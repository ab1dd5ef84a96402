"""Panels of another package in a real Chromium: one shows live data; hostile ones reach nothing, and STOP works."""

import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Frame, Page, expect

from tests.support.console.look import (
    PICTURED,
    THEMES,
    WINDOWS,
    WRITE,
    keep_picture,
    misplaced,
    switch_theme,
    violations,
)
from tests.support.console.stage import Stage, on_stage
from tests.support.console.stop_ways import arriving
from tests.support.plugin import installed

pytestmark = pytest.mark.browser
PATIENCE_MS = 60_000
ATTEMPTS = 19
LEFT_OUT = """for (const section of document.querySelectorAll("[data-panel]"))
    if (!["forces", "wrong"].includes(section.dataset.panel)) section.hidden = true"""
EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"
OFFERS = """[rtstack.panels]
forces = joint_tracking.panel:panel
hostile = panels_of_lab:HOSTILE
leaving = panels_of_lab:LEAVING
looping = panels_of_lab:LOOPING
showing = panels_of_lab:SHOWING
taking = panels_of_lab:TAKING
wrong = panels_of_lab:WRONG
"""
MODULE = '''
from rtstack.live.panel import Panel

def words(view):
    return {"word": view.live["state"]["word"], "number": view.live["number"]}

def frame(title, script, data=lambda view: 1):
    return Panel(title, "<p id='shown'>nothing yet</p><script>" + script + "</script>", data, 0.2)

SHOWING = frame("The state's word", """
  addEventListener("message", ({ data }) => {
    document.getElementById("shown").textContent = `${data.word} ${data.number}`;
  });
""", words)
HOSTILE = frame("Hostile", """
  window.reached = {};
  const attempt = (name, act) => Promise.resolve().then(act).then(
    (value) => (reached[name] = value), (error) => (reached[name] = `no: ${error.name}`));
  const base = new URL(location.href).origin;
  const settled = (name, make, good) => attempt(name, () => new Promise((resolve, reject) => {
    const one = make();
    one.addEventListener(good, () => resolve("yes"));
    one.addEventListener("error", () => reject(new Error("refused")));
  }));
  const post = { method: "POST", body: "{}" };
  attempt("fetch", () => fetch(`${base}/api/status`).then((answer) => answer.text()));
  attempt("own route", () => fetch(`${base}/api/panels/hostile`).then((answer) => answer.text()));
  attempt("stop", () => fetch(`${base}/api/stop`, post).then((answer) => answer.status));
  attempt("no cors", () => fetch(`${base}/api/stop`, { ...post, mode: "no-cors" }).then(() => "yes"));
  attempt("module", () => import(`${base}/static/js/stop.js`).then(() => "yes"));
  attempt("parent", () => parent.document.title);
  attempt("top", () => top.document.cookie);
  attempt("frame element", () => { if (frameElement === null) throw new Error("none"); return "yes"; });
  attempt("cookie", () => document.cookie);
  attempt("storage", () => localStorage.length);
  attempt("navigate", () => { top.location = "about:blank"; return "tried"; });
  attempt("open", () => (open(`${base}/`) === null ? "no: null" : "yes"));
  attempt("popup", () => (open("about:blank", "_blank") === null ? "no: null" : "yes"));
  settled("worker", () => new Worker(URL.createObjectURL(new Blob(["postMessage(1)"]))), "message");
  attempt("shout", () => {
    for (const word of ["stop", "beat", { data: 1 }]) parent.postMessage(word, "*");
    return "tried";
  });
  settled("socket", () => new WebSocket(`${base.replace("http", "ws")}/live`), "open");
  settled("source", () => new EventSource(`${base}/api/status`), "open");
  settled("picture", () => Object.assign(new Image(), { src: `${base}/static/icon.svg` }), "load");
  attempt("form", () => {
    const form = document.createElement("form");
    Object.assign(form, { action: `${base}/sign-in`, method: "post", target: "_top" });
    document.body.append(form);
    form.submit();
    return "tried";
  });
""")
LEAVING = frame("Leaving", "setTimeout(() => { location = '/api/status'; }, 500);")
LOOPING = frame("Looping", "setTimeout(() => { for (;;); }, 500);")
TAKING = frame("Taking", """
  const field = document.body.appendChild(document.createElement("input"));
  setTimeout(() => setInterval(() => { window.focus(); field.focus(); }, 2), 500);
""")
WRONG = "no panel"
'''


@pytest.fixture(scope="module")
def stage(browser, demonstration, tmp_path_factory) -> Iterator[Stage]:
    """A console beside which a package of seven panels is installed."""
    package = tmp_path_factory.mktemp("package")
    shutil.copytree(EXAMPLE / "joint_tracking", package / "joint_tracking")
    with (
        installed(package, OFFERS, {"panels_of_lab": MODULE}),
        on_stage(browser, demonstration, tmp_path_factory.mktemp("stage") / "logs") as stage,
    ):
        yield stage


def only(page: Page, *names: str) -> None:
    """Leave the other panels out: each test has the machine for its own ones."""
    page.unroute("**/api/panels/*")
    page.route(
        "**/api/panels/*",
        lambda route: route.continue_() if route.request.url.split("/")[-1] in names else route.abort(),
    )
    page.goto("/panels")


def frame_of(page: Page, name: str) -> Frame:
    """Return a panel's frame, once it is there."""
    end_s = time.monotonic() + PATIENCE_MS * 1e-3
    while not (found := [frame for frame in page.frames if f"/panels/{name}?" in frame.url]):
        assert time.monotonic() < end_s, f"{name} is not shown: {page.locator('main').inner_text()}"
        page.wait_for_timeout(50)
    return found[0]


def stops(stage: Stage, press: Callable[[], None]) -> None:
    """Press STOP and wait until all of it is over."""
    with arriving(stage.served, stage.page):
        press()
    stage.served.mailbox.clear_stop()


def test_a_panel_shows_the_live_state(stage):
    only(stage.page, "showing", "wrong")
    page = stage.page
    assert page.locator(".rail a[aria-current]").inner_text() == "Panels"
    section = page.locator("[data-panel=showing]")
    expect(section.locator("h2")).to_have_text("The state's word", timeout=PATIENCE_MS)
    expect(section.locator(".head span")).to_have_text("lab-tools 1.2")
    shown = page.frame_locator("[data-panel=showing] iframe").locator("#shown")
    expect(shown).to_have_text(re.compile(r"^disarmed \d+$"), timeout=PATIENCE_MS)
    first = shown.inner_text()
    expect(shown).not_to_have_text(first, timeout=PATIENCE_MS)
    stage.bring_about("fault")
    try:
        expect(shown).to_have_text(re.compile(r"^fault \d+$"), timeout=PATIENCE_MS)
    finally:
        stage.end()
    wrong = page.locator("[data-panel=wrong] .why")
    line = "panel 'wrong': panels_of_lab:WRONG of lab-tools 1.2 is str, not Panel"
    expect(wrong).to_contain_text(line, timeout=PATIENCE_MS)


def test_a_hostile_panel_reaches_nothing(stage):
    answered = []
    stage.page.on("response", lambda answer: answered.append((answer.frame.url, answer.url)))
    only(stage.page, "hostile", "showing")
    frame = frame_of(stage.page, "hostile")
    stage.page.wait_for_timeout(3000)  # for what was only tried, too
    reached = frame.evaluate("reached")
    assert len(reached) == ATTEMPTS
    tried = {name for name, value in reached.items() if value == "tried"}
    assert tried <= {"navigate", "shout", "form"}
    refused = {name for name, value in reached.items() if str(value).startswith("no: ")}
    assert tried | refused == set(reached), reached
    assert stage.page.url == f"{stage.served.base}/panels"
    assert len(stage.page.context.pages) == 1
    assert not stage.served.mailbox.stop_requested  # none of its words is one of the page's
    assert {url for source, url in answered if "/panels/hostile?" in source} <= {frame.url}
    stops(stage, lambda: stage.page.click("#stop"))
    stops(stage, lambda: stage.page.keyboard.press("Space"))
    stage.page.frame_locator("[data-panel=hostile] iframe").locator("#shown").click()
    stage.page.wait_for_timeout(200)
    stops(stage, lambda: stage.page.keyboard.press("Space"))  # the frame that was clicked keeps no key


def test_a_panel_cannot_open_another_address_in_its_frame(stage):
    only(stage.page, "leaving", "showing")
    frame_of(stage.page, "leaving")
    expect(stage.page.locator("[data-panel=leaving] .why")).to_contain_text(
        "The panel leaving left the address of its frame, and was closed", timeout=PATIENCE_MS
    )
    expect(stage.page.locator("[data-panel=leaving] iframe")).to_have_count(0)
    frame_of(stage.page, "showing")


def test_a_panel_that_takes_the_keyboard_again_and_again_is_closed_and_stop_works_meanwhile(stage):
    only(stage.page, "taking", "showing")
    frame_of(stage.page, "taking")
    stage.page.wait_for_timeout(550)
    stops(stage, lambda: stage.page.click("#stop"))
    expect(stage.page.locator("[data-panel=taking] iframe")).to_have_count(0, timeout=PATIENCE_MS)
    stops(stage, lambda: stage.page.keyboard.press("Space"))


@pytest.mark.long
def test_the_page_of_panels_in_both_themes_and_every_window(stage, tmp_path):
    page = stage.page
    wrong = {}
    for theme in ("light", "dark"):
        only(page, "forces", "wrong")
        if page.get_attribute("html", "data-theme") != theme:
            switch_theme(page)
            only(page, "forces", "wrong")
        forces = page.frame_locator("[data-panel=forces] iframe").locator("#arms")
        expect(forces).to_contain_text("at most 0.0 N", timeout=PATIENCE_MS)
        page.evaluate(LEFT_OUT)
        for width, height in WINDOWS:
            page.set_viewport_size({"width": width, "height": height})
            if found := misplaced(page) + violations(page):
                wrong[theme, width] = found
            if (folder := PICTURED.get((width, height))) is not None:
                keep_picture(page, "panels", (THEMES[theme] if WRITE else tmp_path / theme) / folder)
    assert not wrong, "\n".join(f"{where}: {what}" for where, what in wrong.items())


# the last one: Chromium keeps all of a site's sandboxed frames in one process, where the loop goes on
def test_a_panel_whose_script_never_ends_holds_up_neither_the_page_nor_stop(stage):
    only(stage.page, "looping", "showing")
    frame_of(stage.page, "looping")
    stage.page.wait_for_timeout(1500)
    before = stage.page.evaluate("performance.now()")
    stops(stage, lambda: stage.page.click("#stop"))
    stops(stage, lambda: stage.page.keyboard.press("Space"))
    assert stage.page.evaluate("performance.now()") - before < 5000.0
